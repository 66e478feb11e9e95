"""The object's shadow on the ground plane, by differential rendering (Debevec 1998).

The plate is multiplied by the ratio of the ground's light with the object to that without it. Soft
edges come from many points of each lamp, contact darkening from many directions of the ambient
light, each a projection of the same triangles on the plane. What the object sends back makes up for
some of it. The lens then blurs the loss of light as it blurs the ground there, so it is sampled no
finer than that blur lets through.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from functools import reduce
from itertools import zip_longest

import cv2
import numpy as np
from msgspec import Struct

from nlens_video.core.layers import Box, Float32, Float64
from nlens_video.core.lens_fit import LensFit
from nlens_video.effects.shadow.ambient import (
    from_around,
    smoothed,
    surface_points,
    visible_contact,
)
from nlens_video.effects.shadow.apply import Grid, Shadow, enlarged, ground_blur, pixels_of, scaled
from nlens_video.effects.shadow.blocked import Query, hidden_shares, reached
from nlens_video.effects.shadow.bounce import bounce, irradiance, sent_light
from nlens_video.effects.shadow.casters import Casters, Moment, Occluder
from nlens_video.effects.shadow.light_samples import (
    LightSamples,
    lamp_points,
    project_along_light,
)
from nlens_video.kernels.scatter.furthest import furthest_reach
from nlens_video.scene.camera import Camera
from nlens_video.scene.illumination import Illumination, Lamp, reaches, strength_at
from nlens_video.scene.patches import PosedPatches

_COARSE = 4  # contact darkening and shadows of unsure lamps are smooth: step of their grid [px]
_FINER, _FEW = 2, 16384  # for thin legs: step where that takes no more samples than so many
_PIXELS_A_DISC = 4.0  # across the smallest disc of the ground's blur [px]
_FOLLOWED = 400  # vertices that measure the motion of the shadow
BLACKEST = 0.999
"""Largest loss: some light always comes back from the body [1]."""


class CastShadow(Struct, frozen=True, kw_only=True):
    """Casts the shadow of triangles on the ground.

    Attributes:
        strength: factor on the shadow, 1 is physical, 0 none [1].
        lamp_points: samples of each lamp; three times as many where its direction is unsure.
        ambient_directions: samples of the ambient light.
        threads: limit; default: one a processor. The result does not depend on it.
    """

    strength: float = 1.0
    lamp_points: int = 24
    ambient_directions: int = 64
    threads: int | None = None

    def __call__(
        self,
        moments: Sequence[Moment],
        light: Illumination,
        ground_y: float,
        fit: LensFit | None,
        patches: PosedPatches | None = None,
    ) -> Shadow | None:
        """Cast the mean shadow of some moments.

        Args:
            moments: an odd number of temporal samples; the frame's own time is in the middle.
            light: on the ground.
            ground_y: height of the plane [scene unit].
            fit: the lens, None where it is not known.
            patches: of the object at the frame's own time; None where it sends no light back.

        Returns:
            The loss around the shadow; None where it is out of view or there is none.
        """
        camera = moments[len(moments) // 2].camera
        if camera.world_from_camera[1, 3] <= ground_y or self.strength <= 0.0:
            return None
        occluders = [Occluder.of(moment.casters, moment.camera, ground_y) for moment in moments]
        standing = [occluder for occluder in occluders if occluder is not None]
        if not standing:
            return None
        lamps = [lamp for lamp in light.lamps if reaches(lamp, ground_y)]
        middle = np.mean([occluder.bounds for occluder in standing], axis=(0, 1))
        ambient = from_around(light, middle * (1.0, 0.0, 1.0) + (0.0, ground_y, 0.0))
        sources = [LightSamples.of_lamp(lamp, middle, self.lamp_points) for lamp in lamps]
        if ambient.any():
            sources.append(LightSamples.of_sky(light.ambient, self.ambient_directions))
        frame = Box(0, 0, camera.width, camera.height)
        _, most = ground_blur(camera, ground_y, frame, fit)
        seen = frame.expanded(blur_margin(most, camera))

        def reach(points: Float64) -> Box:
            return reduce(Box.union, (reached(occluder, points, seen) for occluder in standing))

        soft = {one: reach(one.points) for one in sources if one.soft}
        # lamps with sharp shadows share a grid, so that they are drawn together
        sharp = [np.zeros((0, 4)), *(one.points for one in sources if not one.soft)]
        of_lamps = (soft[one] for one in sources[: len(lamps)] if one.soft)
        lit = reduce(Box.union, of_lamps, reach(np.concatenate(sharp)))
        least, _ = ground_blur(camera, ground_y, lit, fit)
        step = coarsest_step(least)
        fine = Grid.on(lit, step)
        grids = [_coarse_grid(soft[one], step) if one.soft else fine for one in sources]
        queries = [
            Query(one.points, one.count, grid) for one, grid in zip(sources, grids, strict=True)
        ]
        hidden = hidden_shares(occluders, queries, self.threads)
        shares = [_Share(share, grid) for share, grid in zip(hidden, grids, strict=True)]
        surface = _surface(standing[len(standing) // 2]) if soft else None
        if surface is not None:
            shares = [
                share.softened(camera, ground_y, surface, own) if own.soft else share
                for share, own in zip(shares, sources, strict=True)
            ]
        inner = reduce(Box.union, (one.bounds for one in shares), Box(0, 0, 0, 0))
        if inner.empty:
            return None
        grid = Grid.on(inner, step)
        view = grid.view(camera)
        loss = self._loss(light, ambient, (one.on(grid) for one in shares), view, ground_y)
        if patches is not None and len(patches.points):
            loss = self._less_bounce(loss, grid, light, ambient, patches, camera, ground_y)
        disparity = view.plane_disparity(ground_y).astype(np.float32)
        loss[disparity <= 0.0] = 0.0
        coc = np.zeros_like(disparity) if fit is None else fit.coc_px(disparity)
        return Shadow(box=grid.box, loss=loss, coc_px=coc, step=step)

    def _loss(
        self, light: Illumination, ambient: Float64, shares: Iterable[Float32], view: Camera,
        ground_y: float,
    ) -> Float32:  # fmt: skip
        """Share of the light in each channel that is lost (h, w, 3), up to the horizon [1]."""
        lamps = [lamp for lamp in light.lamps if reaches(lamp, ground_y)]
        ground = _lit_points(lamps, view, ground_y)
        total = irradiance(lamps, ground, ambient)
        total[~(total > 0.0)] = np.inf  # of no light none is lost
        # channel by channel, so that each pass runs along memory
        losses = np.zeros((3, view.height, view.width), np.float32)
        for lamp, share in zip_longest(lamps, shares):  # the last one is of the light from around
            box = Box.of(share > 0.0)
            part = slice(box.y0, box.y1), slice(box.x0, box.x1)
            here = part if ground.size > 3 else (slice(None), slice(None))
            given, colors = np.ones(()), light.contact * ambient
            if lamp is not None:
                given, colors = strength_at(lamp, ground[here]), lamp.posed.light.rgb
            for loss, whole, color in zip(losses, total, colors, strict=True):
                lost = self.strength * (given * color / whole[here])
                loss[part] += lost.astype(np.float32) * share[part]
        np.minimum(losses, np.float32(BLACKEST), out=losses)
        return np.asarray(cv2.merge(list(losses)), dtype=np.float32)

    def _less_bounce(
        self, loss: Float32, grid: Grid, light: Illumination, ambient: Float64,
        patches: PosedPatches, camera: Camera, ground_y: float,
    ) -> Float32:  # fmt: skip
        """The loss (h, w, 3) without what the object makes up for; the ground gains nothing."""
        feet = patches.points * (1.0, 0.0, 1.0) + (0.0, ground_y, 0.0)
        sent = sent_light(patches, light, ambient, ground_y, _at(loss, grid.view(camera), feet))
        coarse = Grid.on(grid.box, max(grid.step, _COARSE))
        view = coarse.view(camera)
        lamps = [lamp for lamp in light.lamps if reaches(lamp, ground_y)]
        total = irradiance(lamps, _lit_points(lamps, view, ground_y), ambient).transpose(1, 2, 0)
        known = light.contact >= 1.0
        gain = bounce(patches, sent, view.plane_points(ground_y), total, level_known=known)
        size = coarse.box.width // grid.step, coarse.box.height // grid.step
        fine = np.asarray(cv2.resize(gain, size), dtype=np.float32)
        here = pixels_of(grid.box, grid.step).slices_in(pixels_of(coarse.box, grid.step))
        loss = loss - np.float32(self.strength) * fine[here]
        return np.clip(loss, np.float32(0.0), np.float32(BLACKEST), out=loss)


class _Share(Struct, frozen=True, eq=False):
    """Share of a light that is blocked (h, w), on a grid."""

    hidden: Float32
    grid: Grid

    def softened(
        self, camera: Camera, ground_y: float, surface: Float64, own: LightSamples
    ) -> _Share:
        """It without the pattern of its samples, faded out where it is too faint to be visible."""
        if not self.hidden.size:  # out of view
            return self
        soft = smoothed(self.hidden, self.grid.view(camera), ground_y, surface, own.spacing)
        return _Share(visible_contact(soft, own.count), self.grid)

    @property
    def bounds(self) -> Box:
        """The part of the frame in which it is not 0."""
        box, step = self.grid.box, self.grid.step
        found = Box.of(self.hidden > 0.0)
        return found if found.empty else scaled(found, step).translated(box.x0, box.y0)

    def on(self, grid: Grid) -> Float32:
        """The same on another grid, 0 where it is not known."""
        out = np.zeros(grid.shape, np.float32)
        here, there = (pixels_of(one.box, grid.step) for one in (grid, self.grid))
        common = here.intersection(there)
        if not common.empty:
            size = self.grid.step // grid.step
            hidden = enlarged(self.hidden, size) if size > 1 else self.hidden
            out[common.slices_in(here)] = hidden[common.slices_in(there)]
        return out


def _lit_points(lamps: Sequence[Lamp], view: Camera, ground_y: float) -> Float64:
    """Points of the ground at pixels (h, w, 3); one for all (1, 1, 3) where lamps are distant."""
    near = any(lamp.posed.light.kind != "directional" for lamp in lamps)
    return view.plane_points(ground_y) if near else np.zeros((1, 1, 3))


def _at(loss: Float32, view: Camera, ground: Float64) -> Float32:
    """The loss (P, 3) at points of the ground (P, 3), 0 where it is not known."""
    height, width = loss.shape[:2]
    seen = view.to_camera(ground)
    before = np.flatnonzero(seen[:, 2] < 0.0)
    column, row = np.floor(view.pixels(seen[before])).T
    inside = (column >= 0.0) & (column < width) & (row >= 0.0) & (row < height)
    found = np.zeros((len(ground), loss.shape[2]), np.float32)
    found[before[inside]] = loss[row[inside].astype(int), column[inside].astype(int)]
    return found


def _surface(occluder: Occluder) -> Float64:
    """Points of the casters' surfaces (P, 3)."""
    meshes = (occluder.opaque, *(mesh for mesh, _ in occluder.transparent))
    return np.concatenate(
        [surface_points(one.vertices, one.faces) for one in meshes if len(one.faces)]
    )


def _coarse_grid(box: Box, step: int) -> Grid:
    """A grid for what is smooth, no finer than a step."""
    finer = box.width * box.height <= _FEW * _FINER**2
    return Grid.on(box, max(step, _FINER) if finer else _COARSE)


def blur_margin(coc_px: float, camera: Camera) -> int:
    """How far beyond the frame the lens spreads light into it, by its greatest CoC diameter [px].

    The CoC counts in columns; a disc spans more rows where pixels are wider than high.
    """
    aspect = camera.fy / camera.fx
    return math.ceil(min(0.5 * coc_px * max(1.0, aspect), furthest_reach(aspect)))


def coarsest_step(least_px: float) -> int:
    """Step of a grid on which a blur of that diameter or more leaves nothing to see [px]."""
    return next(size for size in (4, 2, 1) if size == 1 or size * _PIXELS_A_DISC <= least_px)


def shadow_places(moments: Sequence[Moment], lamps: Sequence[Lamp], ground_y: float) -> Float64:
    """Positions on the frame of the shadows of some vertices at some moments, to measure motion.

    Args:
        moments: of the same vertices.
        lamps: cast the shadows, with light from straight above.
        ground_y: height of the ground [scene unit].

    Returns:
        Columns and rows (len(moments), V, 2), of those that are always before the camera [px].
    """
    some = [_some_points(moment.casters) for moment in moments]
    middle = some[len(some) // 2].mean(axis=0)
    below = np.array([[0.0, 1.0, 0.0, 0.0]])
    lights = np.concatenate([below, *(lamp_points(own, middle, 1) for own in lamps)])
    seen = np.array(
        [
            np.column_stack([points, np.ones(len(points))])
            @ project_along_light(lights, ground_y, moment.camera).swapaxes(1, 2)
            for points, moment in zip(some, moments, strict=True)
        ]
    ).reshape(len(moments), -1, 3)
    before = (seen[..., 2] > 0.0).all(axis=0)
    return np.asarray(seen[:, before, :2] / seen[:, before, 2:])


def _some_points(casters: Casters) -> Float64:
    """A few hundred vertices, evenly among all (V, 3)."""
    transparent = (one.vertices[:, :3] for one in casters.transparent)
    points = np.concatenate([casters.vertices, *transparent])
    return points[:: max(1, len(points) // _FOLLOWED)].astype(np.float64)
