"""The command `place`: a contact sheet of nine placements of an object without a camera."""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import cv2
import numpy as np
import numpy.typing as npt

from nlens_video.cameras.placement import contact_point, place_camera
from nlens_video.core.errors import OutputError, SceneError, UsageError
from nlens_video.core.layers import Box, Float32, Float64
from nlens_video.core.placement import (
    ASSUMED_FOCAL_MM,
    Placement,
    focal_35mm,
    focal_of_fov,
    fov_of_focal,
)
from nlens_video.core.settings import ALL, ObjectSettings, SourceSettings
from nlens_video.run.frame_range import FrameRange
from nlens_video.scene.camera import Camera
from nlens_video.scene.scene import Scene
from nlens_video.video.atomic_files import check_folder, replacing
from nlens_video.video.info import SourceFrame, SourceInfo
from nlens_video.video.input.source import open_source
from nlens_video.video.pixels.picture import ArrayPicture

if TYPE_CHECKING:
    from nlens_video.render.base.box_renderer import BoxRenderer

_LONG_SIDE = 480  # of a choice [px]
_ACROSS = 3  # choices side by side
_FONT, _LINE_HEIGHT, _LEFT = 0.42, 19, 6  # of the captions: OpenCV's scale, [px], [px]
_GRID = np.arange(-4, 5)  # lines of the ground grid, in heights of the object
_LINE, _PAPER, _INK = (255, 200, 60), 24, (235, 235, 235)  # BGR

Bgr = npt.NDArray[np.uint8]


def write_contact_sheet(
    source: SourceSettings, objects: ObjectSettings, start: Placement, output: Path
) -> tuple[str, ...]:
    """Draw the sharp object on the plate's first frame in nine placements, each with its options.

    Args:
        source: the plate.
        objects: the object.
        start: the placement that is varied.
        output: the contact sheet, a PNG.

    Returns:
        The options that repeat each choice, in the order of their numbers.

    Raises:
        UsageError: the sheet is no PNG, or the range holds no frame.
        InputError: the plate cannot be read.
        SceneError: the GLB cannot be used.
        OutputError: the sheet cannot be written.
    """
    if output.suffix.lower() != ".png":
        raise UsageError(f"{output}: the contact sheet is a PNG; name it OUT.png")
    check_folder(output)
    scene = Scene.load(objects.glb, objects.playback, objects.scene)
    plate, focal = _first_frame(source)
    size = (plate.shape[1], plate.shape[0])
    focal = focal or ASSUMED_FOCAL_MM
    shown = choices(start, objects.fov_deg, fov_of_focal(focal, size))
    options = [choice.options(objects) for choice in shown]
    sheet = _drawn(scene, plate, focal, objects.ground_y, shown, options)
    with replacing(output) as partial:
        if not cv2.imwrite(str(partial), sheet):
            raise OutputError(f"{output}: cannot be written; is the disk full?")
    return tuple(" ".join(one) for one in options)


def _first_frame(source: SourceSettings) -> tuple[Bgr, float | None]:
    """The plate as small as a choice (H, W, 3), and its 35 mm equivalent focal length."""
    with open_source(source.spec, **source.hints) as opened:
        for item in FrameRange(opened, source.frames).items():
            if isinstance(item, SourceFrame):
                return _shrunk(item.picture.srgb(), opened.info), focal_35mm(opened.info.metadata)
    raise UsageError(f"--range {source.frames[0]}:{source.frames[1] or ''}: no such frames")


def _shrunk(srgb: Float32, info: SourceInfo) -> Bgr:
    """The picture with square pixels, no side longer than a choice's."""
    wide, high = info.width * info.pixel_aspect, float(info.height)
    scale = min(1.0, _LONG_SIDE / max(wide, high))
    size = (max(1, round(wide * scale)), max(1, round(high * scale)))
    small = cv2.resize(srgb, size, interpolation=cv2.INTER_AREA)
    return np.ascontiguousarray(np.round(255.0 * small[..., ::-1]).clip(0, 255).astype(np.uint8))


def _drawn(
    scene: Scene, plate: Bgr, focal: float, ground_y: float | None, shown: Sequence[Choice],
    options: Sequence[tuple[str, ...]],
) -> Bgr:  # fmt: skip
    from nlens_video.render.select import choose_renderer

    vertices = scene.pose(0.0).vertices()
    ground = contact_point(vertices, ground_y)
    width = plate.shape[1]
    with choose_renderer(scene) as renderer:
        stand = _Stand(vertices, ground, plate, focal, renderer)
        drawn = [stand.choice(choice) for choice in shown]
    texts = [
        _lines(number, one, width) if seen else [f"{number}  reaches behind the camera"]
        for number, (one, (_, seen)) in enumerate(zip(options, drawn, strict=True), start=1)
    ]
    height = max(map(len, texts))
    cells = [
        np.vstack([picture, _caption(width, text, height)])
        for (picture, _), text in zip(drawn, texts, strict=True)
    ]
    return np.vstack([np.hstack(cells[at : at + _ACROSS]) for at in range(0, len(cells), _ACROSS)])


@dataclass(frozen=True, slots=True)
class _Stand:
    """What all placements share: object, plate and renderer."""

    vertices: Float32
    contact: Float64
    plate: Bgr
    focal: float
    renderer: BoxRenderer

    def choice(self, choice: Choice) -> tuple[Bgr, bool]:
        """Plate with grid, horizon and object; False where the object reaches behind the camera."""
        picture = self.plate.copy()
        size = (picture.shape[1], picture.shape[0])
        focal = self.focal if choice.fov_deg is None else focal_of_fov(choice.fov_deg, size)
        try:
            camera = place_camera(self.vertices, self.contact, choice.placing, focal, size)
        except SceneError:
            return picture, False
        self._draw_ground(picture, camera, choice.placing)
        self._draw_object(picture, camera)
        return picture, True

    def _draw_ground(self, picture: Bgr, camera: Camera, placing: Placement) -> None:
        height, width = picture.shape[:2]
        row = round(placing.horizon_row * height)
        cv2.line(picture, (0, row), (width, row), _LINE, 1)
        for line in _grid_lines(self.contact, float(np.ptp(self.vertices[:, 1])) or 1.0):
            seen = camera.to_camera(line)
            before = seen[:, 2] < -1e-3 * float(-seen[:, 2].min())
            spots = camera.pixels(np.where(before[:, None], seen, [0.0, 0.0, -1.0]))
            whole = np.round(spots.clip(-1e4, 1e4)).astype(int)
            for here in np.flatnonzero(before[:-1] & before[1:]):
                ends = tuple(whole[here].tolist()), tuple(whole[here + 1].tolist())
                cv2.line(picture, *ends, _LINE, 1, cv2.LINE_AA)

    def _draw_object(self, picture: Bgr, camera: Camera) -> None:
        layer = self.renderer.render(0.0, camera)
        if layer is None:
            return
        inside = layer.box.intersection(Box(0, 0, camera.width, camera.height))
        rows, columns = inside.slices_in(layer.box)
        ArrayPicture(picture).composite_over(
            inside, np.ascontiguousarray(layer.rgba[rows, columns])
        )


def _grid_lines(contact: Float64, spacing: float) -> Iterator[Float64]:
    """Lines (N, 3) of a square grid on the ground round a point."""
    along = np.linspace(_GRID[0], _GRID[-1], 33)
    for offset in _GRID:
        across = np.full_like(along, offset)
        for x, z in ((along, across), (across, along)):
            yield contact + spacing * np.stack([x, np.zeros_like(x), z], axis=1)


def _lines(number: int, options: tuple[str, ...], width: int) -> list[str]:
    """The caption in lines no wider than the picture; an option stays with its value."""
    lines = [f"{number} "]
    for word in options:
        if len(lines[-1]) > 2 and _wide(f"{lines[-1]} {word}") > width - 2 * _LEFT:
            lines.append("  ")
        lines[-1] += f" {word}"
    return lines


def _wide(line: str) -> int:
    return int(cv2.getTextSize(line, cv2.FONT_HERSHEY_SIMPLEX, _FONT, 1)[0][0])


def _caption(width: int, lines: list[str], height: int) -> Bgr:
    caption = np.full((8 + _LINE_HEIGHT * height, width, 3), _PAPER, np.uint8)
    for number, line in enumerate(lines):
        spot = (_LEFT, 17 + _LINE_HEIGHT * number)
        cv2.putText(caption, line, spot, cv2.FONT_HERSHEY_SIMPLEX, _FONT, _INK, 1, cv2.LINE_AA)
    return caption


_HORIZON_STEP, _SIZE_FACTOR, _YAW_STEP = 0.12, 1.5, 45.0
_LENS_FACTOR = 0.5  # of the field of view: a longer lens, from farther away [1]


@dataclass(frozen=True, slots=True)
class Choice:
    """A placement and the field of view that it is seen with.

    Attributes:
        placing: where the object stands.
        fov_deg: across the frame, None for the plate's own or the assumed one [deg].
    """

    placing: Placement
    fov_deg: float | None

    def options(self, scene: ObjectSettings) -> tuple[str, ...]:
        """The options that repeat it, each with its value.

        Args:
            scene: the object; its options are the same for all choices.
        """
        played = scene.playback
        fov = None if self.fov_deg is None else f"{self.fov_deg:.4g}"
        given = (
            ("--fov", fov),
            ("--ground-y", None if scene.ground_y is None else f"{scene.ground_y:g}"),
            ("--scene", scene.scene),
            ("--animation", None if played.animation == ALL else played.animation),
            ("--animation-speed", None if played.speed == 1.0 else f"{played.speed:g}"),
            ("--animation-offset", None if played.offset_s == 0.0 else f"{played.offset_s:g}"),
        )
        place = self.placing.describe().split(" --")
        return (
            place[0],
            *(f"--{option}" for option in place[1:]),
            *(f"{name} {shlex.quote(value)}" for name, value in given if value is not None),
            *(["--loop"] if played.loop else []),
        )


def choices(start: Placement, fov_deg: float | None, assumed_fov_deg: float) -> tuple[Choice, ...]:
    """Nine choices: the given one first; then horizon, size, turn and lens changed by a step.

    Args:
        start: the placement that is varied.
        fov_deg: field of view that `--fov` gives, else None [deg].
        assumed_fov_deg: what it is else [deg].
    """
    lowest = 0.5 * (start.horizon_row + start.at[1])  # a horizon must lie above the contact point
    horizons = (start.horizon_row - _HORIZON_STEP, min(start.horizon_row + _HORIZON_STEP, lowest))
    sizes = (start.size / _SIZE_FACTOR, start.size * _SIZE_FACTOR)
    yaws = (start.yaw_deg - _YAW_STEP, start.yaw_deg + _YAW_STEP, start.yaw_deg + 180.0)
    places = (
        start,
        *(replace(start, horizon=horizon) for horizon in horizons),
        *(replace(start, yaw_deg=yaw) for yaw in yaws),
        *(replace(start, size=size) for size in sizes),
    )
    longer = _LENS_FACTOR * (assumed_fov_deg if fov_deg is None else fov_deg)
    return (*(Choice(place, fov_deg) for place in places), Choice(start, longer))
