"""The command `place`: a contact sheet of nine placements of an object without a camera.

They lie on the ground of the plate's solved camera, or under a horizon that is given.
"""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import cv2
import numpy as np
import numpy.typing as npt
from msgspec import Struct
from msgspec.structs import replace

from nlens_video.cameras.files import read_camera
from nlens_video.cameras.placed import default_placement, place_on_ground
from nlens_video.cameras.placement import contact_point, place_camera
from nlens_video.cameras.solved import SolvedCamera
from nlens_video.cli.placement_choices import Choice, choices, choices_on_ground
from nlens_video.core.errors import InputError, SceneError, UsageError
from nlens_video.core.layers import Box, Float32, Float64
from nlens_video.core.placement import (
    ASSUMED_FOCAL_MM,
    Placement,
    focal_of_fov,
    fov_of_focal,
)
from nlens_video.core.settings import ObjectSettings, SourceSettings
from nlens_video.options import to_settings
from nlens_video.report.ground_grid import Grid, draw_grid, draw_horizon
from nlens_video.run.frame_range import FrameRange
from nlens_video.run.plate_source import no_such_frames
from nlens_video.scene.camera import Camera
from nlens_video.scene.scene import Scene
from nlens_video.video.atomic_files import check_folder, replacing
from nlens_video.video.focal_length import tagged_focal
from nlens_video.video.info import SourceFrame, SourceInfo
from nlens_video.video.input.open import can_be_read_again
from nlens_video.video.input.source import open_source
from nlens_video.video.pixels.picture import ArrayPicture

if TYPE_CHECKING:
    from nlens_video.cli.console import Console
    from nlens_video.render.base.box_renderer import BoxRenderer

_LONG_SIDE = 480  # of a choice [px]
_ASSUMED_HORIZON = 0.4  # where neither an option nor the plate tells it [frame height]
_ACROSS = 3  # choices side by side
_UNSEEN = "no ground there, or it reaches behind the camera"
_FONT, _LINE_HEIGHT, _LEFT = 0.42, 19, 6  # of the captions: OpenCV's scale, [px], [px]
_CELLS = 4  # of the ground grid each way, in heights of the object
_LINE, _PAPER, _INK = (255, 200, 60), 24, (235, 235, 235)  # BGR

Bgr = npt.NDArray[np.uint8]


def run_place(args: Namespace, console: Console) -> int:
    """The command `place`."""
    source = to_settings.source_settings(args)
    objects, start = to_settings.place_settings(args)
    _check_sheet(args.output)
    solved = None
    if args.horizon is None:
        solved = _solved(source, objects, console)
    elif objects.camera_from is not None:
        raise UsageError("--camera-from gives the horizon; leave --horizon out")
    if solved is not None:
        chosen = default_placement(solved)
        start = replace(start, at=args.at or chosen.at, size=args.size or chosen.size)
    elif start.horizon is None:
        start = replace(start, horizon=_ASSUMED_HORIZON)
    options = write_contact_sheet(
        source, objects, start, args.output, solved=solved, grid=not args.no_grid
    )
    console.choices(args.output, options)
    return 0


def _solved(
    source: SourceSettings, objects: ObjectSettings, console: Console
) -> SolvedCamera | None:
    """The plate's camera, from its file or its pictures; None where neither tells the ground."""
    if objects.camera_from is not None:
        with open_source(source.spec, **source.hints) as opened:
            info = opened.info
        size = info.width, info.height
        return read_camera(
            objects.camera_from, size, info.average_rate, info.time_base, info.pixel_aspect
        )
    if not can_be_read_again(source.spec):
        return None
    with open_source(source.spec, **source.hints):
        pass  # what cannot be read is an error; only what cannot be solved has a horizon assumed
    from nlens_video.cli.solve_command import plate_camera

    try:
        solved = plate_camera(source, objects.fov_deg, console)
        default_placement(solved)
    except (InputError, SceneError) as error:
        console.note(f"{error}; the choices assume a horizon")
        return None
    return solved


def _check_sheet(output: Path) -> None:
    if output.suffix.lower() != ".png":
        raise UsageError(f"{output}: the contact sheet is a PNG; name it OUT.png")
    check_folder(output)


def write_contact_sheet(
    source: SourceSettings, objects: ObjectSettings, start: Placement, output: Path, *,
    solved: SolvedCamera | None = None, grid: bool = True,
) -> tuple[str, ...]:  # fmt: skip
    """Draw the sharp object on the plate's first frame in nine placements, each with its options.

    Args:
        source: the plate.
        objects: the object.
        start: the placement that is varied.
        output: the contact sheet, a PNG.
        solved: the plate's camera, None for one under the horizon of `start`.
        grid: whether the ground's grid is drawn.

    Returns:
        The options that repeat each choice, in the order of their numbers.

    Raises:
        UsageError: the range holds no frame.
        InputError: the plate cannot be read.
        SceneError: the GLB cannot be used.
        OutputError: the sheet cannot be written.
    """
    scene = Scene.load(objects.glb, objects.playback, objects.scene)
    plate, focal, time_s = _first_frame(source)
    size = (plate.shape[1], plate.shape[0])
    focal = focal or ASSUMED_FOCAL_MM
    if solved is None:
        shown = choices(start, objects.fov_deg, fov_of_focal(focal, size))
    else:
        shown = choices_on_ground(start, objects.fov_deg)
    options = [choice.options(objects) for choice in shown]
    vertices = scene.pose(0.0).vertices()
    stand = _Stand(
        vertices, contact_point(vertices, objects.ground_y), plate, focal, solved, time_s, grid
    )
    sheet = _drawn(scene, stand, shown, options)
    _, encoded = cv2.imencode(output.suffix, sheet)  # imwrite takes names in UTF-8 alone
    with replacing(output) as partial:
        partial.write_bytes(encoded.tobytes())
    return tuple(" ".join(one) for one in options)


def _first_frame(source: SourceSettings) -> tuple[Bgr, float | None, float]:
    """The plate as small as a choice (H, W, 3), its 35 mm equivalent focal length, its time [s]."""
    with open_source(source.spec, **source.hints) as opened:
        for item in FrameRange(opened, source.frames).items():
            if isinstance(item, SourceFrame):
                found = tagged_focal(opened.info)
                focal = None if found is None else found.equivalent_mm
                return _shrunk(item.picture.srgb(), opened.info), focal, item.time_s
        raise UsageError(no_such_frames(source, opened.info))


def _shrunk(srgb: Float32, info: SourceInfo) -> Bgr:
    """The picture with square pixels, no side longer than a choice's."""
    wide, high = info.width * info.pixel_aspect, float(info.height)
    scale = min(1.0, _LONG_SIDE / max(wide, high))
    size = (max(1, round(wide * scale)), max(1, round(high * scale)))
    small = cv2.resize(srgb, size, interpolation=cv2.INTER_AREA)
    return np.ascontiguousarray(np.round(255.0 * small[..., ::-1]).clip(0, 255).astype(np.uint8))


def _drawn(
    scene: Scene, stand: _Stand, shown: Sequence[Choice], options: Sequence[tuple[str, ...]]
) -> Bgr:
    from nlens_video.render.select import choose_renderer

    width = stand.plate.shape[1]
    with choose_renderer(scene) as renderer:
        drawn = [stand.choice(choice, renderer) for choice in shown]
    texts = [
        _lines(number, one, width) if seen else [f"{number}  {_UNSEEN}"]
        for number, (one, (_, seen)) in enumerate(zip(options, drawn, strict=True), start=1)
    ]
    height = max(map(len, texts))
    cells = [
        np.vstack([picture, _caption(width, text, height)])
        for (picture, _), text in zip(drawn, texts, strict=True)
    ]
    return np.vstack([np.hstack(cells[at : at + _ACROSS]) for at in range(0, len(cells), _ACROSS)])


class _Stand(Struct, frozen=True):
    """What all placements share: object, plate, its camera where it is solved."""

    vertices: Float32
    contact: Float64
    plate: Bgr
    focal: float
    solved: SolvedCamera | None
    time_s: float
    grid: bool

    def choice(self, choice: Choice, renderer: BoxRenderer) -> tuple[Bgr, bool]:
        """Plate with grid, horizon and object; False where the object cannot stand there."""
        picture = self.plate.copy()
        try:
            camera = self._camera(choice)
        except (SceneError, UsageError):
            return picture, False
        if self.grid:
            spacing = float(np.ptp(self.vertices[:, 1])) or 1.0
            draw_horizon(picture, camera, None, _LINE)
            draw_grid(picture, camera, Grid(self.contact, spacing, _CELLS), _LINE)
        self._draw_object(picture, camera, renderer)
        return picture, True

    def _camera(self, choice: Choice) -> Camera:
        size = (self.plate.shape[1], self.plate.shape[0])
        if self.solved is not None:
            cameras = place_on_ground(
                self.vertices, self.contact, choice.placing, self.solved, self.time_s
            )
            return cameras.at(self.time_s).resized(*size)
        focal = self.focal if choice.fov_deg is None else focal_of_fov(choice.fov_deg, size)
        return place_camera(self.vertices, self.contact, choice.placing, focal, size)

    def _draw_object(self, picture: Bgr, camera: Camera, renderer: BoxRenderer) -> None:
        layer = renderer.render(0.0, camera)
        if layer is None:
            return
        inside = layer.box.intersection(Box(0, 0, camera.width, camera.height))
        rows, columns = inside.slices_in(layer.box)
        ArrayPicture(picture).composite_over(
            inside, np.ascontiguousarray(layer.rgba[rows, columns])
        )


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
