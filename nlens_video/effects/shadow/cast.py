"""The object's shadow on the ground plane, by differential rendering (Debevec 1998).

The plate is multiplied by the ratio of the light that its ground gets with the object to that
without it. Soft edges come from many points of each lamp, contact darkening from many directions of
the light from around, each a projection of the same triangles on the plane. The lens then blurs the
loss of light as it blurs the ground there (`darken`), so it is worked out no finer than that blur
lets through.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce

import numpy as np

from nlens_video.core.layers import Box, Float32, Float64
from nlens_video.core.lens_fit import LensFit
from nlens_video.effects.shadow.apply import Shadow, enlarged, pixels_of
from nlens_video.effects.shadow.cast import (
    Grid,
    Moment,
    Occluder,
    ShadowQuery,
    hemisphere,
    hidden_shares,
    lamp_points,
)
from nlens_video.scene.camera import Camera
from nlens_video.scene.illumination import Illumination, Lamp, from_around, from_lamp, reaches

_RETURNED = 0.4  # of the light from around that a body hides, by its own bright surface
_MARGIN_LIMIT_PX = 256  # no kernel spreads farther
_COARSE = 4  # contact darkening is smooth: one pixel in so many each way is enough [px]
_FAINT = 0.03  # a share below which nobody sees it: bounds how far contact darkening reaches
_PIXELS_A_DISC = 4.0  # across the smallest disc that the ground's blur spreads [px]
_BLACKEST = 0.999  # the most that is taken away: something always comes back from around


@dataclass(frozen=True, slots=True, kw_only=True)
class CastShadow:
    """Casts the shadow of triangles on the ground.

    Attributes:
        strength: 1 as the light has it, 0 none [1].
        lamp_points: points of each lamp that are followed.
        ambient_directions: directions of the light from around that are followed.
        threads: how many share the work at most; default: one a processor. The result does not
            depend on it.
    """

    strength: float = 1.0
    lamp_points: int = 24
    ambient_directions: int = 64
    threads: int | None = None

    def __call__(
        self, moments: Sequence[Moment], light: Illumination, ground_y: float, fit: LensFit | None
    ) -> Shadow | None:
        """Cast the mean shadow of some moments.

        Args:
            moments: what throws it, and the camera, at an odd number of moments while the shutter
                is open; the frame's own is in the middle.
            light: what lights the ground.
            ground_y: height of the plane [scene unit].
            fit: the lens, None where it is not known.

        Returns:
            The loss around the shadow; None where it is out of view or there is none.
        """
        camera = moments[len(moments) // 2].camera
        if camera.world_from_camera[1, 3] <= ground_y or self.strength <= 0.0:
            return None
        stages = [Occluder.of(moment, ground_y) for moment in moments]
        standing = [stage for stage in stages if stage is not None]
        if not standing:
            return None
        lamps = [lamp for lamp in light.lamps if reaches(lamp, ground_y)]
        middle = np.mean([stage.bounds for stage in standing], axis=(0, 1))
        ambient = from_around(light, middle * (1.0, 0.0, 1.0) + (0.0, ground_y, 0.0))
        lights = [lamp_points(lamp, middle, self.lamp_points) for lamp in lamps]
        if ambient.any():
            lights.append(hemisphere(self.ambient_directions))
        frame = Box(0, 0, camera.width, camera.height)
        _, most = ground_blur(camera, ground_y, frame, fit)
        seen = frame.expanded(math.ceil(min(0.5 * most, _MARGIN_LIMIT_PX)))
        boxes = [
            reduce(Box.union, (stage.reached(own, seen) for stage in standing)) for own in lights
        ]
        lit = reduce(Box.union, boxes[: len(lamps)], Box(0, 0, 0, 0))
        least, _ = ground_blur(camera, ground_y, lit, fit)
        step = next(size for size in (4, 2, 1) if size == 1 or size * _PIXELS_A_DISC <= least)
        asked = [ShadowQuery(own, len(own), Grid.on(lit, step)) for own in lights[: len(lamps)]]
        if ambient.any():
            asked.append(
                ShadowQuery(lights[-1], self.ambient_directions, Grid.on(boxes[-1], _COARSE))
            )
        found = [
            _Share(share, one.grid)
            for one, share in zip(asked, hidden_shares(stages, asked, self.threads), strict=True)
        ]
        if ambient.any():
            found[-1] = found[-1].contact(self.ambient_directions)
        inner = reduce(Box.union, (one.bounds for one in found), Box(0, 0, 0, 0))
        if inner.empty:
            return None
        grid = Grid.on(inner, step)
        view = grid.view(camera)
        loss = self._lost(lamps, ambient, [one.on(grid) for one in found], view, ground_y)
        disparity = view.plane_disparity(ground_y).astype(np.float32)
        loss[disparity <= 0.0] = 0.0
        coc = np.zeros_like(disparity) if fit is None else fit.coc_px(disparity)
        return Shadow(box=grid.box, loss=loss, coc_px=coc, step=step)

    def _lost(
        self, lamps: list[Lamp], ambient: Float64, shares: list[Float32], view: Camera,
        ground_y: float,
    ) -> Float32:  # fmt: skip
        """Share of the light in each channel that is gone (h, w, 3), up to the horizon [1]."""
        near = any(lamp.posed.light.kind != "directional" for lamp in lamps)
        ground = view.plane_points(ground_y) if near else np.zeros(3)
        given = [from_lamp(lamp, ground) for lamp in lamps]
        total = sum(given, ambient)
        if ambient.any():
            given.append((1.0 - _RETURNED) * ambient)
        loss = np.zeros((view.height, view.width, 3), np.float32)
        for light, share in zip(given, shares, strict=True):
            part = np.divide(light, total, out=np.zeros_like(total), where=total > 0.0)
            part = (self.strength * part).astype(np.float32)
            for channel in range(3):
                loss[..., channel] += part[..., channel] * share
        return np.minimum(loss, np.float32(_BLACKEST), out=loss)


@dataclass(frozen=True, slots=True, eq=False)
class _Share:
    """Which share of a light is hidden (h, w), and where."""

    hidden: Float32
    grid: Grid

    def contact(self, directions: int) -> _Share:
        """What is seen of it where it is light from around: nothing of what is faint."""
        faint = max(_FAINT, min(1.0 / directions, 0.5))
        left = np.maximum(self.hidden - np.float32(faint), np.float32(0.0))
        return _Share(left / np.float32(1.0 - faint), self.grid)

    @property
    def bounds(self) -> Box:
        """The part of the frame in which it is not 0."""
        some = self.hidden > 0.0
        rows, columns = np.flatnonzero(some.any(axis=1)), np.flatnonzero(some.any(axis=0))
        if not rows.size:
            return Box(0, 0, 0, 0)
        box, step = self.grid.box, self.grid.step
        return Box(
            box.x0 + int(columns[0]) * step, box.y0 + int(rows[0]) * step,
            box.x0 + (int(columns[-1]) + 1) * step, box.y0 + (int(rows[-1]) + 1) * step,
        )  # fmt: skip

    def on(self, grid: Grid) -> Float32:
        """The same on another grid, 0 where it is not known."""
        size = self.grid.step // grid.step
        hidden = enlarged(self.hidden, size) if size > 1 else self.hidden
        out = np.zeros(grid.shape, np.float32)
        here, there = (pixels_of(one.box, grid.step) for one in (grid, self.grid))
        common = here.intersection(there)
        if not common.empty:
            out[common.slices_in(here)] = hidden[common.slices_in(there)]
        return out


def ground_blur(
    camera: Camera, ground_y: float, box: Box, fit: LensFit | None
) -> tuple[float, float]:
    """Least and greatest CoC diameter of the ground in a box of the frame [px].

    It is affine there, up to the horizon.
    """
    if fit is None or box.empty:
        return 0.0, 0.0
    corners = Grid.on(box, 1).view(camera).corner_disparity(ground_y)
    coc = fit.coc_px(np.maximum(corners, 0.0).astype(np.float32))
    crosses = coc.min() <= 0.0 <= coc.max()
    return 0.0 if crosses else float(np.abs(coc).min()), float(np.abs(coc).max())
