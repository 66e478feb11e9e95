"""A soft matte of what moves before a known background.

In an edge the plate is P = a F + (1 - a) B. B is known and F is continued from inside the thing, so
the share a follows by projection, as far as F and B differ by more than F's own texture. Else it is
that of the line at which the plate is half-way between the two, blurred by the width of the edge.
"""

from __future__ import annotations

import math

import cv2
import numpy as np

from nlens_video.core.layers import Bool, Float32
from nlens_video.effects.foreground.background import root
from nlens_video.effects.foreground.reservoir import MOVED
from nlens_video.effects.occlusion import inpainted

_TRUST = 60.0  # of the coarse mask, in variances of light by which F and B must differ
_TEXTURE = 0.15  # standard deviation of a thing's light, by that light [1]
_EDGE_SIGMA = 0.25  # of the coarse mask's blur, by the width of an edge [1]
_DIFFERS = 0.35  # of the change that makes a thing, for its edges
_HOLE_PX = 0.012  # side of a hole that is filled, of the region's smaller side [1]
_LEAST_ROOT = 0.08  # below it noise no longer falls with the light [1]


def soft_matte(
    light: Float32, background: Float32, noise: Float32, near: Bool, edge_px: float, scale: float
) -> Float32:
    """Share of each pixel (h, w) that something before the background covers [1].

    Args:
        light: of the plate, scene-linear (h, w, 3).
        background: its light, in the same exposure (h, w, 3).
        noise: standard deviation of the square root of the plate's light (h, w) [1].
        near: where things were found at a small size (h, w).
        edge_px: how wide the edge of a thing may be [px].
        scale: pixels by those of the small size [1].
    """
    if not near.any():
        return np.zeros(near.shape, np.float32)
    solid = _solid(light, background, noise, near, scale, edge_px)
    if not solid.any():
        return np.zeros(near.shape, np.float32)
    core, band = _core_and_band(solid, edge_px)
    alone = inpainted(light, core, (0, 0))
    roots, below = root(light), root(background)
    off = np.abs(roots - below).max(axis=2)
    contrast = np.abs(root(alone) - below).max(axis=2)
    inner = solid & (core | (off > np.float32(0.5) * contrast))
    coarse = cv2.GaussianBlur(inner.astype(np.float32), (0, 0), max(0.6, _EDGE_SIGMA * edge_px))
    apart, seen = alone - background, light - background
    # of light, by that of its root
    variance = np.square(2.0 * np.maximum(roots.mean(axis=2), _LEAST_ROOT) * noise)
    variance = variance + np.square(np.float32(_TEXTURE)) * np.square(alone).mean(axis=2)
    square = (apart * apart).sum(axis=2) / variance
    along = (apart * seen).sum(axis=2) / variance
    share = (along + np.float32(_TRUST) * coarse) / (square + _TRUST)
    share = np.where(core, np.float32(1.0), np.where(band, share, np.float32(0.0)))
    share = (np.clip(share, 0.0, 1.0) - np.float32(0.03)) / np.float32(0.94)
    share = np.clip(share, 0.0, 1.0).astype(np.float32)
    return np.asarray(cv2.medianBlur(share, 5), np.float32)


def _solid(
    light: Float32, background: Float32, noise: Float32, near: Bool, scale: float, edge_px: float
) -> Bool:
    """Where the plate differs from the background, small holes filled."""
    off = np.abs(cv2.blur(root(light) - root(background), (3, 3))).max(axis=2)
    differs = off > np.maximum(np.float32(_DIFFERS * MOVED), 2.0 * noise)
    reach = 2 * math.ceil(scale) + 1
    far = 2 * math.ceil(2.0 * scale + 0.5 * edge_px) + 1
    around = cv2.dilate(near.astype(np.uint8), np.ones((far, far), np.uint8))
    inside = cv2.erode(near.astype(np.uint8), np.ones((reach, reach), np.uint8))
    mask = (differs & (around > 0)).astype(np.uint8) | inside
    side = max(3, round(2.0 * scale) | 1)
    element = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (side, side))
    mask = cv2.morphologyEx(mask, cv2.MORPH_CLOSE, element)
    mask = cv2.morphologyEx(mask, cv2.MORPH_OPEN, np.ones((2, 2), np.uint8))
    largest = (_HOLE_PX * min(mask.shape)) ** 2 + scale * scale * 4
    _, labels, stats, _ = cv2.connectedComponentsWithStats(1 - mask, connectivity=4)
    small = stats[:, cv2.CC_STAT_AREA] <= largest
    small[0] = True
    return np.asarray(small[labels])


def _core_and_band(solid: Bool, edge_px: float) -> tuple[Bool, Bool]:
    """What is a thing's alone, and where its edge may be.

    A limb that is narrower than its edges is its own along its middle.
    """
    depth = cv2.distanceTransform(np.pad(solid.astype(np.uint8), 1, mode="edge"), cv2.DIST_L2, 3)
    depth = depth[1:-1, 1:-1]
    inner = max(2.0, edge_px)
    side = 2 * math.ceil(inner) + 1
    ridge = cv2.dilate(depth, np.ones((side, side), np.uint8))
    core = solid & (depth >= np.minimum(np.float32(inner), 0.75 * ridge))
    beyond = cv2.dilate(solid.astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
    return core, np.asarray(beyond & ~core)
