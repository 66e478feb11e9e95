"""Interface of a renderer's drawing back end: view, depth peeling, pictures, loss."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Protocol

import numpy as np
from msgspec import Struct

from nlens_video.core.errors import SceneError
from nlens_video.core.layers import Box, Float32, Float64, Int64
from nlens_video.render.base.shader_inputs import Lighting
from nlens_video.scene.camera import Camera
from nlens_video.scene.gltf.meshes import Int32
from nlens_video.scene.posed import PosedMesh, PosedScene
from nlens_video.scene.screen_projection import extent

# Nearest depth that is drawn, as a share of the farthest. Of surfaces at the farthest depth, a
# float32 depth buffer tells those apart that differ by about 1e-7 / share of it.
_LEAST_SHARE = 1e-5  # where all is before the camera
_LEAST_THROUGH_SHARE, _MOST_THROUGH_SHARE = 1e-4, 1e-3  # where something reaches behind it
_ALL = 2.0  # window depth beyond everything
_SAME_PLACE = 1e-8  # vertices as close as this are one [size of the mesh]


class ViewSetup(Struct, frozen=True, kw_only=True, eq=False):
    """The object at one moment, its light, and the view of one picture.

    Attributes:
        posed: the object.
        lighting: what lights it.
        camera: where from, on which frame.
        box: the part of the frame, perhaps beyond its borders.
        near: depth of the near plane [scene unit].
        far: a depth beyond the object's [scene unit].
        nearest: whether depth may be that of a pixel's nearest sample, which is quicker.
    """

    posed: PosedScene
    lighting: Lighting
    camera: Camera
    box: Box
    near: float
    far: float
    nearest: bool


def view_setup(
    posed: PosedScene, lighting: Lighting, camera: Camera, margin: int, *, nearest: bool
) -> ViewSetup | None:
    """The box that the object covers, with near and far depth; None if it is out of view."""
    seen = extent(posed, camera)
    lowest, highest = seen.nearest, seen.farthest
    if not (math.isfinite(lowest) and math.isfinite(highest)):
        raise SceneError("the object has no finite size at this time; check its scale")
    far = highest * (1.0 + 1e-4)
    if not far > 0.0:
        return None
    lowest *= 1.0 - 1e-4
    near = max(lowest, _LEAST_SHARE * far) if lowest > 0.0 else _near_through(posed, camera, far)
    limit = Box(0, 0, camera.width, camera.height).expanded(margin)
    box = limit
    if lowest >= near:  # else a triangle may cross the near plane and cover anything
        box = _screen_box(seen.low, seen.high, limit)
    if box.empty:
        return None
    return ViewSetup(
        posed=posed, lighting=lighting, camera=camera, box=box, near=near, far=far, nearest=nearest
    )


def _near_through(posed: PosedScene, camera: Camera, far: float) -> float:
    """Depth of the near plane where something reaches behind the camera [scene unit].

    What lies there may be out of view, and far things no reason to cut near ones: the nearest
    vertex before the camera is drawn, unless it is much nearer than all others.
    """
    depth = -camera.to_camera(posed.vertices().astype(np.float64))[:, 2]
    nearest = float(depth[depth > 0.0].min(initial=far)) * (1.0 - 1e-4)
    return min(max(nearest, _LEAST_THROUGH_SHARE * far), _MOST_THROUGH_SHARE * far)


def _screen_box(low: tuple[float, float], high: tuple[float, float], limit: Box) -> Box:
    """Whole pixels around a range of positions, one more on each side, inside `limit`."""
    x0, y0 = (math.floor(min(max(v, -1e9), 1e9)) - 1 for v in low)
    x1, y1 = (math.ceil(min(max(v, -1e9), 1e9)) + 1 for v in high)
    return Box(x0, y0, x1, y1).intersection(limit)


class FrontSurfaces(Struct, frozen=True, kw_only=True, eq=False):
    """Nearest surfaces of a picture, on the region that is peeled.

    Attributes:
        depth: of them (height, width), +inf where nothing is [scene unit].
        disparity_step: how much less disparity what lies behind them has, > 0 [1 / scene unit].
        corner: column and row of the other picture's first pixel in this one [px].
    """

    depth: Float32
    disparity_step: float
    corner: tuple[int, int]

    def step(self, near: float, far: float) -> float:
        """The step as window depth, which is affine in disparity."""
        return self.disparity_step * near * far / (far - near)

    def limit(self, near: float, far: float) -> Float32:
        """Window depth (height, width) from which a surface lies behind; beyond all where none."""
        there = np.isfinite(self.depth)
        disparity = np.divide(1.0, self.depth, where=there, out=np.zeros(there.shape))
        window = (1.0 - near * disparity) * (far / (far - near)) + self.step(near, far)
        return np.where(there, window, _ALL).astype(np.float32)

    def most_disparity(self) -> Float32:
        """Disparity (height, width) up to which a surface lies behind; 0 where nothing does."""
        there = np.isfinite(self.depth)
        disparity = np.divide(1.0, self.depth, where=there, out=np.zeros(there.shape))
        return np.maximum(disparity - self.disparity_step, 0.0).astype(np.float32)


class BehindPicture(Struct, frozen=True, kw_only=True, eq=False):
    """What a picture's nearest surface hides.

    Attributes:
        rgba: premultiplied linear colour and alpha (height, width, 4).
        depth: along the optical axis (height, width), +inf where nothing is [scene unit].
        front_rgba: what the nearest surface alone gives to each pixel (height, width, 4).
    """

    rgba: Float32
    depth: Float32
    front_rgba: Float32


def closed_bodies(meshes: Sequence[PosedMesh]) -> list[bool]:
    """Whether each mesh is watertight with outward faces, alone or all of them together.

    Exporters mark most materials double-sided, also those of closed bodies, whose inner side depth
    peeling would otherwise find behind the front.

    Args:
        meshes: of one moment; they touch at the same places at all times.
    """
    parts = [(mesh.positions, _outward(mesh)) for mesh in meshes]
    starts = np.cumsum([0] + [len(positions) for positions, _ in parts])
    together = (
        np.concatenate([positions for positions, _ in parts]),
        np.concatenate([faces + start for (_, faces), start in zip(parts, starts, strict=False)]),
    )
    if len(parts) > 1 and _closes(*together):
        return [True] * len(parts)
    return [_closes(*part) for part in parts]


def _outward(mesh: PosedMesh) -> Int32:
    return mesh.faces[:, ::-1] if mesh.mirrored else mesh.faces


def _closes(positions: Float32, faces: Int32) -> bool:
    """Whether triangles bound a volume: two on each edge, in opposite directions, outwards."""
    size = float(np.abs(positions).max(initial=0.0))
    if not 0.0 < size < np.inf:
        return False
    # positions in units of the size, by a power of two, which is exact
    places = np.ldexp(positions.astype(np.float64), -math.frexp(size)[1])
    corners = _merged(places)[faces]
    # exporters put degenerate triangles (two equal corners) at the poles of a sphere
    flat = (corners == np.roll(corners, 1, axis=1)).any(axis=1)
    start, end = corners[~flat].ravel(), np.roll(corners[~flat], -1, axis=1).ravel()
    there, back = (
        np.sort(one * len(places) + other) for one, other in ((start, end), (end, start))
    )
    if not np.array_equal(there, back) or (there[1:] == there[:-1]).any():
        return False
    first, second, third = np.moveaxis(places[faces[~flat]], 1, 0)
    return float(np.einsum("ij,ij->", first, np.cross(second, third))) > 0.0


def _merged(places: Float64) -> Int64:
    """Number (V,) of each vertex (V, 3), the same for those at one place."""
    steps = np.round(places / _SAME_PLACE).astype(np.int64)
    order = np.lexsort(steps.T)
    new = (np.diff(steps[order], axis=0) != 0).any(axis=1)
    number = np.empty(len(places), np.int64)
    number[order] = np.concatenate([[0], np.cumsum(new)])
    return number


class DrawerLostError(Exception):
    """The back end and its resources are lost; the current picture was not drawn.

    Attributes:
        again: whether a new back end of the same kind may succeed.
    """

    def __init__(self, reason: str, *, again: bool) -> None:
        super().__init__(reason)
        self.again = again


class Drawer(Protocol):
    """Draws one object, moment by moment."""

    def draw(self, view: ViewSetup) -> tuple[Float32, Float32]:
        """Premultiplied linear RGBA (h, w, 4) and depth (h, w), +inf where nothing is.

        Raises:
            NlensError: the object or the picture is too large to be drawn.
            DrawerLostError: the picture must be drawn by another back end.
        """
        ...

    def draw_behind(self, view: ViewSetup, front: FrontSurfaces) -> BehindPicture | None:
        """What lies behind a part of the picture that `draw` has drawn last; None for nothing.

        Raises:
            As `draw`.
        """
        ...

    def close(self) -> None:
        """Free its resources, if they still exist."""
        ...
