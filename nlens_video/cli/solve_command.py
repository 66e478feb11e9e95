"""The command `solve`: a plate's camera, from its metadata and its pictures, into a file."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from msgspec.structs import replace

from nlens_video.cameras.doubt import missed
from nlens_video.cameras.files import camera_bytes, check_camera_name, lost_in
from nlens_video.cameras.solved import SolvedCamera
from nlens_video.cli.plate_solver import Solved, solve_plate
from nlens_video.core.scale import UNKNOWN_SCALE, ScaleSettings
from nlens_video.core.settings import (
    Settings,
    SourceSettings,
)
from nlens_video.graph.base.objects_on_ground import load_scene
from nlens_video.options import to_settings
from nlens_video.report.camera import CameraFindings, PlatePicture, write_camera_page
from nlens_video.report.findings import EvenPick
from nlens_video.solve.evidence import PlateLines, line_groups
from nlens_video.solve.shot import CUES, Cue
from nlens_video.video.atomic_files import check_folder, make_folder, replacing
from nlens_video.video.input.source import open_source

if TYPE_CHECKING:
    from nlens_video.cli.console import Console

_KEPT, _SHOWN = 16, 3  # pictures for the report, of which so many are shown


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
    lost = lost_in(camera, args.output)
    if lost:
        console.note(f"{args.output} cannot hold {', '.join(lost)}; camera.json, .glb and .usda do")
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
    found = solve_plate(source, scale, fov_deg, every, on_progress, pictures, cues)
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
        return solve_plate(source, UNKNOWN_SCALE, fov_deg, 0, on_progress).camera


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
        if said := missed(camera):
            console.note(said)
        path.write_text(camera.to_json(), encoding="utf-8")
        scene = replace(settings.scene, camera_from=path, camera_solved=True)
        yield replace(settings, scene=scene)


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
    return camera_and_lines(settings, on_progress)[0]


def _fov_of_lens(settings: Settings) -> float | None:
    """Field of view across the plate by the lens that is known [deg]."""
    if settings.lens.sensor_long_mm is None:
        return settings.lens.fov_x_deg
    with open_source(settings.source.spec, **settings.source.hints) as opened:
        info = opened.info
    return settings.lens.across(info.width * info.pixel_aspect, info.height).fov_x_deg


def camera_and_lines(
    settings: Settings, on_progress: Callable[[int, int | None], None]
) -> tuple[SolvedCamera, PlateLines]:
    """As `camera_of_run`, with the line segments from which it was solved."""
    fov = settings.scene.fov_deg or _fov_of_lens(settings)
    found = solve_plate(settings.source, settings.scale, fov, 0, on_progress)
    size = found.solver.size
    first = found.camera.resized(*size).at(found.solver.times_s[0])
    return found.camera, PlateLines.of(found.solver.segments, size, first)


def _findings(
    plate: str, output: Path, found: Solved, pictures: list[PlatePicture]
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
