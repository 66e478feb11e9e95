"""Shadow that moving targets cast on the object, under a known sun.

A point of the object lies in that shadow just where the sun's ray through it, continued behind it,
meets the ground in shadow. The plate shows that ground, for the object is not there: its light by
the light of the background tells how much of the sun is left. Nothing has to be known of the
targets but on which side of the object they stand.
"""

from __future__ import annotations

import math

import cv2
import numpy as np
from msgspec import Struct

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
from nlens_video.kernels.channels import all_channels
from nlens_video.scene.camera import Camera
from nlens_video.scene.illumination import LUMINANCE, Illumination, Lamp, from_lamp, polynomial

_BLUR_PX = 1.5  # sigma of the blur before light is divided: grain exceeds a shadow's edge [px]
_MIN_IN_VIEW = 0.8  # fraction of the object whose ground must be in view: else a part stays lit [1]
_GRAIN = 0.07  # deviation of the ground's light without a shadow, by that light [1]
_MIN_LIGHT = 1e-4  # light of the background below which a ratio to it tells nothing [1]
_MIN_SUN_HEIGHT = 0.1  # sine of the sun's elevation below which shadows leave every frame [1]
_MIN_SUN_SHARE = 0.15  # of the ground's light, below which a sun's shadow is lost in grain [1]
_DISC_SIGMA = 0.25  # standard deviation of a disc of confusion, by its diameter [1]
_MIN_WEIGHT = 1e-6  # weight of the object's pixels nearby below which there are none [1]


class GroundLight(Struct, frozen=True, kw_only=True, eq=False):
    """Light of the ground in the plate, by its light in the background.

    Attributes:
        box: where the array lies; inside the frame.
        ratio: luminance by that of the background (h, w), NaN where the ground is hidden [1].
    """

    box: Box
    ratio: Float32


class Sunlight(Struct, frozen=True, kw_only=True, eq=False):
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
        """The sunlight where a sun is known and casts a visible shadow; else None.

        Args:
            sun: one of the lamps.
            light: on the object.
            ground: light on the ground.
            contact: where the object stands (3,) [scene unit].
        """
        if sun is None or sun.posed.direction[1] >= -_MIN_SUN_HEIGHT:
            return None
        from_sun = float(from_lamp(sun, contact) @ LUMINANCE)
        share = from_sun / max(float(ground.on_plane(contact) @ LUMINANCE), _MIN_LIGHT)
        left = 1.0 - min(share, 1.0)
        return cls(sun=sun, light=light, in_shadow=left) if share > _MIN_SUN_SHARE else None


def receive_shadow(
    blurred: BlurredLayer, defocused: DefocusedLayer, picture: Picture, things: MovingThings,
    camera: Camera, contact: Float64, sunlight: Sunlight,
) -> BlurredLayer:  # fmt: skip
    """The object's layer in the shadow of moving targets.

    Args:
        blurred: the object as the lens sees it.
        defocused: the sharp object and its CoC.
        picture: the plate as decoded.
        things: the moving targets on the frame.
        camera: of the frame.
        contact: where the object stands on the ground (3,) [scene unit].
        sunlight: on both.
    """
    toward, height = -sunlight.sun.posed.direction, float(contact[1])
    if not all_toward_sun(camera.ground_seen_at(things.feet, height)[0], contact, toward):
        return blurred
    layer = defocused.layer
    view = camera.cropped(layer.box)
    depth = np.where(np.isfinite(layer.depth), layer.depth, np.float32(np.nan))
    columns, rows = (np.arange(side, dtype=np.float64) for side in (view.width, view.height))
    points = view.points_at(depth, columns + 0.5, rows + 0.5).astype(np.float64)
    ground = ground_light(picture, things.background(picture))
    visible = sun_visibility(points, camera, height, toward, ground, sunlight.in_shadow)
    if visible is None or (visible >= 1.0).all():
        return blurred
    unit = normals(np.nan_to_num(1.0 / depth), view).astype(np.float64)
    share = sun_share(sunlight.light, sunlight.sun, points, unit)
    return attenuate(blurred, defocused, share * (1.0 - visible[..., None]))


def ground_light(picture: Picture, background: SeenBackground) -> GroundLight:
    """Light of the ground around moving targets.

    Args:
        picture: the plate as decoded.
        background: of the frame.
    """
    known = all_channels(np.isfinite(background.light))
    now, usual = (
        cv2.GaussianBlur(
            np.where(known, light @ LUMINANCE.astype(np.float32), np.float32(0.0)), (0, 0), _BLUR_PX
        )
        for light in (picture.linear(background.box), background.light)
    )
    ratio = np.full(now.shape, np.nan, np.float32)
    np.divide(now, usual, out=ratio, where=known & (usual > _MIN_LIGHT))
    return GroundLight(box=background.box, ratio=ratio)


def all_toward_sun(feet: Float64, point: Float64, toward: Float64) -> bool:
    """Whether all targets stand on the sun's side of a point of the ground.

    Args:
        feet: where they stand on the ground (N, 3) [scene unit].
        point: (3,).
        toward: direction (3,) to the sun.
    """
    level = (feet - point)[:, (0, 2)] @ toward[[0, 2]]
    return len(feet) > 0 and bool((level > 0.0).all())


def sun_visibility(
    points: Float64, camera: Camera, ground_y: float, toward: Float64, ground: GroundLight,
    in_shadow: float,
) -> Float32 | None:  # fmt: skip
    """Visible fraction of the sun at points of the object, past the moving targets.

    Args:
        points: in the world (h, w, 3), NaN where the object is not [scene unit].
        camera: of the frame.
        ground_y: height of the ground [scene unit].
        toward: unit direction (3,) to the sun, above the horizon.
        ground: its light.
        in_shadow: share of its light that is left in the sun's shadow, in [0, 1) [1].

    Returns:
        (h, w), 1 where the ground that tells it is hidden [1]; None where that ground is out of
        view for many of the points.
    """
    down = np.maximum(points[..., 1:2] - ground_y, 0.0) / toward[1]
    on_ground = camera.to_camera((points - down * toward).reshape(-1, 3))
    in_front = on_ground[:, 2] < 0.0
    on_ground[~in_front] = np.nan
    pixels = camera.pixels(on_ground).reshape(*points.shape[:2], 2).astype(np.float32)
    corner = np.array([ground.box.x0 + 0.5, ground.box.y0 + 0.5], np.float32)
    at = np.nan_to_num(pixels - corner, nan=-2.0)
    rows, columns = ground.ratio.shape
    inside = (at >= 0.0).all(axis=-1) & (at[..., 0] <= columns - 1) & (at[..., 1] <= rows - 1)
    if np.count_nonzero(inside) < _MIN_IN_VIEW * np.count_nonzero(np.isfinite(points[..., 0])):
        return None
    ratio = cv2.remap(
        ground.ratio, at[..., 0], at[..., 1], cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_CONSTANT, borderValue=math.nan,
    )  # fmt: skip
    return _visibility(np.asarray(ratio, np.float32), in_shadow)


def sunlit_fraction(ground: GroundLight, in_shadow: float) -> Float32:
    """Fraction of the ground's light (h, w) that is light as in the sun, not as in a shadow [1].

    Args:
        ground: its light.
        in_shadow: share of its light that is left in the sun's shadow, in [0, 1) [1].
    """
    visible = _visibility(ground.ratio, in_shadow)
    return np.asarray(visible / (in_shadow + (1.0 - in_shadow) * visible), np.float32)


def _visibility(ratio: Float32, in_shadow: float) -> Float32:
    """Visible fraction of the sun on a ground of a ratio of its usual light; 1 for NaN."""
    denoised = np.where(ratio > 1.0 - _GRAIN, np.float32(1.0), ratio)
    visible = np.clip((denoised - in_shadow) / (1.0 - in_shadow), 0.0, 1.0)
    return np.asarray(np.nan_to_num(visible, nan=1.0), np.float32)


def sun_share(light: Illumination, sun: Lamp, points: Float64, unit: Float64) -> Float64:
    """Share (h, w, 3) of the light on surfaces that comes from the sun, one of the lamps [1].

    Args:
        light: all light.
        sun: one of its lamps.
        points: of the surfaces (h, w, 3) [scene unit].
        unit: their normals (h, w, 3).
    """
    from_sun = from_lamp(sun, points, unit)
    whole = sum((from_lamp(lamp, points, unit) for lamp in light.lamps), np.zeros(points.shape))
    if light.ambient is not None:
        whole = whole + math.pi * np.maximum(polynomial(unit) @ light.ambient, 0.0)
    return np.asarray(np.divide(from_sun, whole, out=np.zeros(points.shape), where=whole > 0.0))


def attenuate(blurred: BlurredLayer, defocused: DefocusedLayer, lost: Float64) -> BlurredLayer:
    """The object's layer with a part of its light lost, as soft as the lens shows it.

    Args:
        blurred: the object as the lens sees it.
        defocused: the sharp object and its CoC.
        lost: share of its light (h, w, 3) on the sharp layer's box; NaN where the object is not.
    """
    sharp_box, box = defocused.layer.box, blurred.box
    whole = sharp_box.union(box)
    maps = np.zeros((whole.height, whole.width, 4), np.float32)
    there = np.isfinite(lost).all(axis=-1)
    maps[sharp_box.slices_in(whole)][there] = np.append(
        lost[there], np.ones((there.sum(), 1)), axis=1
    )
    coc = np.abs(defocused.coc_px[there])
    sigma = max(_BLUR_PX, _DISC_SIGMA * float(np.median(coc)))
    mean = cv2.GaussianBlur(maps, (0, 0), sigma)[box.slices_in(whole)]
    share = mean[..., :3] / np.maximum(mean[..., 3:], np.float32(_MIN_WEIGHT))
    rgba = blurred.rgba.copy()
    rgba[..., :3] *= np.float32(1.0) - np.clip(share, 0.0, 1.0)
    return BlurredLayer(box=box, rgba=rgba)
