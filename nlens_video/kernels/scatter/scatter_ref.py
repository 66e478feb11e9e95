"""Definitions of the blur kernels in NumPy, one pixel after the other.

`scatter`: every source pixel adds its own disc. `gather_subaperture`: every pixel sums over every
source.
"""

from __future__ import annotations

import math

import cv2
import numpy as np
import numpy.typing as npt

from nlens_video.core.layers import Bool, Box, Float32, Float64
from nlens_video.core.optics import ROUND, Aperture
from nlens_video.kernels.scatter.disc import MAX_COC_PX, coverage
from nlens_video.kernels.scatter.shape import barrel_centre
from nlens_video.kernels.scatter.subaperture_gather import STEPS, ramp, subaperture_table

Index = npt.NDArray[np.intp]

SKEW_FADE_PX = 1.5
"""CoC at which the skew of a disc is half in force [px]."""


def scatter_ref(
    rgba: Float32,
    coc_px: Float32,
    *,
    pixel_aspect: float = 1.0,
    aperture: Aperture = ROUND,
    frame: Box | None = None,
) -> Float32:
    """Blur an object's layer by its own CoC; arguments, result and errors as `scatter.scatter`.

    Beyond a border of the array transparent pixels go on as virtual background; covered ones are
    not invented, so that weights there are renormalised with what lies inside.
    """
    if rgba.ndim != 3 or rgba.shape[2] != 4 or coc_px.shape != rgba.shape[:2]:
        raise ValueError(f"{rgba.shape = } must be (h, w, 4) and {coc_px.shape = } its (h, w)")
    if not (np.isfinite(pixel_aspect) and pixel_aspect > 0.0):
        raise ValueError(f"{pixel_aspect = } must be a positive number")
    covered = rgba[..., 3] > 0.0
    if not (np.isfinite(rgba).all() and np.isfinite(coc_px[covered]).all()):
        raise ValueError(
            "the layer holds colours or, where it is covered, CoCs that are not finite"
        )
    out = np.zeros(rgba.shape, dtype=np.float32)
    if not covered.any():
        return out
    whole = Box(0, 0, rgba.shape[1], rgba.shape[0])
    frame = whole if frame is None else frame
    largest = 0.5 * min(float(np.abs(coc_px[covered]).max()), MAX_COC_PX)
    reach = max(coverage(aperture, largest * max(1.0, pixel_aspect), 1.0).shape) // 2
    box = Box.of(covered).expanded(2 * reach + 1)
    light, radii, skew = _source_layer(rgba, coc_px, box, reach)
    margin = reach + 1
    colour = np.zeros((box.height + 2 * margin, box.width + 2 * margin, 4))
    weight = np.zeros(colour.shape[:2])
    for y, x in np.argwhere(np.isfinite(radii)):
        radius = float(radii[y, x])
        barrel = barrel_centre(
            aperture,
            np.array((x + (box.x0 - frame.x0 + 0.5)) * pixel_aspect),
            np.array(y + (box.y0 - frame.y0 + 0.5)),
            (frame.width * pixel_aspect, frame.height),
        )
        disc = coverage(aperture, abs(radius), pixel_aspect, (float(barrel[0]), float(barrel[1])))
        if radius > 0.0:
            disc = disc[::-1, ::-1]
        up, left = disc.shape[0] // 2, disc.shape[1] // 2
        dy = np.arange(-up, up + 1)[:, None] * skew[y, x, 1]
        dx = np.arange(-left, left + 1)[None, :] * skew[y, x, 0]
        disc = disc * (1.0 + dx + dy)
        spot = (
            slice(y + margin - up, y + margin + up + 1),
            slice(x + margin - left, x + margin + left + 1),
        )
        colour[spot] += disc[..., None] * light[y, x]
        weight[spot] += disc
    kept = np.s_[margin : margin + box.height, margin : margin + box.width]
    blurred = colour[kept] / np.maximum(weight[kept], 1e-30)[..., None]
    blurred[..., 3] = np.clip(blurred[..., 3], 0.0, 1.0)
    target = Box.of(covered).expanded(reach).intersection(whole)
    out[target.slices_in(whole)] = blurred[target.slices_in(box)]
    return out


def _source_layer(
    rgba: Float32, coc_px: Float32, box: Box, reach: int
) -> tuple[Float32, Float32, Float32]:
    """Object and virtual background on a box: colours, signed radii, skews.

    A radius is NaN where a pixel takes no part [px]; skews are those of `coc_skew` [1 / px].
    """
    whole = Box(0, 0, rgba.shape[1], rgba.shape[0])
    inside = box.intersection(whole)
    source, within = inside.slices_in(whole), inside.slices_in(box)
    shape = (box.height, box.width)
    mask = np.zeros(shape, dtype=np.bool_)
    mask[within] = rgba[source][..., 3] > 0.0
    coc = np.full(shape, np.nan, dtype=np.float32)
    coc[within] = np.where(mask[within], coc_px[source], np.float32(np.nan))
    colour = np.zeros((*shape, 4), dtype=np.float32)
    colour[within] = np.where(mask[within][..., None], rgba[source], np.float32(0.0))
    nearest, distance = nearest_covered(mask)
    limit = np.float32(0.5 * MAX_COC_PX)
    radius = np.clip(np.float32(0.5) * coc.ravel()[nearest], -limit, limit)
    radius[_beyond_covered(mask, within) | (distance > 2 * reach + 1)] = np.nan
    return colour, radius, coc_skew(coc)  # skew 0 off the object: the CoC is extended as a constant


def nearest_covered(covered: Bool) -> tuple[Index, Float32]:
    """Find each pixel's nearest covered one.

    Args:
        covered: where the object is (h, w), at least one pixel.

    Returns:
        Its place in the flattened array (h, w), and the distance to it (h, w), to about 2 % [px].
    """
    distance, labels = cv2.distanceTransformWithLabels(
        np.where(covered, np.uint8(0), np.uint8(1)),
        cv2.DIST_L2,
        cv2.DIST_MASK_5,
        labelType=cv2.DIST_LABEL_PIXEL,
    )
    place_of_label = np.zeros(int(labels.max()) + 1, dtype=np.intp)
    place_of_label[labels[covered]] = np.flatnonzero(covered)
    return place_of_label[labels], np.asarray(distance, dtype=np.float32)


def coc_skew(coc_px: Float32) -> Float32:
    """How unevenly the lens fills each pixel's disc, because the CoC varies around the pixel.

    From the aperture point u, |u| <= 1, the pixel at p appears at p + coc / 2 * u, enlarged by the
    determinant of that map, 1 + u . grad(coc) / 2. The point d = coc / 2 * u of the disc thus gets
    1 + skew . d times its even share, skew = grad(coc) / coc. The gradient is limited: a depth edge
    is no slope, and none is steeper than 1 px a pixel.

    Args:
        coc_px: signed CoC diameter (h, w), NaN where the object is not [px].

    Returns:
        Skew along columns and rows (h, w, 2), fading out below `SKEW_FADE_PX`, where pixels are
        larger than discs; 0 where the object is not [1 / px].
    """
    slope = np.stack([_slope(coc_px, 1), _slope(coc_px, 0)], axis=2)
    length = np.sqrt((slope * slope).sum(axis=2))
    damped = coc_px / (coc_px * coc_px + SKEW_FADE_PX * SKEW_FADE_PX) / np.maximum(length, 1.0)
    return np.asarray(np.nan_to_num(slope * damped[..., None]), dtype=np.float32)


def _slope(coc_px: Float32, axis: int) -> Float32:
    """The smaller of the differences to both neighbours, 0 where they disagree in sign."""
    nothing = np.full_like(np.take(coc_px, [0], axis), np.nan)
    rise = np.diff(coc_px, axis=axis, append=nothing)
    fall = np.diff(coc_px, axis=axis, prepend=nothing)
    smaller = np.where(np.abs(rise) < np.abs(fall), rise, fall)
    both = np.where(rise * fall > 0.0, smaller, np.float32(0.0))
    one = np.where(np.isnan(rise), fall, rise)
    return np.asarray(np.nan_to_num(np.where(np.isnan(rise) | np.isnan(fall), one, both)))


def _beyond_covered(mask: Bool, within: tuple[slice, slice]) -> Bool:
    """Pixels outside `within` whose nearest pixel inside it is covered."""
    rows = np.clip(np.arange(mask.shape[0]), within[0].start, within[0].stop - 1)
    columns = np.clip(np.arange(mask.shape[1]), within[1].start, within[1].stop - 1)
    beyond = mask[rows][:, columns]
    beyond[within] = False
    return beyond


def gather_subaperture_ref(
    light: Float32, covered: Bool, coc_px: Float32, target: Box, *, pixel_aspect: float = 1.0
) -> Float64:
    """Blur a view over its cell; arguments and result as `gather_subaperture`."""
    out = np.zeros((target.height, target.width, 4))
    sources = [(int(y), int(x)) for y, x in np.argwhere(covered)]
    for y in range(target.y0, target.y1):
        for x in range(target.x0, target.x1):
            inside = 0 <= y < covered.shape[0] and 0 <= x < covered.shape[1]
            own = float(coc_px[y, x]) if inside and covered[y, x] else -math.inf
            before, near = np.zeros(4), 0.0
            behind, far = np.zeros(4), 0.0
            for row, column in sources:
                coc = float(coc_px[row, column])
                distance = math.hypot(column - x, (row - y) / pixel_aspect)
                if coc > own:
                    weight = _weight(distance, coc, pixel_aspect)
                    before += weight * light[row, column]
                    near += weight
                else:
                    weight = _weight(distance, own, pixel_aspect)
                    behind += weight * light[row, column]
                    far += weight
            if own > -math.inf:  # beyond the object's own pixels its disc sees nothing
                far += _empty(covered, (y, x), own, pixel_aspect)
                behind *= max(1.0 - near, 0.0) / far
            out[y - target.y0, x - target.x0] = before / max(near, 1.0) + behind
    return out


def _weight(distance: float, coc_px: float, pixel_aspect: float) -> float:
    """Share of a disc's light on a pixel."""
    place = 0.5 * abs(coc_px) * STEPS
    table = subaperture_table(pixel_aspect)
    entry = int(place)
    radius, share = table[:, entry] + (place - entry) * (table[:, entry + 1] - table[:, entry])
    return float(ramp(np.array(distance), float(radius)) * share)


def _empty(covered: Bool, at: tuple[int, int], coc_px: float, pixel_aspect: float) -> float:
    """Weight, in the disc of a pixel, of those where the object is not."""
    reach = math.ceil((0.5 * abs(coc_px) + 2.0) * max(1.0, pixel_aspect))
    wide = np.pad(covered, reach)
    total = 0.0
    for dy in range(-reach, reach + 1):
        for dx in range(-reach, reach + 1):
            if not wide[at[0] + dy + reach, at[1] + dx + reach]:
                distance = math.hypot(dx, dy / pixel_aspect)
                total += _weight(distance, coc_px, pixel_aspect)
    return total
