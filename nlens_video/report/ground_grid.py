"""The ground as a camera sees it, drawn over a picture: a square grid, and the horizon."""

from __future__ import annotations

import math
from collections.abc import Iterator

import cv2
import numpy as np
from msgspec import Struct

from nlens_video.cameras.solved import CameraErrors, SolvedCamera
from nlens_video.core.layers import Float64
from nlens_video.report.html import Image
from nlens_video.report.svg import nice_step
from nlens_video.scene.camera import Camera

Color = tuple[int, int, int]

GRID_COLOR: Color = (60, 220, 255)
HORIZON_COLOR: Color = (255, 170, 40)
_CELLS = 10  # of the grid, each way from its middle
_DOWN = 0.62  # of the way from the horizon, or the frame's top, to the lower border
_NEAREST = 0.02  # of the grid's size: what is nearer to the camera is not drawn
_FARTHEST_PX = 1e5  # from the frame: keeps whole numbers small
_BITS = 3  # of a fraction of a pixel


class Grid(Struct, frozen=True, eq=False):
    """A square grid on a horizontal ground.

    Attributes:
        middle: point of the ground (3,) [scene unit].
        spacing: of its lines [scene unit].
        cells: each way from the middle [1].
    """

    middle: Float64
    spacing: float
    cells: int = _CELLS

    def lines(self) -> Iterator[Float64]:
        """First and last point of each line (2, 3), along x and along z."""
        reach = self.cells * self.spacing
        for offset in np.arange(-self.cells, self.cells + 1) * self.spacing:
            for one, other in (((offset, -reach), (offset, reach)),
                               ((-reach, offset), (reach, offset))):  # fmt: skip
                yield self.middle + np.array([[one[0], 0.0, one[1]], [other[0], 0.0, other[1]]])


def grid_in_view(camera: Camera, ground_y: float) -> Grid | None:
    """A grid on the ground that a camera sees; None where it sees none.

    Its lines pass below the world's origin, so that it is the same grid for all frames of a shot.
    """
    column = 0.5 * camera.width
    top = min(max(horizon_row(camera, column), 0.0), float(camera.height))
    row = top + _DOWN * (camera.height - top)
    points, depths = camera.ground_seen_at(np.array([[column, row]]), ground_y)
    at, distance = points[0], float(depths[0])
    if not distance > 0.0 or camera.height - top < 0.02 * camera.height:
        return None
    spacing = nice_step(0.2 * distance)
    x, z = (spacing * round(float(at[axis]) / spacing) for axis in (0, 2))
    return Grid(np.array([x, ground_y, z]), spacing)


def horizon_row(camera: Camera, column: float) -> float:
    """Row of the horizon in a column; infinite where the camera looks straight up or down [px]."""
    right, up, back = camera.world_from_camera[1, :3]
    if abs(up) < 1e-9:
        return -math.inf if back > 0.0 else math.inf
    return float(camera.cy + camera.fy * (right * (column - camera.cx) / camera.fx - back) / up)


def draw_grid(image: Image, camera: Camera, grid: Grid, color: Color = GRID_COLOR) -> None:
    """Draw a grid into a picture.

    Args:
        image: (H, W, 3), changed.
        camera: of the picture, at its size.
        grid: the lines.
        color: of the picture's channel order.
    """
    ends = [one for line in grid.lines() if (one := part_in_view(camera, grid, line)) is not None]
    _draw(image, ends, color)


def draw_horizon(
    image: Image, camera: Camera, errors: CameraErrors | None, color: Color = HORIZON_COLOR
) -> None:
    """Draw the horizon, with the band in which it lies by its standard errors.

    Args:
        image: (H, W, 3), changed.
        camera: of the picture, at its size.
        errors: of pitch and roll, None for no band.
        color: of the picture's channel order.
    """
    columns = np.linspace(0.0, camera.width, 33)
    rows = np.array([horizon_row(camera, column) for column in columns])
    if not np.isfinite(rows).all():
        return
    if errors is not None:
        away = np.hypot(columns - camera.cx, rows - camera.cy) / camera.fy
        pitch = camera.fy * (1.0 + away**2) * math.tan(math.radians(min(errors.pitch_deg, 45.0)))
        roll = (columns - camera.cx) * math.tan(math.radians(min(errors.roll_deg, 45.0)))
        half = np.hypot(pitch, roll)
        outline = np.concatenate([
            np.column_stack([columns, rows - half]),
            np.column_stack([columns, rows + half])[::-1],
        ])  # fmt: skip
        band = image.copy()
        cv2.fillPoly(band, [_fixed(outline)], color, cv2.LINE_AA, _BITS)
        cv2.addWeighted(band, 0.25, image, 0.75, 0.0, dst=image)
    line = np.array([[columns[0], rows[0]], [columns[-1], rows[-1]]])
    _draw(image, [line], color)


def over_plate(image: Image, solved: SolvedCamera, time_s: float, grid: Grid | None) -> Image:
    """A copy of a plate's picture with grid and horizon, at whatever size it has.

    Args:
        image: sRGB (H, W, 3).
        solved: the plate's cameras.
        time_s: time of the picture [s].
        grid: in the solved world, None for the horizon alone.
    """
    drawn = np.ascontiguousarray(image).copy()
    camera = solved.at(time_s).resized(image.shape[1], image.shape[0])
    draw_horizon(drawn, camera, solved.errors)
    if grid is not None:
        draw_grid(drawn, camera, grid)
    return drawn


def part_in_view(camera: Camera, grid: Grid, line: Float64) -> Float64 | None:
    """Ends (2, 2) of the part of a line that lies before the camera [px]."""
    ends = camera.to_camera(line)
    near = _NEAREST * grid.spacing * grid.cells
    beyond = -ends[:, 2] - near
    if (beyond <= 0.0).all():
        return None
    if (beyond <= 0.0).any():
        first, last = ends[np.argsort(-beyond)]
        share = beyond.max() / (beyond.max() - beyond.min())
        ends = np.array([first, first + share * (last - first)])
    return np.asarray(camera.pixels(ends).clip(-_FARTHEST_PX, _FARTHEST_PX))


def _draw(image: Image, lines: list[Float64], color: Color) -> None:
    """Lines with a dark edge, so that they show on any ground; thicker in large pictures."""
    thin = max(1, round(image.shape[1] / 640))
    for shade, thickness, share in (((0, 0, 0), thin + 2, 0.45), (color, thin, 0.9)):
        over = image.copy()
        for line in lines:
            first, last = (tuple(end) for end in _fixed(line).tolist())
            cv2.line(over, first, last, shade, thickness, cv2.LINE_AA, _BITS)
        cv2.addWeighted(over, share, image, 1.0 - share, 0.0, dst=image)


def _fixed(points: Float64) -> np.typing.NDArray[np.int32]:
    """Positions (N, 2), pixel centres at +0.5, as OpenCV's fixed-point numbers."""
    return np.asarray(np.round((points - 0.5) * (1 << _BITS)), np.int32)
