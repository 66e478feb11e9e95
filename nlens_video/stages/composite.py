"""Compositing: the blurred object over the plate, behind foreground mattes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlens_video.core.layers import BlurredLayer, Box, Float32, Picture


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ForegroundMatte:
    """Matte of a real thing in front of a layer, on a box of the frame.

    Attributes:
        box: where the arrays lie; inside the frame.
        coverage: share of each pixel (h, w) that it covers, 0 to 1 [1].
        light: its scene-linear light, premultiplied by that (h, w, 3).
    """

    box: Box
    coverage: Float32
    light: Float32


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Foreground:
    """Foreground mattes of one frame; None: nothing in front.

    Attributes:
        before_object: what stands nearer than the object.
        before_ground: what stands nearer than the ground that the plate would show.
    """

    before_object: ForegroundMatte | None
    before_ground: ForegroundMatte | None


def composite_behind(
    picture: Picture, box: Box, rgba: Float32, cover: ForegroundMatte | None
) -> None:
    """Composite a layer on the plate, behind what covers it.

    Where nothing covers it this is `Picture.over`; what is covered wholly keeps its samples.

    Args:
        picture: the plate; changed.
        box: where the layer lies; inside the frame.
        rgba: premultiplied scene-linear layer (h, w, 4).
        cover: what stands before it.
    """
    if cover is not None:
        common = box.intersection(cover.box)
        if not common.empty:
            rgba = rgba.copy()
            inside, at = common.slices_in(box), common.slices_in(cover.box)
            rgba[inside] = behind(
                rgba[inside], picture.linear(common), cover.coverage[at], cover.light[at]
            )
    picture.over(box, rgba)


def behind(rgba: Float32, plate: Float32, coverage: Float32, light: Float32) -> Float32:
    """The layer whose *over* on a plate puts another layer behind a foreground.

    Args:
        rgba: premultiplied layer (h, w, 4).
        plate: scene-linear light (h, w, 3), with all that was laid behind the same cover before.
        coverage: of the foreground (h, w) [1].
        light: of the foreground, premultiplied (h, w, 3).

    Returns:
        (h, w, 4), all 0 where the coverage is 1; its light may be negative where the foreground is
        darker than the background.
    """
    m, alpha = coverage[..., None], rgba[..., 3:]
    free = np.float32(1.0) - m
    rgb = free * rgba[..., :3] + alpha * (light - m * plate)
    hidden = np.concatenate([rgb, free * alpha], axis=2)
    hidden[coverage <= 0.0] = rgba[coverage <= 0.0]
    hidden[coverage >= 1.0] = 0.0
    return np.asarray(hidden, dtype=np.float32)


def composite(
    picture: Picture, blurred: BlurredLayer, foreground: Foreground | None = None
) -> Picture:
    """Lay the object over the plate in place, in scene-linear light; the picture itself comes back.

    Samples that the object does not reach keep their exact values.

    Args:
        picture: the plate; changed.
        blurred: the object as the lens sees it.
        foreground: what really stands before it.
    """
    if not blurred.box.empty:
        cover = None if foreground is None else foreground.before_object
        composite_behind(picture, blurred.box, blurred.rgba, cover)
    return picture
