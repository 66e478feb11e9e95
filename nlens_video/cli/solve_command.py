"""The command `solve`: a plate's camera, from its metadata and its pictures, into a file."""

from __future__ import annotations

import math
from argparse import Namespace
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from itertools import takewhile
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from nlens_video.cameras.files import camera_text, check_camera_name
from nlens_video.cameras.solved import SolvedCamera
from nlens_video.core import signals
from nlens_video.core.errors import UsageError
from nlens_video.core.layers import Picture
from nlens_video.core.placement import FULL_FRAME_DIAGONAL_MM, focal_35mm
from nlens_video.core.settings import Settings, SourceSettings
from nlens_video.options import to_settings
from nlens_video.run.open_run import opened
from nlens_video.solve.shot import KnownFov, ShotSolver
from nlens_video.video.atomic_files import check_folder, replacing
from nlens_video.video.info import SourceInfo

if TYPE_CHECKING:
    from nlens_video.cli.console import Console

_WIDEST = 1280  # pictures are solved at this width at most [px]
_METADATA_ERROR = 0.03  # stabilisation and video crops change what a tag says [1]
_GIVEN_ERROR = 1e-3


def run_solve(args: Namespace, console: Console) -> int:
    """The command `solve`."""
    plate = to_settings.source_settings(args)
    with console.progress_bar("tracking") as on_progress:
        camera = solve_camera(plate, args.output, args.fov, args.every or 0, on_progress)
    console.camera(args.output, camera)
    return 0


def solve_camera(
    source: SourceSettings,
    output: Path,
    fov_deg: float | None = None,
    every: int = 0,
    on_progress: Callable[[int, int | None], None] = lambda done, total: None,
) -> SolvedCamera:
    """Solve a plate's camera and write it.

    Args:
        source: the plate.
        output: the camera's file; its suffix chooses the format.
        fov_deg: field of view across the frame where it is known [deg].
        every: keyframes lie this many frames apart, 0 for a number by the shot's length.
        on_progress: called with the frames so far and in all.

    Returns:
        The camera at the plate's size.

    Raises:
        UsageError: no format has this suffix, the range holds no frame, or the camera moves and
            pycolmap is missing.
        InputError: the plate cannot be read, or its camera cannot be solved.
        OutputError: the file cannot be written.
    """
    check_camera_name(output)
    check_folder(output)
    camera = _solved(source, fov_deg, every, on_progress)
    with replacing(output) as partial:
        partial.write_text(camera_text(camera, output), encoding="utf-8")
    return camera


@contextmanager
def solved_camera(settings: Settings, console: Console) -> Iterator[Settings]:
    """The settings of a run with the plate's camera, in a file that lasts as long as the run.

    Args:
        settings: of a run whose scene has no camera; its plate can be read again.
        console: shows the progress.

    Raises:
        UsageError, InputError: as `solve_camera`.
    """
    with TemporaryDirectory(prefix="nlens-video-camera-") as folder:
        path = Path(folder) / "camera.json"
        with console.progress_bar("tracking") as on_progress:
            camera = _solved(settings.source, None, 0, on_progress)
        path.write_text(camera.to_json(), encoding="utf-8")
        yield replace(settings, scene=replace(settings.scene, camera_from=path))


def _solved(
    source: SourceSettings,
    fov_deg: float | None,
    every: int,
    on_progress: Callable[[int, int | None], None],
) -> SolvedCamera:
    start, end = source.frames
    with opened(source) as plate:
        info = plate.info
        scale = min(1.0, _WIDEST / info.width)
        size = round(info.width * scale), max(1, round(info.height * scale))
        solver = ShotSolver(size=size, known=_known(info, fov_deg), every=every)
        count = 0
        for frame in takewhile(lambda frame: end is None or frame.index < end, plate):
            signals.check()
            if frame.index < start:
                continue
            solver.add(_luma(frame.picture, size), frame.time_s)
            count += 1
            on_progress(count, info.frame_count)
    if not count:
        raise UsageError(f"--range {start}:{end or ''}: the source has no such frames")
    camera = solver.solve()
    return replace(camera, width=info.width, height=info.height)


def _known(info: SourceInfo, fov_deg: float | None) -> KnownFov | None:
    """The field of view that the user or the file gives, None for neither."""
    if fov_deg is not None:
        focal = 0.5 / math.tan(0.5 * math.radians(fov_deg))
        return KnownFov(focal=focal, error=_GIVEN_ERROR, given=True)
    found = focal_35mm(info.metadata)
    if found is None:
        return None
    diagonal = math.hypot(1.0, info.height / info.width)
    return KnownFov(
        focal=found / FULL_FRAME_DIAGONAL_MM * diagonal, error=_METADATA_ERROR, given=False
    )


def _luma(picture: Picture, size: tuple[int, int]) -> npt.NDArray[np.uint8]:
    """Square root of the green light as 8 bit (H, W)."""
    light = picture.downsample(*size)[..., 1]
    return np.asarray(np.sqrt(np.clip(light, 0.0, 1.0)) * 255.0 + 0.5, np.uint8)
