"""Definition of `scatter`: every source pixel adds its own disc, one after the other."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from nlens_video.core.layers import Bool, Box, Float32
from nlens_video.core.optics import ROUND, Aperture
from nlens_video.kernels.scatter.disc import MAX_COC_PX
from nlens_video.kernels.scatter.shape import barrel_centre
from nlens_video.kernels.scatter.tables import coverage


def scatter_ref(
    rgba: Float32,
    coc_px: Float32,
    *,
    pixel_aspect: float = 1.0,
    aperture: Aperture = ROUND,
    frame: Box | None = None,
) -> Float32:
    """Blur an object's layer by its own CoC; arguments, result and errors as `scatter.scatter`."""
    out = np.zeros(rgba.shape, dtype=np.float32)
    layer = prepare(rgba, coc_px, pixel_aspect, aperture)
    if layer is None:
        return out
    frame = Box(0, 0, rgba.shape[1], rgba.shape[0]) if frame is None else frame
    middle = layer.box.x0 - frame.x0 + 0.5, layer.box.y0 - frame.y0 + 0.5
    height, width = layer.radius_px.shape
    margin = layer.margin + 1
    colour = np.zeros((height + 2 * margin, width + 2 * margin, 4))
    weight = np.zeros((height + 2 * margin, width + 2 * margin))
    for y, x in np.argwhere(np.isfinite(layer.radius_px)):
        radius = float(layer.radius_px[y, x])
        barrel = barrel_centre(
            aperture,
            np.array((x + middle[0]) * pixel_aspect),
            np.array(y + middle[1]),
            (frame.width * pixel_aspect, frame.height),
        )
        disc = coverage(aperture, abs(radius), pixel_aspect, (float(barrel[0]), float(barrel[1])))
        if radius > 0.0:
            disc = disc[::-1, ::-1]
        up, left = disc.shape[0] // 2, disc.shape[1] // 2
        dy = np.arange(-up, up + 1)[:, None] * layer.skew[y, x, 1]
        dx = np.arange(-left, left + 1)[None, :] * layer.skew[y, x, 0]
        disc = disc * (1.0 + dx + dy)
        spot = (
            slice(y + margin - up, y + margin + up + 1),
            slice(x + margin - left, x + margin + left + 1),
        )
        colour[spot] += disc[..., None] * layer.rgba[y, x]
        weight[spot] += disc
    kept = np.s_[margin : margin + height, margin : margin + width]
    blurred = colour[kept] / np.maximum(weight[kept], 1e-30)[..., None]
    blurred[..., 3] = np.clip(blurred[..., 3], 0.0, 1.0)
    target = layer.target
    out[target.y0 : target.y1, target.x0 : target.x1] = blurred[target.slices_in(layer.box)]
    return out


Index = npt.NDArray[np.intp]

SKEW_FADE_PX = 1.5
"""CoC at which the skew of a disc is half in force [px]."""


@dataclass(frozen=True, slots=True, kw_only=True)
class PreparedLayer:
    """What a scatter kernel reads: the object and the virtual background within reach of it.

    Attributes:
        box: where the arrays lie in the caller's array; reaches beyond it where the object is near
            a border.
        target: the pixels that the object can reach, inside both `box` and the caller's array.
        rgba: premultiplied colour and alpha (h, w, 4), 0 where the object is not.
        radius_px: signed radius in columns of each pixel's disc (h, w), NaN where a pixel takes no
            part [px].
        skew: how the light of a disc grows along columns and rows (h, w, 2), see `coc_skew`
            [1 / px].
        margin: how far discs reach at most [px].
    """

    box: Box
    target: Box
    margin: int
    rgba: Float32
    radius_px: Float32
    skew: Float32


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


def prepare(
    rgba: Float32, coc_px: Float32, pixel_aspect: float, aperture: Aperture = ROUND
) -> PreparedLayer | None:
    """Check a layer and cut it to what can matter; None where it holds no covered pixel.

    Beyond a border of the array transparent pixels go on as virtual background; covered ones are
    not invented, so that weights there are renormalised with what lies inside.

    Raises:
        ValueError: shapes that do not belong together, values that are not finite.
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
    if not covered.any():
        return None
    whole = Box(0, 0, rgba.shape[1], rgba.shape[0])
    largest = 0.5 * min(float(np.abs(coc_px[covered]).max()), MAX_COC_PX)
    weights = coverage(aperture, largest * max(1.0, pixel_aspect), 1.0)
    margin = max(weights.shape) // 2
    box = Box.of(covered).expanded(2 * margin + 1)
    inside = box.intersection(whole)
    source, within = inside.slices_in(whole), inside.slices_in(box)
    shape = (box.height, box.width)
    mask = np.zeros(shape, dtype=np.bool_)
    mask[within] = covered[source]
    coc = np.full(shape, np.nan, dtype=np.float32)
    coc[within] = np.where(mask[within], coc_px[source], np.float32(np.nan))
    colour = np.zeros((*shape, 4), dtype=np.float32)
    colour[within] = np.where(mask[within][..., None], rgba[source], np.float32(0.0))
    nearest, distance = nearest_covered(mask)
    limit = np.float32(0.5 * MAX_COC_PX)
    radius = np.clip(np.float32(0.5) * coc.ravel()[nearest], -limit, limit)
    radius[_beyond_covered(mask, within) | (distance > 2 * margin + 1)] = np.nan
    skew = coc_skew(coc)  # 0 where the object is not: the CoC is extended as a constant
    target = Box.of(covered).expanded(margin).intersection(whole)
    return PreparedLayer(
        box=box, target=target, margin=margin, rgba=colour, radius_px=radius, skew=skew
    )


def _beyond_covered(mask: Bool, within: tuple[slice, slice]) -> Bool:
    """Pixels outside `within` whose nearest pixel inside it is covered."""
    rows = np.clip(np.arange(mask.shape[0]), within[0].start, within[0].stop - 1)
    columns = np.clip(np.arange(mask.shape[1]), within[1].start, within[1].stop - 1)
    beyond = mask[rows][:, columns]
    beyond[within] = False
    return beyond
