"""The object's shadow on filmed things whose depth is known, beside that on the ground plane.

Each point of a lamp and each direction of the light from around has a shadow map, in which the
surface point of every pixel is looked up. What a surface gets of each light depends on how it is
turned: a wall that faces away from the sun loses nothing by a shadow.
"""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np
from msgspec import Struct

from nlens_video.core.layers import Bool, Box, DepthMap, Float32
from nlens_video.core.lens_fit import LensFit
from nlens_video.effects.shadow.apply import Grid, Shadow, pixels_of
from nlens_video.effects.shadow.cast import BLACKEST, blur_margin, coarsest_step
from nlens_video.effects.shadow.casters import Moment, Occluder
from nlens_video.effects.shadow.light_views import SampledCasters
from nlens_video.effects.shadow.seen_lights import COARSE, SeenLights
from nlens_video.effects.shadow.things import Things
from nlens_video.scene.camera import Camera
from nlens_video.scene.illumination import Illumination

_SEARCH = 8  # step of the grid on which the shadow is looked for [px]
_ON_GROUND = 0.2
# Share of the plane's shadow on pixels that show the plane, from which on a depth map shows the
# ground, too. Else it may be of things alone before a backdrop: what is farther is not believed.
_CONTEXT_PX = 8  # around a region, in which normals are fitted [px]


class CastOnThings(Struct, frozen=True, kw_only=True):
    """Casts the shadow on surfaces off the ground, in place of that on the plane behind them.

    Attributes:
        strength: factor on the shadow, 1 is physical [1].
        lamp_points: samples of each lamp; three times as many where its direction is unsure.
        ambient_directions: samples of the ambient light from above.
        threads: limit; default: one a processor. The result does not depend on it.
    """

    strength: float = 1.0
    lamp_points: int = 24
    ambient_directions: int = 64
    threads: int | None = None

    def __call__(
        self, on_plane: Shadow | None, moments: Sequence[Moment], light: Illumination,
        ground_y: float, fit: LensFit | None, real: DepthMap,
    ) -> Shadow | None:  # fmt: skip
        """The shadow on ground and things.

        Args:
            on_plane: that on the ground, as of `CastShadow`.
            moments: as of `CastShadow`.
            light: on the ground.
            ground_y: height of the plane [scene unit].
            fit: the lens, None where it is not known.
            real: depth of the frame.

        Returns:
            The loss around the shadow; `on_plane` itself where it meets no thing.
        """
        camera = moments[len(moments) // 2].camera
        casters = [
            SampledCasters.of(Occluder.of(one.casters, one.camera, ground_y)) for one in moments
        ]
        if camera.world_from_camera[1, 3] <= ground_y or not any(casters) or self.strength <= 0.0:
            return on_plane
        frame = Box(0, 0, camera.width, camera.height)
        sparse = Things.seen(real, camera, ground_y, Grid(box=frame, step=_SEARCH))
        below = _shows_ground(sparse, on_plane)
        lights = SeenLights.of(
            light, ground_y, casters, camera, (self.lamp_points, self.ambient_directions)
        )
        reached = lights.may_block(sparse.points)
        if on_plane is not None:  # what stands before it there shows it no more
            covered = Grid.on(on_plane.box.intersection(frame), _SEARCH).box
            here = pixels_of(covered, _SEARCH)
            reached[here.y0 : here.y1, here.x0 : here.x1] = True
        found = Box.of(reached & sparse.off_ground(below=below))
        if found.empty:
            return on_plane
        near = Box(*(_SEARCH * side for side in (found.x0, found.y0, found.x1, found.y1)))
        grid = Grid.on(near.expanded(_SEARCH + _CONTEXT_PX), COARSE)
        grid = Grid(box=grid.box.intersection(frame), step=1)
        seen = Things.seen(real, camera, ground_y, grid)
        off = seen.off_ground(below=below)
        loss = lights.loss(seen, off, grid.view(camera), self.threads)
        loss *= np.float32(self.strength)
        np.minimum(loss, np.float32(BLACKEST), out=loss)
        coc = np.zeros(off.shape, np.float32) if fit is None else fit.coc_px(seen.disparity)
        return _merged(on_plane, _Patch(grid.box, loss, coc, off), camera)


def _shows_ground(sparse: Things, on_plane: Shadow | None) -> bool:
    """Whether a depth map shows the ground beside things, so that what lies lower is a hollow.

    Args:
        sparse: what every `_SEARCH`th pixel of the frame shows.
        on_plane: the shadow on the ground, None for none.
    """
    if on_plane is None:
        return True
    box, step, half = on_plane.box, on_plane.step, _SEARCH // 2
    height, width = sparse.above.shape
    rows, columns = (np.arange(size) * _SEARCH + half for size in (height, width))
    down, across = (rows >= box.y0) & (rows < box.y1), (columns >= box.x0) & (columns < box.x1)
    here, there = (
        np.ix_(down, across),
        np.ix_((rows[down] - box.y0) // step, (columns[across] - box.x0) // step),
    )
    dark = on_plane.loss[there].sum(axis=-1) * (sparse.disparity[here] > 0.0)
    level = ~sparse.off_ground(below=True)[here]
    return bool((dark * level).sum() >= _ON_GROUND * dark.sum())


class _Patch(Struct, frozen=True, eq=False):
    """A box of the frame with the shadow on things (h, w, 3), its CoC [px], and where they are."""

    box: Box
    loss: Float32
    coc_px: Float32
    off: Bool

    def beyond(self, camera: Camera) -> _Patch:
        """Continued over the border of the frame, from where the lens still spreads it inwards."""
        largest = float(np.abs(self.coc_px[self.off]).max(initial=0.0))
        reach, box = blur_margin(largest, camera), self.box
        frame = Box(0, 0, camera.width, camera.height)
        sides = (
            (reach * (box.y0 == frame.y0), reach * (box.y1 == frame.y1)),
            (reach * (box.x0 == frame.x0), reach * (box.x1 == frame.x1)),
        )
        wide = Box(
            box.x0 - sides[1][0], box.y0 - sides[0][0], box.x1 + sides[1][1], box.y1 + sides[0][1]
        )
        return _Patch(
            wide, np.pad(self.loss, (*sides, (0, 0)), mode="edge"),
            np.pad(self.coc_px, sides, mode="edge"), np.pad(self.off, sides, mode="edge"),
        )  # fmt: skip


def _merged(on_plane: Shadow | None, patch: _Patch, camera: Camera) -> Shadow | None:
    """The shadow on the ground, but that on things where they are."""
    if not patch.off.any():
        return on_plane
    patch = patch.beyond(camera)
    box = patch.box if on_plane is None else patch.box.union(on_plane.box)
    loss = np.zeros((box.height, box.width, 3), np.float32)
    coc = np.zeros((box.height, box.width), np.float32)
    if on_plane is not None:
        fine = on_plane.fine
        at = fine.box.slices_in(box)
        loss[at], coc[at] = fine.loss, fine.coc_px
    at = patch.box.slices_in(box)
    np.copyto(loss[at], patch.loss, where=patch.off[..., None])
    np.copyto(coc[at], patch.coc_px, where=patch.off)
    dark: Bool = np.logical_or.reduce([loss[..., channel] > 0.0 for channel in range(3)])
    if not dark.any():
        return None
    step = coarsest_step(float(np.abs(coc[dark]).min()))
    grid = Grid.on(Box.of(dark).translated(box.x0, box.y0), step)
    loss, coc = (_meaned(values, box, grid) for values in (loss, coc))
    return Shadow(box=grid.box, loss=loss, coc_px=coc, step=step, on_things=True)


def _meaned(values: Float32, box: Box, grid: Grid) -> Float32:
    """Means of the values of a box's pixels on a grid, 0 beyond the box."""
    whole = np.zeros((grid.box.height, grid.box.width, *values.shape[2:]), np.float32)
    common = grid.box.intersection(box)
    whole[common.slices_in(grid.box)] = values[common.slices_in(box)]
    if grid.step == 1:
        return whole
    mean = cv2.resize(whole, grid.shape[::-1], interpolation=cv2.INTER_AREA)
    return np.asarray(mean, dtype=np.float32)
