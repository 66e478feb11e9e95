"""Contact darkening: directions of the light from around, and what their small number leaves."""

from __future__ import annotations

import math
from functools import lru_cache, partial

import cv2
import numpy as np
from msgspec.structs import replace

from nlens_video.core.layers import Float32, Float64
from nlens_video.kernels.thread_pool import bands
from nlens_video.scene.camera import Camera
from nlens_video.scene.gltf.meshes import Int32
from nlens_video.scene.illumination import LUMINANCE, Illumination, from_lamp, polynomial
from nlens_video.scene.patches import points_by_area

_GOLDEN = 0.5 * (3.0 - math.sqrt(5.0))  # of a turn: Vogel's spiral
_LOWEST = 0.93  # squared sine off the vertical beyond which ambient light is neglected
_RINGS, _SECTORS = 32, 64  # of equal weight under an even sky
_POINTS = 128  # of the casters' surface, to which the distance of the ground is measured
_EVERY = 4  # the distance is measured on every so many pixels each way
_AT_ONCE, _FEWEST = 1 << 18, 16  # distances that are measured at once; and places, at least
_FINEST_PX = 0.7  # standard deviation below which nothing is smoothed
_LEVELS = 7
_COARSE_PX = 4.0  # least standard deviation for which pixels may be coarser
_GUESSED = 2.5  # light from around by that of the strongest lamp, where no file tells it
_FAINT = 0.03  # a share that is not visible: bounds the reach of contact darkening
_DARKEST = 0.1  # of the mean: radiance of second order rings below zero beside a bright part
# Of a Lambert surface's response to each term of `Illumination.ambient` (Ramamoorthi and
# Hanrahan 2001): dividing by them turns irradiance / pi into radiance.
_RESPONSE = np.array([1.0, *[2.0 / 3.0] * 3, *[0.25] * 5])


def hemisphere(directions: int, ambient: Float64 | None = None) -> Float64:
    """Directions (N, 4) to ambient light from above, each of the same part of the irradiance.

    Those nearest to the horizon, which reach far and weigh little, are left out.

    Args:
        directions: their number with those.
        ambient: the light, as of `Illumination.ambient` (9, 3); None for an even one.
    """
    return _hemisphere(directions, None if ambient is None else np.float64(ambient).tobytes())


@lru_cache(maxsize=4)  # most light stays as it is from frame to frame
def _hemisphere(directions: int, light: bytes | None) -> Float64:
    number = np.arange(directions)
    squared_sine: Float64 = np.asarray(
        (number + 0.5) / directions, np.float64
    )  # of the angle off the vertical
    turn: Float64 = np.asarray((number * _GOLDEN) % 1.0, np.float64)
    if light is not None:
        ambient = np.frombuffer(light, np.float64).reshape(-1, 3)
        squared_sine, turn = _warped(squared_sine, turn, np.asarray(ambient @ LUMINANCE))
    sine, up = np.sqrt(squared_sine), np.sqrt(1.0 - squared_sine)
    angle = 2.0 * math.pi * turn
    toward = np.stack([sine * np.cos(angle), up, sine * np.sin(angle), 0.0 * up], axis=1)
    kept: Float64 = toward[squared_sine <= _LOWEST]
    kept.flags.writeable = False  # shared by all who ask
    return kept


def _warped(squared_sine: Float64, turn: Float64, ambient: Float64) -> tuple[Float64, Float64]:
    """Samples of an even sky (N,) moved so that they are as dense as a sky (9,) is bright."""
    ring = (np.arange(_RINGS) + 0.5) / _RINGS
    sector = 2.0 * math.pi * (np.arange(_SECTORS) + 0.5) / _SECTORS
    sine, up = np.sqrt(ring)[:, None], np.sqrt(1.0 - ring)[:, None]
    axes = np.stack(np.broadcast_arrays(sine * np.cos(sector), up, sine * np.sin(sector)), axis=-1)
    bright = radiance(axes, ambient)
    if not bright.any():
        return squared_sine, turn
    rings = np.append(0.0, np.cumsum(bright.sum(axis=1)))
    rings /= rings[-1]
    edges = np.linspace(0.0, 1.0, _RINGS + 1)
    moved = np.interp(squared_sine, rings, edges)
    around = np.linspace(0.0, 1.0, _SECTORS + 1)
    row = np.minimum((moved * _RINGS).astype(int), _RINGS - 1)
    sums = np.concatenate([np.zeros((_RINGS, 1)), np.cumsum(bright, axis=1)], axis=1)
    sums /= sums[:, -1:]
    turned = [np.interp(one, sums[at], around) for one, at in zip(turn, row, strict=True)]
    return moved, np.array(turned)


def radiance(axes: Float64, ambient: Float64) -> Float64:
    """Radiance (...) of a sky (9,) in directions (..., 3), nowhere black; all 0 without light."""
    bright = np.asarray(polynomial(axes) @ (ambient / _RESPONSE))
    mean = max(float(bright.mean()), 0.0)
    return np.maximum(bright, _DARKEST * mean) if mean > 0.0 else np.zeros_like(bright)


def hemisphere_spacing(directions: int) -> float:
    """Angle between so many directions above [rad]."""
    return math.sqrt(2.0 * math.pi / directions)


def whole_sphere(directions: int) -> Float64:
    """So many directions (N, 4) to light from all around, of the same solid angle each."""
    number = np.arange(directions)
    up = 1.0 - 2.0 * (number + 0.5) / directions
    sine, angle = np.sqrt(1.0 - up * up), 2.0 * math.pi * number * _GOLDEN
    return np.stack([sine * np.cos(angle), up, sine * np.sin(angle), 0.0 * up], axis=1)


def visible_contact(hidden: Float32, directions: int) -> Float32:
    """Contact darkening (h, w) of ambient light, faded out where it is too faint to be visible."""
    faint = np.float32(max(_FAINT, min(1.0 / directions, 0.5)))
    part = np.clip((hidden - faint) / min(2.0 * faint, 1.0 - faint), 0.0, 1.0)
    return np.asarray(hidden * (part * part * (3.0 - 2.0 * part)), dtype=np.float32)


def surface_points(vertices: Float64, faces: Int32, count: int = _POINTS) -> Float64:
    """So many points (P, 3) of a surface, evenly by its area, and its lowest vertices."""
    places = np.ascontiguousarray(vertices[:, :3].T, dtype=np.float32)
    first, second, third = (places.take(corner, axis=1) for corner in faces.T)
    one, two = second - first, third - first
    # the area squared by Lagrange's identity, which is quicker than a cross product
    square = _dot(one, one) * _dot(two, two) - _dot(one, two) ** 2
    area = np.sqrt(np.maximum(square, 0.0), dtype=np.float64)
    at, along, aside = points_by_area(area, count)
    chosen = vertices[faces[at], :3]
    spread = chosen[:, 0] + along[:, None] * (chosen[:, 1] - chosen[:, 0])
    spread += aside[:, None] * (chosen[:, 2] - chosen[:, 0])
    few = min(count // 4, len(vertices))
    lowest = np.argpartition(places[1], few - 1)[:few]
    return np.concatenate([spread, vertices[lowest, :3]])


def _dot(one: Float32, other: Float32) -> Float32:
    """Dot products (N,) of vectors (3, N)."""
    return np.asarray(one[0] * other[0] + one[1] * other[1] + one[2] * other[2])


def smoothed(
    hidden: Float32, view: Camera, ground_y: float, points: Float64, spacing: float
) -> Float32:
    """The blocked share (h, w) without the pattern of the few directions.

    The share changes over lengths like the distance to the caster, and neighbouring directions
    shift its outline by a part of that distance: a blur by as much takes the pattern only.

    Args:
        hidden: of the directions, each counted once.
        view: camera whose pixels are those of `hidden`.
        ground_y: height of the ground [scene unit].
        points: of the casters (P, 3) [scene unit].
        spacing: of the directions [rad].
    """
    height, width = hidden.shape
    step = min(_EVERY, height, width)
    far = replace(
        view, fx=view.fx / step, fy=view.fy / step, cx=view.cx / step, cy=view.cy / step,
        width=-(-width // step), height=-(-height // step),
    )  # fmt: skip
    ground = far.plane_points(ground_y).astype(np.float32)
    disparity = np.maximum(far.plane_disparity(ground_y), 0.0)
    level = pattern_level(ground, disparity, points, view.fx, spacing)
    size = far.width * step, far.height * step
    wide: Float32 = np.asarray(
        cv2.resize(level, size, interpolation=cv2.INTER_LINEAR), dtype=np.float32
    )
    slant = (view.world_from_camera[1, 3] - ground_y) * float(np.median(disparity)) * view.fy
    return blurred(hidden, wide[:height, :width], slant / view.fx)


def pattern_level(
    surface: Float32, disparity: Float64, points: Float64, focal_px: float, spacing: float
) -> Float32:
    """How far each pixel is blurred against the pattern of few directions (h, w), for `blurred`.

    Args:
        surface: what the light falls on (h, w, 3) [scene unit].
        disparity: of it (h, w) [1 / scene unit].
        points: of the casters (P, 3) [scene unit].
        focal_px: focal length [px].
        spacing: of the directions that the light comes from [rad].
    """
    ground, there = surface.reshape(-1, 3), points.astype(np.float32)
    squared, twice = (there * there).sum(axis=1), -2.0 * there.T
    nearest = (ground * ground).sum(axis=1)
    # few places at a time, so that their distances to all points stay in a processor's cache
    for band in bands(len(ground), max(_FEWEST, _AT_ONCE // max(len(points), 1))):
        rows = slice(*band)
        between = ground[rows] @ twice
        between += squared
        nearest[rows] += between.min(axis=1)
    sigma = np.sqrt(np.maximum(nearest, 0.0)).reshape(disparity.shape) * disparity
    sigma *= 0.5 * spacing * focal_px / _FINEST_PX
    level = np.log2(np.maximum(sigma, 0.5)).clip(-1.0, _LEVELS - 1.001) + 1.0
    return np.asarray(level, dtype=np.float32)


def blurred(hidden: Float32, level: Float32, slant: float) -> Float32:
    """A share (h, w) blurred by another width at each pixel, between the two nearest octaves."""
    out = np.zeros_like(hidden)
    for number in range(int(level.min()), int(level.max()) + 2):
        finest = _FINEST_PX * 2.0 ** (number - 1)
        soft = hidden if number == 0 else _soft(hidden, finest, slant)
        out += np.maximum(np.float32(1.0) - np.abs(level - np.float32(number)), 0.0) * soft
    return out


def _soft(hidden: Float32, sigma_px: float, slant: float) -> Float32:
    """The share, blurred along the ground; a wide blur on coarser pixels, which is quicker."""
    sigmas = sigma_px, max(sigma_px * slant, 0.05)
    across, down = (1 << max(0, math.floor(math.log2(one / _COARSE_PX))) for one in sigmas)
    height, width = hidden.shape
    blur = partial(
        cv2.GaussianBlur, ksize=(0, 0), sigmaX=_left(sigmas[0], across),
        sigmaY=_left(sigmas[1], down), borderType=cv2.BORDER_REPLICATE,
    )  # fmt: skip
    if across == down == 1:
        return np.asarray(blur(hidden), dtype=np.float32)
    # one more coarse pixel on each side, between which and the next the border's pixels lie
    wide = cv2.copyMakeBorder(
        hidden, down, down + -height % down, across, across + -width % across, cv2.BORDER_REPLICATE
    )
    size = wide.shape[1], wide.shape[0]
    coarse = cv2.resize(wide, (size[0] // across, size[1] // down), interpolation=cv2.INTER_AREA)
    soft = cv2.resize(blur(coarse), size, interpolation=cv2.INTER_LINEAR)
    return np.asarray(soft[down : down + height, across : across + width], dtype=np.float32)


def _left(sigma_px: float, step: int) -> float:
    """What is left of a blur on pixels that are so many times larger, means of the smaller ones."""
    return math.sqrt(sigma_px * sigma_px - (step * step - 1) / 12.0) / step


def from_around(light: Illumination, ground: Float64) -> Float64:
    """Irradiance (3,) of the ground at a point (3,) by all that is no lamp.

    Where nothing is known of it, it is taken for a multiple of what the strongest lamp gives beyond
    the others, which stand for such light. All together is white: a camera balances for that.
    """
    if light.ambient is not None:
        return light.irradiance_around(np.array([0.0, 1.0, 0.0]))
    given = np.array([from_lamp(lamp, ground) for lamp in light.lamps]).reshape(-1, 3)
    strengths = given @ LUMINANCE
    strongest, all_ = float(strengths.max(initial=0.0)), float(strengths.sum())
    around = _GUESSED * max(0.0, 2.0 * strongest - all_)
    return np.asarray(np.maximum(around + all_ - given.sum(axis=0), 0.0) * (around > 0.0))
