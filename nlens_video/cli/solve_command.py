"""The command `solve`: a plate's camera, from its metadata and its pictures, into a file."""

from __future__ import annotations

import math
from argparse import Namespace
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import partial
from itertools import takewhile
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

import cv2
import numpy as np
import numpy.typing as npt

from nlens_video.cameras.files import camera_bytes, check_camera_name
from nlens_video.cameras.solved import SolvedCamera
from nlens_video.core import signals
from nlens_video.core.errors import UsageError
from nlens_video.core.layers import CocMap, Float32
from nlens_video.core.placement import FULL_FRAME_DIAGONAL_MM
from nlens_video.core.scale import UNKNOWN_SCALE, ScaleSettings
from nlens_video.core.settings import (
    Settings,
    SourceSettings,
)
from nlens_video.graph.base.objects_on_ground import load_scene
from nlens_video.networks.model_store import find_model
from nlens_video.networks.onnx_networks import OnnxCocNetwork
from nlens_video.options import to_settings
from nlens_video.report.camera import CameraFindings, PlatePicture, write_camera_page
from nlens_video.report.findings import EvenPick
from nlens_video.report.html import to_8_bit
from nlens_video.run.open_run import opened
from nlens_video.solve.evidence import Reprojection, line_groups, reproject
from nlens_video.solve.focal import KnownFov
from nlens_video.solve.free_place import chosen_place
from nlens_video.solve.marker_fit import metric_camera
from nlens_video.solve.markers import MarkerFinder
from nlens_video.solve.person import scaled_by_person
from nlens_video.solve.person_box import find_person
from nlens_video.solve.shot import CUES, Cue, ShotSolver
from nlens_video.solve.tracks import luma_of
from nlens_video.stages.f_coc import estimate_coc
from nlens_video.video.atomic_files import check_folder, make_folder, replacing
from nlens_video.video.focal_length import tagged_focal
from nlens_video.video.info import SourceInfo

if TYPE_CHECKING:
    from nlens_video.cli.console import Console

_PICTURE_PX = 960  # width of a picture of the report [px]
_KEPT, _SHOWN = 16, 3  # pictures for the report, of which so many are shown
_WIDEST = 1280  # pictures are solved at this width at most [px]
_GIVEN_ERROR = 1e-3


def run_solve(args: Namespace, console: Console) -> int:
    """The command `solve`."""
    plate, scale = to_settings.source_settings(args), to_settings.scale_settings(args)
    if args.report is not None:
        make_folder(args.report, "give --report a writable folder")
    with console.progress_bar("tracking") as on_progress:
        camera = solve_camera(
            plate, args.output, args.fov, args.every or 0, on_progress, report=args.report,
            scale=scale,
        )  # fmt: skip
    console.camera(args.output, camera)
    return 0


def solve_camera(
    source: SourceSettings,
    output: Path,
    fov_deg: float | None = None,
    every: int = 0,
    on_progress: Callable[[int, int | None], None] = lambda done, total: None,
    *,
    report: Path | None = None,
    scale: ScaleSettings = UNKNOWN_SCALE,
    cues: Sequence[Cue] = CUES,
) -> SolvedCamera:
    """Solve a plate's camera and write it.

    Args:
        source: the plate.
        output: the camera's file; its suffix chooses the format.
        fov_deg: field of view across the frame where it is known [deg].
        every: keyframes lie this many frames apart, 0 for a number by the shot's length.
        on_progress: called with the frames so far and in all.
        scale: what tells the scale.
        report: folder of a page that shows the camera on the plate, None for none; it exists.
        cues: what may tell the attitude.

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
    pictures: EvenPick[PlatePicture] | None = None if report is None else EvenPick(_KEPT)
    found = _solved(source, scale, fov_deg, every, on_progress, pictures, cues)
    with replacing(output) as partial:
        partial.write_bytes(camera_bytes(found.camera, output))
    if report is not None and pictures is not None:
        write_camera_page(report, _findings(source.spec, output, found, pictures.picked(_SHOWN)))
    return found.camera


def plate_camera(source: SourceSettings, fov_deg: float | None, console: Console) -> SolvedCamera:
    """Solve a plate's camera.

    Args:
        source: the plate.
        fov_deg: field of view across the frame where it is known [deg].
        console: shows the progress.

    Raises:
        UsageError, InputError: as `solve_camera`.
    """
    with console.progress_bar("tracking") as on_progress:
        return _solved(source, UNKNOWN_SCALE, fov_deg, 0, on_progress).camera


@contextmanager
def solved_camera(settings: Settings, console: Console) -> Iterator[Settings]:
    """The settings of a run with the plate's camera, in a file that lasts as long as the run.

    Args:
        settings: of a run whose scene has no camera; its plate can be read again.
        console: shows the progress.

    Raises:
        UsageError, InputError: as `solve_camera`.
        SceneError: the scene cannot be used.
    """
    load_scene(settings.scene)  # a file that is wrong is told at once
    with TemporaryDirectory(prefix="nlens-video-camera-") as folder:
        path = Path(folder) / "camera.json"
        with console.progress_bar("tracking") as on_progress:
            camera = camera_of_run(settings, on_progress)
        path.write_text(camera.to_json(), encoding="utf-8")
        yield replace(settings, scene=replace(settings.scene, camera_from=path))


def camera_of_run(
    settings: Settings, on_progress: Callable[[int, int | None], None]
) -> SolvedCamera:
    """Solve the camera of a run's plate.

    Args:
        settings: the run.
        on_progress: called with the frames so far and in all.

    Raises:
        UsageError, InputError: as `solve_camera`.
    """
    fov = settings.scene.fov_deg or settings.lens.fov_x_deg
    return _solved(settings.source, settings.scale, fov, 0, on_progress).camera


@dataclass(frozen=True, slots=True, eq=False)
class _Solved:
    """A plate's camera at the plate's size, and what it was solved from, at the solver's size."""

    camera: SolvedCamera
    solver: ShotSolver
    tracked: Reprojection
    frames: list[int]


def _solved(
    source: SourceSettings,
    scale: ScaleSettings,
    fov_deg: float | None,
    every: int,
    on_progress: Callable[[int, int | None], None],
    pictures: EvenPick[PlatePicture] | None = None,
    cues: Sequence[Cue] = CUES,
) -> _Solved:
    """Solve a plate's camera; `pictures` gets some frames of it."""
    start, end = source.frames
    with opened(source) as plate:
        info = plate.info
        shrink = min(1.0, _WIDEST / info.width)
        size = round(info.width * shrink), max(1, round(info.height * shrink))
        markers = None if scale.marker_m is None else MarkerFinder()
        known, said = _known(info, fov_deg)
        solver = ShotSolver(size=size, known=known, first=start, every=every, lines="lines" in cues)
        frames: list[int] = []
        for frame in takewhile(lambda frame: end is None or frame.index < end, plate):
            signals.check()
            if frame.index < start:
                continue
            if not frames and "blur" in cues:
                first = cv2.resize(frame.picture.srgb(), size, interpolation=cv2.INTER_AREA)
                solver.coc = partial(_coc, np.asarray(first, np.float32))
            luma = luma_of(frame.picture, size)
            if not frames:
                scale = _with_box(scale, luma)
            solver.add(luma, frame.time_s)
            if markers is not None and not markers.full:
                if info.width > size[0]:
                    luma = luma_of(frame.picture, (info.width, info.height))
                markers.add(luma)
            if pictures is not None and pictures.next_is_wanted():
                image = to_8_bit(frame.picture.srgb(), _PICTURE_PX)
                pictures.keep(PlatePicture(frame.index, frame.time_s, image))
            frames.append(frame.index)
            on_progress(len(frames), info.frame_count)
    if not frames:
        raise UsageError(f"--range {start}:{end or ''}: the source has no such frames")
    camera = solver.solve()
    tracked = reproject(solver.seen, solver.times_s, camera)
    error = tracked.median_px
    method = f"{camera.method}{said}" if camera.fov == "metadata" else camera.method
    camera = replace(
        camera, width=info.width, height=info.height, method=method,
        reprojection_px=None if error is None else error / shrink,
    )  # fmt: skip
    camera = _in_metres(camera, scale, markers)
    keys = tuple(replace(key, index=frames[key.index]) for key in camera.keys)  # of the plate
    place, guessed = chosen_place(
        solver.seen.tracks(), solver.times_s, camera.resized(*size), solver.segments
    )
    camera = replace(camera, keys=keys, place=place, place_guessed=guessed)
    return _Solved(camera, solver, tracked, frames)


def _in_metres(
    camera: SolvedCamera, scale: ScaleSettings, markers: MarkerFinder | None
) -> SolvedCamera:
    """The camera in metres where something tells the scale."""
    if markers is not None and scale.marker_m is not None:
        return metric_camera(camera, *markers.sightings(), side_m=scale.marker_m)
    if scale.person is not None and scale.person_m is not None:
        left, upper, right, lower = scale.person
        return scaled_by_person(camera, (left, upper, right, lower), scale.person_m)
    return camera


def _with_box(scale: ScaleSettings, luma: npt.NDArray[np.uint8]) -> ScaleSettings:
    """The scale with the whole person where a point is given; `luma` is the first picture."""
    if scale.person is None or len(scale.person) != 2:
        return scale
    return replace(scale, person=find_person(luma, (scale.person[0], scale.person[1])))


def _findings(
    plate: str, output: Path, found: _Solved, pictures: list[PlatePicture]
) -> CameraFindings:
    """What the page shows, at the plate's size."""
    scale = found.camera.width / found.solver.size[0]
    lines = found.solver.segments
    first = found.camera.at(found.solver.times_s[0])
    tracked = found.tracked
    ends = scale * lines.ends
    return CameraFindings(
        plate=plate,
        output=str(output),
        solved=found.camera,
        pictures=pictures,
        lines=ends,
        groups=line_groups(replace(lines, ends=ends), first),
        tracked=replace(
            tracked, position=scale * tracked.position, error_px=scale * tracked.error_px
        ),
        frames=found.frames,
    )


def _known(info: SourceInfo, fov_deg: float | None) -> tuple[KnownFov | None, str]:
    """The field of view that the user or the file gives, and which says so; None for neither."""
    if fov_deg is not None:
        focal = 0.5 / math.tan(0.5 * math.radians(fov_deg))
        given = KnownFov(focal=focal, error=_GIVEN_ERROR, given=True)
        return given, f"; field of view by --fov {fov_deg:g}"
    found = tagged_focal(info)
    if found is None:
        return None, ""
    diagonal = math.hypot(1.0, info.height / (info.width * info.pixel_aspect))
    focal = found.equivalent_mm / FULL_FRAME_DIAGONAL_MM * diagonal
    said = f"; field of view by the recording's {found.tag}, {found.equivalent_mm:.4g} mm"
    return KnownFov(focal=focal, error=found.error, given=False), said


def _coc(rgb: Float32) -> CocMap:
    """The blur of a picture (H, W, 3), sRGB in [0, 1]."""
    with OnnxCocNetwork(find_model("coc").path) as network:
        return estimate_coc(network, rgb)
