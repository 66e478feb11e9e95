"""Soft matte of a moving target in front of a known background: difference matting.

At an edge the plate is P = a F + (1 - a) B. The background B is known, and the foreground F is
extrapolated from inside the target. The coverage a is then the projection of P - B on F - B, as far
as these differ by more than the texture of F. As a prior serves the mask whose outline is where the
plate is half-way from B to F, blurred by the width of the edge.
"""

from __future__ import annotations

import math

import cv2
import numpy as np

from nlens_video.core.layers import Bool, Float32
from nlens_video.effects.foreground.background import sqrt_light
from nlens_video.effects.foreground.frame_sampler import MIN_CHANGE
from nlens_video.effects.occlusion import inpainted

_PRIOR_WEIGHT = 60.0  # of the prior, by |F - B|^2 over the variance of the light [1]
_FOREGROUND_SIGMA = 0.15  # standard deviation of the light of F, by that light [1]
_EDGE_SIGMA = 0.25  # standard deviation of the blur of the prior, by the width of the edge [1]
_CHANGE_FACTOR = 0.35  # change of a root of light at an edge, by `MIN_CHANGE` [1]
_MAX_HOLE = 0.012  # side of a hole that is filled, by the smaller side of the region [1]
_MIN_ROOT = 0.08  # root of light below which its noise no longer falls with the light [1]


def soft_matte(
    light: Float32, background: Float32, noise: Float32, near: Bool, edge_px: float, scale: float
) -> Float32:
    """Coverage of each pixel (h, w) by moving targets [1].

    Args:
        light: of the plate, scene-linear (h, w, 3).
        background: its light, in the same exposure (h, w, 3).
        noise: standard deviation of the square root of the plate's light (h, w) [1].
        near: the foreground mask at low resolution, scaled up (h, w).
        edge_px: largest width of a target's edge [px].
        scale: pixels by those at low resolution [1].
    """
    if not near.any():
        return np.zeros(near.shape, np.float32)
    solid = _refine_mask(light, background, noise, near, scale, edge_px)
    if not solid.any():
        return np.zeros(near.shape, np.float32)
    core, band = _trimap(solid, edge_px)
    foreground = inpainted(light, core, (0, 0))
    roots, below = sqrt_light(light), sqrt_light(background)
    difference = np.abs(roots - below).max(axis=2)
    contrast = np.abs(sqrt_light(foreground) - below).max(axis=2)
    inner = solid & (core | (difference > np.float32(0.5) * contrast))
    prior = cv2.GaussianBlur(inner.astype(np.float32), (0, 0), max(0.6, _EDGE_SIGMA * edge_px))
    whole, part = foreground - background, light - background
    # of light, from that of its square root: noise of the plate, and texture of the foreground
    variance = np.square(2.0 * np.maximum(roots.mean(axis=2), _MIN_ROOT) * noise)
    variance = variance + np.square(np.float32(_FOREGROUND_SIGMA)) * np.square(foreground).mean(
        axis=2
    )
    square = (whole * whole).sum(axis=2) / variance
    along = (whole * part).sum(axis=2) / variance
    share = (along + np.float32(_PRIOR_WEIGHT) * prior) / (square + _PRIOR_WEIGHT)
    share = np.where(core, np.float32(1.0), np.where(band, share, np.float32(0.0)))
    share = (np.clip(share, 0.0, 1.0) - np.float32(0.03)) / np.float32(0.94)
    share = np.clip(share, 0.0, 1.0).astype(np.float32)
    return np.asarray(cv2.medianBlur(share, 5), np.float32)


def _refine_mask(
    light: Float32, background: Float32, noise: Float32, near: Bool, scale: float, edge_px: float
) -> Bool:
    """Foreground mask (h, w) at full resolution, near that at low resolution; holes are filled."""
    difference = np.abs(cv2.blur(sqrt_light(light) - sqrt_light(background), (3, 3))).max(axis=2)
    differs = difference > np.maximum(np.float32(_CHANGE_FACTOR * MIN_CHANGE), 2.0 * noise)
    reach = 2 * math.ceil(scale) + 1
    far = 2 * math.ceil(2.0 * scale + 0.5 * edge_px) + 1
    around = cv2.dilate(near.astype(np.uint8), np.ones((far, far), np.uint8))
    inside = cv2.erode(near.astype(np.uint8), np.ones((reach, reach), np.uint8))
    mask = (differs & (around > 0)).astype(np.uint8) | inside
    side = max(3, round(2.0 * scale) | 1)
    element = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side))
    mask = cv2.morphologyEx(mask, cv2.MORPH_CLOSE, element)
    mask = cv2.morphologyEx(mask, cv2.MORPH_OPEN, np.ones((2, 2), np.uint8))
    largest = (_MAX_HOLE * min(mask.shape)) ** 2 + scale * scale * 4
    _, labels, stats, _ = cv2.connectedComponentsWithStats(1 - mask, connectivity=4)
    small = stats[:, cv2.CC_STAT_AREA] <= largest
    small[0] = True  # label 0 is the mask itself
    return np.asarray(small[labels])


def _trimap(solid: Bool, edge_px: float) -> tuple[Bool, Bool]:
    """The certain foreground (h, w), and the band of unknown coverage around it (h, w).

    Of a limb that is narrower than its edges the middle line is certain.
    """
    depth = cv2.distanceTransform(np.pad(solid.astype(np.uint8), 1, mode="edge"), cv2.DIST_L2, 3)
    depth = depth[1:-1, 1:-1]
    inner = max(2.0, edge_px)
    side = 2 * math.ceil(inner) + 1
    ridge = cv2.dilate(depth, np.ones((side, side), np.uint8))
    core = solid & (depth >= np.minimum(np.float32(inner), 0.75 * ridge))
    grown = cv2.dilate(solid.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
    return core, np.asarray(grown & ~core)
