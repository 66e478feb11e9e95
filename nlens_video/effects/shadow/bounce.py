"""Light that the object sends back to the ground: one diffuse bounce off patches of its surface.

A patch gets the lamps and the light around as if nothing hid them, the latter as far as its shadow
leaves it: surfaces near the ground look into each other and into their own shadow.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from nlens_video.core.layers import Float32, Float64
from nlens_video.native import kernels
from nlens_video.scene.illumination import (
    LUMINANCE,
    Illumination,
    Lamp,
    from_lamp,
    polynomial,
    reaches,
    strength_at,
)
from nlens_video.scene.patches import PosedPatches

_SENT = 0.6  # of the light that its colour leaves: surfaces hide lamps and ground from each other
_AT_ONCE = 32768  # points of the ground, whose numbers stay in a processor's cache


def irradiance(lamps: Sequence[Lamp], ground: Float64, around: Float64) -> Float64:
    """Irradiance (3, h, w) of points of the ground (h, w, 3) by lamps, and from around (3,)."""
    points = np.asfortranarray(ground.reshape(-1, 3))
    found = np.repeat(around[:, None], len(points), axis=1)
    for first in range(0, len(points), _AT_ONCE):
        some = slice(first, first + _AT_ONCE)
        for lamp in lamps:
            strength = strength_at(lamp, points[some])
            for channel, color in zip(found, lamp.posed.light.rgb, strict=True):
                channel[some] += color * strength
    return found.reshape(3, *ground.shape[:2])


def sent_light(
    patches: PosedPatches, light: Illumination, around: Float64, ground_y: float, lost: Float32
) -> Float64:
    """Radiosity (P, 3) of patches; 0 below the ground.

    Args:
        patches: of the object.
        light: on the ground.
        around: irradiance of the ground by all that is no lamp (3,).
        ground_y: height of the ground [scene unit].
        lost: share of the ground's light that is lost below each patch (P, 3) [1].
    """
    normals = patches.normals
    given = np.broadcast_to(around, normals.shape)
    if light.ambient is not None:
        given = math.pi * np.maximum(polynomial(normals) @ light.ambient, 0.0)
    given = given * (1.0 - lost)
    for lamp in light.lamps:
        if reaches(lamp, ground_y):
            given = given + from_lamp(lamp, patches.points, normals)
    sent = _SENT * patches.colors * given
    return np.where(patches.points[:, 1:2] > ground_y, sent, 0.0)


def bounce(
    patches: PosedPatches, sent: Float64, ground: Float64, total: Float64, *, level_known: bool
) -> Float32:
    """Light from the patches by the ground's own light (h, w, 3) [1].

    Args:
        patches: of the object.
        sent: their radiosity (P, 3), from `sent_light`.
        ground: points of it (h, w, 3) [scene unit].
        total: irradiance of the ground without the object (3,) or (h, w, 3).
        level_known: whether the share of each light is known; else the bounce only tints, for the
            shadow is as light as it should be, or lighter, without it.
    """
    points = np.ascontiguousarray(ground.reshape(-1, 3), np.float32)
    rows = np.column_stack([patches.points, patches.normals, patches.areas, sent])
    found = np.zeros_like(points)
    kernels.gather_patches(points, np.ascontiguousarray(rows, np.float32), found)
    gain = found.reshape(ground.shape)
    gain = np.divide(gain, total, out=np.zeros_like(gain, np.float64), where=total > 0.0)
    if not level_known:
        gain -= (gain @ LUMINANCE)[..., None]
    return gain.astype(np.float32)


def gather_patches_reference(points: Float32, patches: Float32, irradiance: Float32) -> None:
    """NumPy reference of the kernel: adds the light of patches to points of level ground.

    The form factor is that of a small disc of the patch's area, which stays finite where it touches
    the ground.

    Args:
        points: on the ground (M, 3) [scene unit].
        patches: point, unit normal, area and radiosity of each (P, 10).
        irradiance: of the points (M, 3); changed.
    """
    for point, row in zip(points.astype(np.float64), irradiance, strict=True):
        away = point - patches[:, :3].astype(np.float64)
        squared = (away * away).sum(axis=1)
        leaves = np.maximum((away * patches[:, 3:6]).sum(axis=1), 0.0)
        arrives = np.maximum(-away[:, 1], 0.0)
        below = squared * (math.pi * squared + patches[:, 6])
        area = np.where(below > 0.0, patches[:, 6], 0.0)
        factor = area * leaves * arrives / np.where(below > 0.0, below, 1.0)
        row += factor @ patches[:, 7:]
