"""The object's light with the casters as each of its points sees them: what surfaces lose of it."""

from __future__ import annotations

import math

import cv2
import numpy as np
import numpy.typing as npt
from msgspec import Struct

from nlens_video.core.layers import Bool, Box, Float32, Float64
from nlens_video.effects.shadow.ambient import (
    blurred,
    from_around,
    hemisphere_spacing,
    pattern_level,
    radiance,
    visible_contact,
    whole_sphere,
)
from nlens_video.effects.shadow.light_samples import LightSamples
from nlens_video.effects.shadow.light_views import (
    SAMPLES,
    LightViews,
    SampledCasters,
    views_of,
)
from nlens_video.effects.shadow.shadow_maps import blocked, draw
from nlens_video.effects.shadow.things import Things
from nlens_video.effects.surfaces import normals
from nlens_video.native import kernels
from nlens_video.scene.camera import Camera
from nlens_video.scene.illumination import (
    LUMINANCE,
    Illumination,
    Lamp,
    from_lamp,
    reaches,
)

Index = npt.NDArray[np.int64]

COARSE = 4
"""Step of the grid of contact darkening [px]."""
_REACH = 2.0  # of visible contact darkening, in diagonals of the casters' bounds
_AROUND = 2  # directions all around by those from above alone
_FEW = 128  # points of the casters, to which the distance of surfaces is measured
_CONTEXT_PX = 8  # around pixels, in which normals are fitted [px]


class SeenLights(Struct, frozen=True, eq=False):
    """The light with the casters as each of its points sees them.

    Attributes:
        lamps: those that shine on the ground from above.
        sources: samples of each lamp.
        views: of each lamp's samples.
        ambient: irradiance of the ground by all else (3,).
        around: views from directions all around, none where there is no such light.
        directions: unit vectors to these (N, 3).
        weights: radiance from each of them (N,).
        light: as a whole.
        from_above: number of directions to the light from above.
        points: of the casters (P, 3) [scene unit].
        middle: of the casters (3,) [scene unit].
        reach: distance from there at which contact darkening ends [scene unit].
    """

    lamps: list[Lamp]
    sources: list[LightSamples]
    views: list[list[LightViews]]
    ambient: Float64
    around: list[LightViews]
    directions: Float64
    weights: Float64
    light: Illumination
    from_above: int
    points: Float64
    middle: Float64
    reach: float

    @classmethod
    def of(
        cls, light: Illumination, ground_y: float, casters: list[SampledCasters | None],
        camera: Camera, samples: tuple[int, int],
    ) -> SeenLights:  # fmt: skip
        """Views of the casters at some moments, of which each point of a light sees one.

        Args:
            light: on the ground.
            ground_y: height of the ground [scene unit].
            casters: at each moment, None where nothing stands above the ground; one at least.
            camera: of the frame.
            samples: points of each lamp, and directions to the light from above.
        """
        known = [one for one in casters if one is not None]
        bounds = np.array([one.occluder.bounds for one in known])
        middle = bounds.mean(axis=(0, 1))
        lamps = [lamp for lamp in light.lamps if reaches(lamp, ground_y)]
        ambient = from_around(light, middle * (1.0, 0.0, 1.0) + (0.0, ground_y, 0.0))
        depth = -float(camera.to_camera(middle[None])[0, 2])
        cell = max(abs(depth), float(np.finfo(np.float32).tiny)) / camera.fx
        sources = [LightSamples.of_lamp(lamp, middle, samples[0]) for lamp in lamps]
        views = [views_of(own.points, casters, cell) for own in sources]
        around = whole_sphere(_AROUND * samples[1])[: None if ambient.any() else 0]
        weights: Float64 = np.asarray(around[:, 1] > 0.0, np.float64)
        if light.ambient is not None and len(around):
            weights = radiance(around[:, :3], light.ambient @ LUMINANCE)
        reach = _REACH * float(np.linalg.norm(np.ptp(bounds.reshape(-1, 3), axis=0)))
        points = known[len(known) // 2].points[:: SAMPLES // _FEW].astype(np.float64)
        return cls(
            lamps, sources, views, ambient, views_of(around, casters, COARSE * cell),
            around[:, :3], weights, light, samples[1], points, middle, reach,
        )  # fmt: skip

    def may_block(self, points: Float32) -> Bool:
        """Where (h, w) points (h, w, 3) may get less light than without the casters."""
        flat = points.reshape(-1, 3)
        found = np.zeros(len(flat), bool)
        if self.around:
            away = flat - self.middle.astype(np.float32)
            found |= np.einsum("mk,mk->m", away, away) < self.reach**2
        for one in (one for views in self.views for one in views):
            found |= one.may_block(flat)
        return found.reshape(points.shape[:2])

    def loss(self, seen: Things, off: Bool, view: Camera, threads: int | None) -> Float32:
        """Share of the light that is lost off the ground (h, w, 3), of a strength of 1.

        Args:
            seen: surfaces at the pixels of a region.
            off: the pixels (h, w) that count; the loss of the others is 0.
            view: camera whose pixels are those of the region.
            threads: limit.
        """
        at = np.flatnonzero(off)
        points = seen.points.reshape(-1, 3).take(at, axis=0)
        shares = np.zeros((len(self.lamps) + 1, len(points)), np.float32)
        for own, source, views in zip(shares, self.sources, self.views, strict=False):
            found = blocked(draw(views, threads), points, threads=threads)[0]
            own[:] = found / np.float32(source.count)
            if source.soft:
                own[:] = visible_contact(own, source.count)
        if self.around:
            shares[-1] = self._contact(seen, off, view, threads)
            shares[-1] *= np.float32(self.light.contact)
        loss = np.zeros_like(seen.points)
        dark = np.flatnonzero(np.logical_or.reduce(shares > 0.0))
        if not len(dark):
            return loss
        where = at.take(dark)
        normal = _normals_at(where, seen.disparity, view)
        places = points.take(dark, axis=0).astype(np.float64)
        given = np.empty((len(shares), *places.shape))
        for one, lamp in zip(given, self.lamps, strict=False):
            one[:] = from_lamp(lamp, places, normal)
        given[-1] = self._from_around(normal)
        lost = np.empty_like(places, np.float32)
        kernels.lost_light(np.ascontiguousarray(shares.take(dark, axis=1)), given, lost)
        loss.reshape(-1, 3)[where] = lost
        return loss

    def _from_around(self, normal: Float64) -> Float64:
        """Irradiance by all that is no lamp of surfaces of unit normals (M, 3): (M, 3)."""
        if self.light.ambient is None:
            return np.broadcast_to(self.ambient, normal.shape)
        light = np.empty_like(normal)
        kernels.ambient_light(normal, math.pi * self.light.ambient, light)
        return light

    def _contact(self, seen: Things, off: Bool, view: Camera, threads: int | None) -> Float32:
        """Contact darkening of the pixels off the ground (M,): share of the light around [1]."""
        half = COARSE // 2
        few = (slice(half, None, COARSE), slice(half, None, COARSE))
        some = off[few]
        if not some.any():
            return np.zeros(int(off.sum()), np.float32)
        points, disparity = seen.points[few], seen.disparity[few]
        normal = normals(disparity, view.resized(*some.shape[::-1]))[some]
        toward = (self.directions * self.weights[:, None]).astype(np.float32)
        lost = blocked(draw(self.around, threads), points[some], (normal, toward), threads)
        dark, whole = np.zeros((2, *some.shape), np.float32)
        dark[some], whole[some] = lost
        sparse = (slice(None, None, COARSE), slice(None, None, COARSE))
        level = pattern_level(
            points[sparse], disparity[sparse].astype(np.float64), self.points, view.fx / COARSE,
            hemisphere_spacing(self.from_above),
        )  # fmt: skip
        level = _enlarged(level, some)
        # of the sums, so that nothing of the ground beside a thing comes in
        dark, whole = blurred(dark, level, 1.0), blurred(whole, level, 1.0)
        dark, whole = (_enlarged(part, off)[off] for part in (dark, whole))
        hidden = np.divide(dark, whole, out=np.zeros_like(dark), where=whole > 0.0)
        return visible_contact(hidden, self.from_above)


def _normals_at(where: Index, disparity: Float32, view: Camera) -> Float64:
    """Normals (K, 3) of the surfaces at K pixels of a view, one at least, by their flat indices."""
    rows, columns = np.divmod(where, disparity.shape[1])
    near = Box(int(columns.min()), int(rows[0]), int(columns.max()) + 1, int(rows[-1]) + 1)
    near = near.expanded(_CONTEXT_PX)
    near = near.intersection(Box(0, 0, disparity.shape[1], disparity.shape[0]))
    part = slice(near.y0, near.y1), slice(near.x0, near.x1)
    found = normals(disparity[part], view.cropped(near)).reshape(-1, 3)
    own = (rows - near.y0) * near.width + (columns - near.x0)
    return np.asarray(found.take(own, axis=0), np.float64)


def _enlarged(values: Float32, like: Bool) -> Float32:
    """Values on coarse pixels at the fine ones of an array (h, w)."""
    size = like.shape[1], like.shape[0]
    return np.asarray(cv2.resize(values, size, interpolation=cv2.INTER_LINEAR), dtype=np.float32)
