"""Solving the camera of a plate that is read from a file or a stream."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Sequence
from functools import partial
from itertools import takewhile

import cv2
import numpy as np
import numpy.typing as npt
from msgspec import Struct
from msgspec.structs import replace

from nlens_video.cameras.solved import GIVEN_FOV, SolvedCamera
from nlens_video.core import signals
from nlens_video.core.errors import InputError, UsageError
from nlens_video.core.layers import CocMap, Float32, Picture
from nlens_video.core.placement import FULL_FRAME_DIAGONAL_MM
from nlens_video.core.scale import ScaleSettings
from nlens_video.core.settings import SourceSettings
from nlens_video.networks.camera_network import OnnxCameraNetwork
from nlens_video.networks.model_store import find_model
from nlens_video.networks.onnx_networks import OnnxCocNetwork
from nlens_video.report.camera import PlatePicture
from nlens_video.report.findings import EvenPick
from nlens_video.report.html import to_8_bit
from nlens_video.run.plate_source import no_such_frames, opened
from nlens_video.solve.evidence import Reprojection, doubted_where_steep, reproject
from nlens_video.solve.focal import KnownFov
from nlens_video.solve.free_place import chosen_place
from nlens_video.solve.marker_fit import metric_camera
from nlens_video.solve.markers import MarkerFinder
from nlens_video.solve.person import scaled_by_person
from nlens_video.solve.person_box import find_person
from nlens_video.solve.shot import CUES, Cue, ShotSolver
from nlens_video.solve.still.picture_cue import PictureCue, picture_cue
from nlens_video.solve.still.segments import Segments
from nlens_video.solve.tracks import luma_of
from nlens_video.stages.f_coc import estimate_coc
from nlens_video.video.focal_length import tagged_focal
from nlens_video.video.info import SourceInfo

_PICTURE_PX = 960  # width of a picture of the report [px]
_WIDEST = 1280  # pictures are solved at this width at most [px]
_GIVEN_ERROR = 1e-3
_MOST_OFF = 0.004  # of the width, by which half of the points may be off on a path [1]


class SolvedFrom(Struct, frozen=True, eq=False):
    """What a camera was solved from, in a reduced frame with the plate's pixels.

    Attributes:
        size: its columns and rows [px].
        segments: lines of the first picture.
        times_s: of the frames [s].
    """

    size: tuple[int, int]
    segments: Segments
    times_s: list[float]


class Solved(Struct, frozen=True, eq=False):
    """A plate's camera at the plate's size, and what it was solved from, at another size.

    Attributes:
        camera: of the plate.
        solver: what it was solved from.
        tracked: points that were followed, at the solver's size.
        frames: of the plate that were solved.
    """

    camera: SolvedCamera
    solver: SolvedFrom
    tracked: Reprojection
    frames: list[int]


def solve_plate(
    source: SourceSettings,
    scale: ScaleSettings,
    fov_deg: float | None,
    every: int,
    on_progress: Callable[[int, int | None], None],
    pictures: EvenPick[PlatePicture] | None = None,
    cues: Sequence[Cue] = CUES,
) -> Solved:
    """Solve a plate's camera; `pictures` gets some frames of it."""
    start, end = source.frames
    with opened(source) as plate:
        info = plate.info
        square = _square_size(info)
        shrink = min(1.0, _WIDEST / square[0])
        size = round(square[0] * shrink), max(1, round(square[1] * shrink))
        markers = None if scale.marker_m is None else MarkerFinder()
        known, said = _known(info, fov_deg)
        solver = ShotSolver(
            size=size, known=known, first=start, every=every, lines="lines" in cues,
            ignored=np.reshape(source.ignored_lines, (-1, 2, 2)) * size,
        )  # fmt: skip
        frames: list[int] = []
        for frame in takewhile(lambda frame: end is None or frame.index < end, plate):
            signals.check()
            if frame.index < start:
                continue
            if not frames:
                _add_cues(solver, frame.picture, cues)
            luma = luma_of(frame.picture, size)
            if not frames:
                scale = _with_box(scale, luma)
            solver.add(luma, frame.time_s)
            if markers is not None and not markers.full:
                if square[0] > size[0]:
                    luma = luma_of(frame.picture, square)
                markers.add(luma)
            if pictures is not None and pictures.next_is_wanted():
                image = to_8_bit(frame.picture.shown(), _PICTURE_PX)
                pictures.keep(PlatePicture(frame.index, frame.time_s, image))
            frames.append(frame.index)
            on_progress(len(frames), info.frame_count)
    if not frames:
        raise UsageError(no_such_frames(source, info))
    camera = solver.solve()
    require_numbers(camera)
    camera = doubted_where_steep(camera, solver.segments)
    tracked = reproject(solver.seen, solver.times_s, camera)
    require_path(camera, tracked, frames)
    error = tracked.median_px
    method = f"{camera.method}{said}" if camera.fov == "metadata" else camera.method
    camera = replace(
        camera, width=square[0], height=square[1], method=method,
        reprojection_px=None if error is None else error / shrink,
    )  # fmt: skip
    camera = _in_metres(camera, scale, markers)
    keys = tuple(replace(key, index=frames[key.index]) for key in camera.keys)  # of the plate
    place, guessed = chosen_place(
        solver.seen.tracks(), solver.times_s, camera.resized(*size), solver.segments
    )
    camera = replace(camera, keys=keys, place=place, place_guessed=guessed)
    camera = camera.resized(info.width, info.height, info.pixel_aspect)
    stretch = np.array(_stretch(info))
    small = round(size[0] * stretch[0]), round(size[1] * stretch[1])
    camera = replace(camera, missed_lines=_missed_lines(source, solver))
    return Solved(
        camera,
        SolvedFrom(
            small, replace(solver.segments, ends=solver.segments.ends * stretch), solver.times_s
        ),
        replace(tracked, position=tracked.position * stretch),
        frames,
    )


def _missed_lines(source: SourceSettings, solver: ShotSolver) -> tuple[tuple[float, ...], ...]:
    """Segments whose lines the user would have ignored, and along which none is shown."""
    given = np.reshape(source.ignored_lines, (-1, 4)).tolist()
    return tuple(
        tuple(ends)
        for ends, one in zip(given, solver.ignored, strict=True)
        if not solver.shown.along(one, solver.size[0]).any()
    )


def _stretch(info: SourceInfo) -> tuple[float, float]:
    """Columns and rows of a plate by those that it has with square pixels, reduced [1]."""
    return max(1.0, 1.0 / info.pixel_aspect), max(1.0, info.pixel_aspect)


def _square_size(info: SourceInfo) -> tuple[int, int]:
    """Columns and rows of a plate with square pixels, reduced: a solve takes pixels for square."""
    across, down = _stretch(info)
    return max(1, round(info.width / across)), max(1, round(info.height / down))


def require_numbers(solved: SolvedCamera) -> None:
    """Refuse a camera with a number that is not finite, which no file can hold.

    Raises:
        InputError: it has one.
    """
    errors = solved.errors
    numbers = [errors.fov_deg, errors.pitch_deg, errors.roll_deg, solved.distortion_k1]
    for key in solved.keys:
        numbers += [key.fov_x_deg, *key.world_to_camera.ravel()]
    if np.isfinite(numbers).all():
        return
    raise InputError(
        "the plate's camera came out without finite numbers: its points contradict each other; "
        "give --camera-from, or another part by --range"
    )


def require_path(solved: SolvedCamera, tracked: Reprojection, frames: Sequence[int]) -> None:
    """Refuse a path that does not explain what was seen.

    Args:
        solved: the cameras.
        tracked: points, at the size of the solved camera.
        frames: of the plate that were solved.

    Raises:
        InputError: the camera moves, and half of the points or more are elsewhere.
    """
    off = tracked.median_px
    if solved.path == "still" or off is None or off <= _MOST_OFF * solved.width:
        return
    raise InputError(
        "the camera seems to move, but no path explains its points: half of them are seen over "
        f"{_MOST_OFF:.1%} of the width beside it; {_followed(solved, tracked, frames)}; leave "
        "these frames out by --range, or give --camera-from"
    )


def _followed(solved: SolvedCamera, tracked: Reprojection, frames: Sequence[int]) -> str:
    """What a wrong path was found from: the middle of the points on it, and their frames."""
    held = tracked.error_px < _MOST_OFF * solved.width
    if not held.any():
        return "most of the picture moves by itself"
    column, row = np.median(tracked.position[held], axis=0) / (solved.width, solved.height)
    shown = tracked.frame[held]
    return (
        f"it follows what is about {column:.0%} from the left and {row:.0%} from above on frames "
        f"{frames[shown.min()]} to {frames[shown.max()]}, and most else in the picture does not"
    )


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


def _known(info: SourceInfo, fov_deg: float | None) -> tuple[KnownFov | None, str]:
    """The field of view that the user or the file gives, and which says so; None for neither."""
    if fov_deg is not None:
        focal = 0.5 / math.tan(0.5 * math.radians(fov_deg))
        given = KnownFov(focal=focal, error=_GIVEN_ERROR, given=True)
        return given, f"; {GIVEN_FOV} {fov_deg:g}"
    found = tagged_focal(info)
    if found is None:
        return None, ""
    diagonal = math.hypot(1.0, info.height / (info.width * info.pixel_aspect))
    focal = found.equivalent_mm / FULL_FRAME_DIAGONAL_MM * diagonal
    said = f"; field of view by the recording's {found.tag}, {found.equivalent_mm:.4g} mm"
    return KnownFov(focal=focal, error=found.error, given=False), said


def _add_cues(solver: ShotSolver, first: Picture, cues: Collection[Cue]) -> None:
    """Let the solver read the plate's first picture where it asks for it."""
    small = cv2.resize(first.srgb(), solver.size, interpolation=cv2.INTER_AREA)
    rgb = np.asarray(small, np.float32)
    if "blur" in cues:
        solver.coc = partial(_coc, rgb)
    if "picture" in cues:
        solver.picture = partial(_picture_cue, rgb)


def _coc(rgb: Float32) -> CocMap:
    """The blur of a picture (H, W, 3), sRGB in [0, 1]."""
    with OnnxCocNetwork(find_model("coc").path) as network:
        return estimate_coc(network, rgb)


def _picture_cue(rgb: Float32) -> PictureCue:
    """What a picture (H, W, 3), sRGB in [0, 1], looks like it was taken by."""
    return picture_cue(OnnxCameraNetwork(find_model("camera").path), rgb)
