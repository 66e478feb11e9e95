"""The object's light with the casters as each of its points sees them: what surfaces lose of it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from nlens_video.core.layers import Bool, Box, Float32, Float64
from nlens_video.effects.shadow.ambient import (
    blurred,
    pattern_level,
    radiance,
    visible_contact,
    whole_sphere,
)
from nlens_video.effects.shadow.blocked import R2
from nlens_video.effects.shadow.cast import lamp_points
from nlens_video.effects.shadow.light_view import SAMPLES, LightView, SampledCasters
from nlens_video.effects.shadow.things import Things, normals
from nlens_video.kernels.thread_pool import parallel_for
from nlens_video.scene.camera import Camera
from nlens_video.scene.illumination import (
    LUMINANCE,
    Illumination,
    Lamp,
    from_around,
    from_lamp,
    polynomial,
    reaches,
)

COARSE = 4
"""Step of the grid of contact darkening [px]."""
_REACH = 2.0  # of visible contact darkening, in diagonals of the casters' bounds
_AROUND = 2  # directions all around by those from above alone
_FEW = 128  # points of the casters, to which the distance of surfaces is measured
_AT_ONCE = 4  # points of a light whose shares are summed by one thread
_CONTEXT_PX = 8  # around pixels, in which normals are fitted [px]
_ROW = 512  # pixels in a row of a sheet of them


@dataclass(frozen=True, slots=True, eq=False)
class SeenLights:
    """The light with the casters as each of its points sees them.

    Attributes:
        lamps: those that shine on the ground from above.
        views: of each lamp's points.
        ambient: irradiance of the ground by all else (3,).
        around: views from directions all around, none where there is no such light.
        directions: unit vectors to these (N, 3).
        weights: radiance from each of them (N,).
        light: as a whole.
        samples: points of each lamp, and directions to the light from above.
        points: of the casters (P, 3) [scene unit].
        middle: of the casters (3,) [scene unit].
        reach: distance from there at which contact darkening ends [scene unit].
    """

    lamps: list[Lamp]
    views: list[list[LightView]]
    ambient: Float64
    around: list[LightView]
    directions: Float64
    weights: Float64
    light: Illumination
    samples: tuple[int, int]
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
        views = [_views(lamp_points(lamp, middle, samples[0]), casters, cell) for lamp in lamps]
        around = whole_sphere(_AROUND * samples[1])[: None if ambient.any() else 0]
        weights: Float64 = np.asarray(around[:, 1] > 0.0, np.float64)
        if light.ambient is not None and len(around):
            weights = radiance(around[:, :3], light.ambient @ LUMINANCE)
        reach = _REACH * float(np.linalg.norm(np.ptp(bounds.reshape(-1, 3), axis=0)))
        points = known[len(known) // 2].points[:: SAMPLES // _FEW]
        return cls(
            lamps, views, ambient, _views(around, casters, COARSE * cell), around[:, :3], weights,
            light, samples, points, middle, reach,
        )  # fmt: skip

    def may_block(self, points: Float32) -> Bool:
        """Where (h, w) points (h, w, 3) may get less light than without the casters."""
        found = np.zeros(points.shape[:2], bool)
        if self.around:
            away = points - self.middle.astype(np.float32)
            found |= (away * away).sum(axis=-1) < self.reach**2
        for view in (one for views in self.views for one in views):
            found |= view.may_block(points)
        return found

    def loss(self, seen: Things, off: Bool, view: Camera, threads: int | None) -> Float32:
        """Share of the light that is lost off the ground (M, 3), of a strength of 1.

        Args:
            seen: surfaces at the pixels of a region.
            off: the M pixels (h, w) that count.
            view: camera whose pixels are those of the region.
            threads: limit.
        """
        points = seen.points[off]
        sheet = _sheet(points)
        shares = [
            _blocked(views, sheet, threads)[: len(points)] / np.float32(self.samples[0])
            for views in self.views
        ]
        if self.around:
            shares.append(self._contact(seen, off, view, threads))
        loss = np.zeros_like(points)
        dark = np.any(np.array(shares) > 0.0, axis=0)
        if not dark.any():
            return loss
        where = np.zeros_like(off)
        where[off] = dark
        normal = _normals_at(where, seen.disparity, view)
        places = points[dark].astype(np.float64)
        given = [from_lamp(lamp, places, normal) for lamp in self.lamps]
        around = self._from_around(normal)
        total = np.sum([*given, around], axis=0)
        if self.around:
            given.append(self.light.contact * around)
        for one, share in zip(given, shares, strict=True):
            part = np.divide(one, total, out=np.zeros_like(total), where=total > 0.0)
            loss[dark] += part.astype(np.float32) * share[dark, None]
        return loss

    def _from_around(self, normal: Float64) -> Float64:
        """Irradiance by all that is no lamp of surfaces of unit normals (M, 3): (M, 3)."""
        if self.light.ambient is None:
            return np.broadcast_to(self.ambient, normal.shape)
        return np.asarray(math.pi * np.maximum(polynomial(normal) @ self.light.ambient, 0.0))

    def _contact(self, seen: Things, off: Bool, view: Camera, threads: int | None) -> Float32:
        """Contact darkening of the pixels off the ground (M,): share of the light around [1]."""
        half = COARSE // 2
        few = (slice(half, None, COARSE), slice(half, None, COARSE))
        some = off[few]
        if not some.any():
            return np.zeros(int(off.sum()), np.float32)
        points, disparity = seen.points[few], seen.disparity[few]
        normal = normals(disparity, view.resized(*some.shape[::-1]))[some].astype(np.float64)
        share = np.maximum(normal @ self.directions.T, 0.0) * self.weights
        lost = _blocked(self.around, _sheet(points[some]), threads, share)
        whole = np.zeros(some.shape, np.float32)
        dark = np.zeros_like(whole)
        whole[some], dark[some] = share.sum(axis=1), lost[: len(normal)]
        sparse = (slice(None, None, COARSE), slice(None, None, COARSE))
        level = pattern_level(
            points[sparse], disparity[sparse].astype(np.float64), self.points, view.fx / COARSE,
            self.samples[1],
        )  # fmt: skip
        level = _enlarged(level, some)
        # of the sums, so that nothing of the ground beside a thing comes in
        dark, whole = blurred(dark, level, 1.0), blurred(whole, level, 1.0)
        dark, whole = (_enlarged(part, off)[off] for part in (dark, whole))
        hidden = np.divide(dark, whole, out=np.zeros_like(dark), where=whole > 0.0)
        return visible_contact(hidden, self.samples[1])


def _normals_at(where: Bool, disparity: Float32, view: Camera) -> Float64:
    """Normals (K, 3) of the surfaces at K pixels (h, w) of a view, one at least."""
    near = Box.of(where).expanded(_CONTEXT_PX)
    near = near.intersection(Box(0, 0, where.shape[1], where.shape[0]))
    part = slice(near.y0, near.y1), slice(near.x0, near.x1)
    return normals(disparity[part], view.cropped(near))[where[part]].astype(np.float64)


def _enlarged(values: Float32, like: Bool) -> Float32:
    """Values on coarse pixels at the fine ones of an array (h, w)."""
    size = like.shape[1], like.shape[0]
    return np.asarray(cv2.resize(values, size, interpolation=cv2.INTER_LINEAR), dtype=np.float32)


def _views(lights: Float64, casters: list[SampledCasters | None], cell: float) -> list[LightView]:
    """Views from points of a light (N, 4), which take turns with the moments of the casters."""
    views = []
    for number, light in enumerate(lights):
        caster = casters[number % len(casters)]
        if caster is not None:
            at = (((number + 1) * R2[0]) % 1.0, ((number + 1) * R2[1]) % 1.0)
            views.append(LightView.of(light, caster, cell, at, number))
    return views


def _sheet(points: Float32) -> Float32:
    """Points (M, 3) in rows (h, w, 3), the last one filled up: pictures have limits of width."""
    rows = max(1, -(-len(points) // _ROW))
    sheet = np.zeros((rows * _ROW, 3), np.float32)
    sheet[: len(points)] = points
    return sheet.reshape(rows, _ROW, 3)


def _blocked(
    views: list[LightView], sheet: Float32, threads: int | None, share: Float64 | None = None
) -> Float32:
    """How many of the views' lights are blocked at each point of a sheet (h * w,).

    Args:
        views: of the casters.
        sheet: points (h, w, 3).
        threads: limit.
        share: what each light counts at the first M points (M, N); default: 1.
    """
    parts = [views[first : first + _AT_ONCE] for first in range(0, len(views), _AT_ONCE)]
    done: dict[int, Float32] = {}

    def add(number: int) -> None:
        total = np.zeros(sheet.shape[0] * sheet.shape[1], np.float32)
        for view in parts[number]:
            blocked = view.blocked(sheet).ravel()
            if share is not None:
                blocked = blocked[: len(share)] * share[:, view.number].astype(np.float32)
            total[: len(blocked)] += blocked
        done[number] = total

    parallel_for(add, range(len(parts)), threads)
    whole = np.zeros(sheet.shape[0] * sheet.shape[1], np.float32)
    for number in range(len(parts)):  # in this order, whichever was ready first
        whole += done[number]
    return whole
