"""The shadow that what moves in the plate casts on the object, under a known sun.

A point of the object lies in that shadow just where its own shadow on the ground would: the sun's
ray through the point meets the ground there. The plate shows that ground, since the object does not
stand in it, so the ground's light over the background's tells how much of the sun is left. Nothing
has to be known of what casts it, but on which side of the object it stands.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from nlens_video.core.layers import (
    BlurredLayer,
    Box,
    DefocusedLayer,
    Float32,
    Float64,
    Picture,
)
from nlens_video.effects.occlusion_cues import MovingThings, SeenBackground
from nlens_video.effects.surfaces import normals
from nlens_video.scene.camera import Camera
from nlens_video.scene.illumination import LUMINANCE, Illumination, Lamp, from_lamp, polynomial

_SOFT_PX = 1.5  # of the ratio of two pictures: their grain is stronger than a shadow's edge
_IN_VIEW = 0.8  # share of the object whose ground has to be in view: else a part would stay lit [1]
_GRAIN = 0.07  # of the ground's light, by which it differs without a shadow [1]
_DARKEST = 1e-4  # light of the background below which its ratio tells nothing [1]
_LOWEST = 0.1  # height of the sun (sine) below which shadows reach out of every frame
_FAINTEST = 0.15  # share of the ground's light below which a sun's shadow is grain [1]
_DISC_SIGMA = 0.25  # standard deviation of a disc of light by its diameter
_LEAST = 1e-6  # weight below which nothing of the object is near


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class GroundLight:
    """How much of its usual light the plate's ground has.

    Attributes:
        box: where the array lies; inside the frame.
        share: luminance by that of the background (h, w), NaN where the ground is not seen [1].
    """

    box: Box
    share: Float32


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Sunlight:
    """A known sun on an object and its ground.

    Attributes:
        sun: the lamp, above the horizon.
        light: all light on the object, the sun among its lamps.
        in_shadow: share of the ground's light that is left in the sun's shadow, in [0, 1) [1].
    """

    sun: Lamp
    light: Illumination
    in_shadow: float

    @classmethod
    def known(
        cls, sun: Lamp | None, light: Illumination, ground: Illumination, contact: Float64
    ) -> Sunlight | None:
        """Where a sun is known, and strong enough for its shadow to show; else None.

        Args:
            sun: one of the lamps.
            light: on the object.
            ground: light on the ground.
            contact: where the object stands (3,) [scene unit].
        """
        if sun is None or sun.posed.direction[1] >= -_LOWEST:
            return None
        given = float(from_lamp(sun, contact) @ LUMINANCE)
        share = given / max(float(ground.on_plane(contact) @ LUMINANCE), _DARKEST)
        left = 1.0 - min(share, 1.0)
        return cls(sun=sun, light=light, in_shadow=left) if share > _FAINTEST else None


def received(
    blurred: BlurredLayer, defocused: DefocusedLayer, picture: Picture, things: MovingThings,
    camera: Camera, contact: Float64, sunlight: Sunlight,
) -> BlurredLayer:  # fmt: skip
    """The object's layer in the shadow of what moves.

    Args:
        blurred: the object as the lens sees it.
        defocused: the sharp object and its CoC.
        picture: the plate as decoded.
        things: what moves on the frame.
        camera: of the frame.
        contact: where the object stands on the ground (3,) [scene unit].
        sunlight: on both.
    """
    toward, height = -sunlight.sun.posed.direction, float(contact[1])
    if not stands_towards(camera.ground_seen_at(things.feet, height)[0], contact, toward):
        return blurred
    layer = defocused.layer
    view = camera.cropped(layer.box)
    depth = np.where(np.isfinite(layer.depth), layer.depth, np.float32(np.nan))
    columns, rows = (np.arange(side, dtype=np.float64) for side in (view.width, view.height))
    points = view.points_at(depth, columns + 0.5, rows + 0.5).astype(np.float64)
    ground = ground_light(picture, things.background(picture))
    left = sun_left(points, camera, height, toward, ground, sunlight.in_shadow)
    if left is None or (left >= 1.0).all():
        return blurred
    unit = normals(np.nan_to_num(1.0 / depth), view).astype(np.float64)
    share = share_of_sun(sunlight.light, sunlight.sun, points, unit)
    return shaded(blurred, defocused, share * (1.0 - left[..., None]))


def ground_light(picture: Picture, background: SeenBackground) -> GroundLight:
    """Light of the ground around what moves.

    Args:
        picture: the plate as decoded.
        background: of the frame.
    """
    known = np.isfinite(background.light).all(axis=-1)
    now, usual = (
        cv2.GaussianBlur(
            np.where(known, light @ LUMINANCE.astype(np.float32), np.float32(0.0)), (0, 0), _SOFT_PX
        )
        for light in (picture.linear(background.box), background.light)
    )
    share = np.full(now.shape, np.nan, np.float32)
    np.divide(now, usual, out=share, where=known & (usual > _DARKEST))
    return GroundLight(box=background.box, share=share)


def stands_towards(feet: Float64, point: Float64, toward: Float64) -> bool:
    """Whether all that moves stands on the sun's side of a point of the ground.

    Args:
        feet: where it stands on the ground (N, 3) [scene unit].
        point: (3,).
        toward: direction (3,) to the sun.
    """
    level = (feet - point)[:, (0, 2)] @ toward[[0, 2]]
    return len(feet) > 0 and bool((level > 0.0).all())


def sun_left(
    points: Float64, camera: Camera, ground_y: float, toward: Float64, ground: GroundLight,
    in_shadow: float,
) -> Float32 | None:  # fmt: skip
    """Share of the sun that reaches points of the object past what moves.

    Args:
        points: in the world (h, w, 3), NaN where the object is not [scene unit].
        camera: of the frame.
        ground_y: height of the ground [scene unit].
        toward: unit direction (3,) to the sun, above the horizon.
        ground: its light.
        in_shadow: share of its light that is left in the sun's shadow, in [0, 1) [1].

    Returns:
        (h, w), 1 where the ground that tells it is covered [1]; None where it is out of view for
        many of them.
    """
    down = np.maximum(points[..., 1:2] - ground_y, 0.0) / toward[1]
    met = camera.to_camera((points - down * toward).reshape(-1, 3))
    before = met[:, 2] < 0.0
    met[~before] = np.nan
    places = camera.pixels(met).reshape(*points.shape[:2], 2).astype(np.float32)
    corner = np.array([ground.box.x0 + 0.5, ground.box.y0 + 0.5], np.float32)
    at = np.nan_to_num(places - corner, nan=-2.0)
    rows, columns = ground.share.shape
    inside = (at >= 0.0).all(axis=-1) & (at[..., 0] <= columns - 1) & (at[..., 1] <= rows - 1)
    if np.count_nonzero(inside) < _IN_VIEW * np.count_nonzero(np.isfinite(points[..., 0])):
        return None
    seen = cv2.remap(
        ground.share, at[..., 0], at[..., 1], cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_CONSTANT, borderValue=math.nan,
    )  # fmt: skip
    return _sun_of(np.asarray(seen, np.float32), in_shadow)


def part_in_the_sun(ground: GroundLight, in_shadow: float) -> Float32:
    """Of the ground, how much is as in the sun, the rest as in a shadow (h, w), by its light [1].

    Args:
        ground: its light.
        in_shadow: share of its light that is left in the sun's shadow, in [0, 1) [1].
    """
    sun = _sun_of(ground.share, in_shadow)
    return np.asarray(sun / (in_shadow + (1.0 - in_shadow) * sun), np.float32)


def _sun_of(share: Float32, in_shadow: float) -> Float32:
    """How much of the sun reaches a ground that has such a share of its light; 1 for NaN."""
    seen = np.where(share > 1.0 - _GRAIN, np.float32(1.0), share)
    left = np.clip((seen - in_shadow) / (1.0 - in_shadow), 0.0, 1.0)
    return np.asarray(np.nan_to_num(left, nan=1.0), np.float32)


def share_of_sun(light: Illumination, sun: Lamp, points: Float64, unit: Float64) -> Float64:
    """Share (h, w, 3) of the light that a sun, one of the lamps, gives surfaces of a normal."""
    given = from_lamp(sun, points, unit)
    whole = sum((from_lamp(lamp, points, unit) for lamp in light.lamps), np.zeros(points.shape))
    if light.ambient is not None:
        whole = whole + math.pi * np.maximum(polynomial(unit) @ light.ambient, 0.0)
    return np.asarray(np.divide(given, whole, out=np.zeros(points.shape), where=whole > 0.0))


def shaded(blurred: BlurredLayer, defocused: DefocusedLayer, lost: Float64) -> BlurredLayer:
    """The object's layer with a part of its light lost, as soft as the lens shows it.

    Args:
        blurred: the object as the lens sees it.
        defocused: the sharp object and its CoC.
        lost: share of its light (h, w, 3) on the sharp layer's box; NaN where the object is not.
    """
    held, box = defocused.layer.box, blurred.box
    whole = held.union(box)
    maps = np.zeros((whole.height, whole.width, 4), np.float32)
    there = np.isfinite(lost).all(axis=-1)
    maps[held.slices_in(whole)][there] = np.append(lost[there], np.ones((there.sum(), 1)), axis=1)
    coc = np.abs(defocused.coc_px[there])
    sigma = max(_SOFT_PX, _DISC_SIGMA * float(np.median(coc)))
    mean = cv2.GaussianBlur(maps, (0, 0), sigma)[box.slices_in(whole)]
    share = mean[..., :3] / np.maximum(mean[..., 3:], np.float32(_LEAST))
    rgba = blurred.rgba.copy()
    rgba[..., :3] *= np.float32(1.0) - np.clip(share, 0.0, 1.0)
    return BlurredLayer(box=box, rgba=rgba)
