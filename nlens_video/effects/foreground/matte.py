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

from nlens_video.core.layers import Bool, Box, Float32
from nlens_video.effects.foreground.background import sqrt_light
from nlens_video.effects.foreground.frame_sampler import MIN_CHANGE
from nlens_video.effects.occlusion import inpainted
from nlens_video.kernels.channels import channel_max, channel_sum

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
    share = np.zeros(near.shape, np.float32)
    if not near.any():
        return share
    whole = Box(0, 0, *near.shape[::-1])
    hole = _largest_hole(near.shape, scale)
    margin = _margin_px(edge_px, scale, hole)
    at = Box.of(near).expanded(margin).intersection(whole).slices_in(whole)
    solid = _refine_mask(light[at], background[at], noise[at], near[at], scale, edge_px, hole)
    if not solid.any():
        return share
    core, band = _trimap(solid, edge_px)
    known = np.zeros(near.shape, np.bool_)
    known[at] = core
    foreground = inpainted(light, known, (0, 0))
    pixels = light[at][band], background[at][band], foreground[at][band]
    inner = core.astype(np.float32)
    inner[band] = solid[band] & _nearer_to_foreground(*pixels)
    prior = cv2.GaussianBlur(inner, (0, 0), max(0.6, _EDGE_SIGMA * edge_px))
    found = core.astype(np.float32)
    found[band] = _projected(*pixels, noise[at][band], np.asarray(prior, np.float32)[band])
    share[at] = cv2.medianBlur(found, 5)
    return share


def _nearer_to_foreground(plate: Float32, background: Float32, foreground: Float32) -> Bool:
    """Whether pixels (n,) of light (n, 3) are over half-way from the background, in roots."""
    roots = sqrt_light(background)
    contrast = channel_max(np.abs(sqrt_light(foreground) - roots))
    return np.asarray(channel_max(np.abs(sqrt_light(plate) - roots)) > np.float32(0.5) * contrast)


def _projected(
    plate: Float32, background: Float32, foreground: Float32, noise: Float32, prior: Float32
) -> Float32:
    """Coverage of pixels (n,) of light (n, 3) by the foreground [1].

    Args:
        plate: light of the plate.
        background: that behind the foreground.
        foreground: its own.
        noise: standard deviation of the square root of the plate's light (n,) [1].
        prior: coverage (n,) by the mask [1].
    """
    whole, part = foreground - background, plate - background
    # of light, from that of its square root: noise of the plate, and texture of the foreground
    level = np.maximum(channel_sum(sqrt_light(plate)) / np.float32(3.0), np.float32(_MIN_ROOT))
    texture = channel_sum(np.square(foreground)) / np.float32(3.0)
    variance = np.square(np.float32(2.0) * level * noise)
    variance += np.square(np.float32(_FOREGROUND_SIGMA)) * texture
    square = channel_sum(whole * whole) / variance
    along = channel_sum(whole * part) / variance
    share = along + np.float32(_PRIOR_WEIGHT) * prior
    share /= square + np.float32(_PRIOR_WEIGHT)
    share = (np.clip(share, 0.0, 1.0) - np.float32(0.03)) / np.float32(0.94)
    return np.asarray(np.clip(share, 0.0, 1.0), np.float32)


def _largest_hole(shape: tuple[int, ...], scale: float) -> float:
    """Area of a hole up to which it is filled, in a mask of a region (h, w) [px^2]."""
    return float((_MAX_HOLE * min(shape)) ** 2 + scale * scale * 4)


def _margin_px(edge_px: float, scale: float, hole: float) -> int:
    """Margin around the mask at low resolution beyond which nothing changes the matte [px].

    The matte lies in the reach of the mask. Around it is room for the blur of its edge, and more
    pixels than those of a hole: what surrounds the mask is none.
    """
    return _reach_px(edge_px, scale) + 4 + math.ceil(max(edge_px + 1.0, math.sqrt(hole)))


def _reach_px(edge_px: float, scale: float) -> int:
    """How far beyond the mask at low resolution that at full resolution may lie [px]."""
    return math.ceil(2.0 * scale + 0.5 * edge_px)


def _refine_mask(
    light: Float32, background: Float32, noise: Float32, near: Bool, scale: float, edge_px: float,
    hole: float,
) -> Bool:  # fmt: skip
    """Foreground mask (h, w) at full resolution, near that at low resolution; holes are filled."""
    change = cv2.blur(sqrt_light(light) - sqrt_light(background), (3, 3))
    difference = channel_max(np.abs(change, out=change))
    differs = difference > np.maximum(np.float32(_CHANGE_FACTOR * MIN_CHANGE), 2.0 * noise)
    reach = 2 * math.ceil(scale) + 1
    far = 2 * _reach_px(edge_px, scale) + 1
    around = cv2.dilate(near.astype(np.uint8), np.ones((far, far), np.uint8))
    inside = cv2.erode(near.astype(np.uint8), np.ones((reach, reach), np.uint8))
    mask = (differs & (around > 0)).astype(np.uint8) | inside
    side = max(3, round(2.0 * scale) | 1)
    element = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side))
    mask = cv2.morphologyEx(mask, cv2.MORPH_CLOSE, element)
    mask = cv2.morphologyEx(mask, cv2.MORPH_OPEN, np.ones((2, 2), np.uint8))
    _, labels, stats, _ = cv2.connectedComponentsWithStats(1 - mask, connectivity=4)
    small = stats[:, cv2.CC_STAT_AREA] <= hole
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
