"""Other methods' blur from the same sharp layer and CoC, as nodes that replace shipped ones."""

from __future__ import annotations

import math
from collections.abc import Callable

import cv2
import numpy as np

from nlens_video.core.layers import BlurredLayer, Box, DefocusedLayer, Float32, ObjectLayer
from nlens_video.core.lens_fit import LensFit
from nlens_video.effects.planner import DEFOCUS
from nlens_video.graph.base.node import OUT_OF_FOCUS, Node
from nlens_video.stages.l_reblur import crop_to_frame

SIGMA_PER_COC = 0.25
"""A disc of diameter D has a variance of D^2 / 16 along each axis."""

_REACH = 3.0  # a Gaussian's end [sigma]
_STEP_PX = 1.0  # between the sigmas of the layered Gaussian
_FAINT = 1e-9  # coverage below which nothing is near

Rival = Callable[[DefocusedLayer, Box], BlurredLayer]


def naive(defocused: DefocusedLayer, frame: Box) -> BlurredLayer:
    """The sharp object as it is."""
    return crop_to_frame(defocused.layer, frame)


def one_gaussian(defocused: DefocusedLayer, frame: Box) -> BlurredLayer:
    """One Gaussian for the whole object, its sigma a quarter of the object's mean CoC."""
    alpha = defocused.layer.rgba[..., 3]
    total = float(alpha.sum())
    mean_px = float((np.abs(defocused.coc_px) * alpha).sum()) / total if total else 0.0
    sigma = SIGMA_PER_COC * mean_px
    rgba, _, box = _padded(defocused, sigma)
    return _cropped(_blurred(rgba, sigma), box, frame)


def layered_gaussian(defocused: DefocusedLayer, frame: Box) -> BlurredLayer:
    """A Gaussian for each pixel's own CoC, as Blind Augmentation blurs its objects.

    Prakash et al. 2025: each pixel gathers colour under a mask and the mask itself with a Gaussian
    of its own sigma, which is painted on beyond the silhouette. Here the Gaussians come from layers
    of rising sigma. Kinder than the released code: that cuts its kernels at 15 px and smooths the
    sigma by 64 px. It dilates and erodes the mask where the real scene hides the object, which no
    scene of `bench` does.
    """
    last = math.ceil(SIGMA_PER_COC * defocused.largest_coc_px / _STEP_PX)
    sigma_most = _STEP_PX * last
    rgba, coc, box = _padded(defocused, sigma_most)
    own = np.float32(SIGMA_PER_COC) * np.abs(coc)
    sigma = _painted_on(own, rgba[..., 3], sigma_most)
    out = np.zeros_like(rgba)
    for at in range(last + 1):
        layer = _blurred(rgba, _STEP_PX * at)
        share = np.maximum(1.0 - np.abs(sigma / _STEP_PX - at), 0.0)
        out += share[..., None] * layer
    return _cropped(out, box, frame)


def _padded(defocused: DefocusedLayer, sigma_px: float) -> tuple[Float32, Float32, Box]:
    """Colour and CoC with room for a Gaussian around them."""
    margin = math.ceil(_REACH * sigma_px) + 1
    rgba = np.pad(defocused.layer.rgba, ((margin, margin), (margin, margin), (0, 0)))
    return rgba, np.pad(defocused.coc_px, margin), defocused.layer.box.expanded(margin)


def _blurred(rgba: Float32, sigma_px: float) -> Float32:
    if sigma_px < 0.1:
        return rgba
    side = 2 * math.ceil(_REACH * sigma_px) + 1
    return np.asarray(cv2.GaussianBlur(rgba, (side, side), sigma_px), dtype=np.float32)


def _painted_on(sigma_px: Float32, alpha: Float32, most_px: float) -> Float32:
    """The sigmas, and beyond the silhouette the mean of those near it."""
    spread = max(most_px, 1.0)
    weight = _blurred(alpha, spread)
    mean = _blurred(sigma_px * alpha, spread) / np.maximum(weight, _FAINT)
    return np.asarray(np.where(alpha > 0.0, sigma_px, mean), dtype=np.float32)


def _cropped(rgba: Float32, held: Box, frame: Box) -> BlurredLayer:
    box = held.intersection(frame)
    if box.empty:
        return BlurredLayer.nothing()
    return BlurredLayer(box=box, rgba=np.ascontiguousarray(rgba[box.slices_in(held)]))


RIVALS: dict[str, Rival] = {
    "naive": naive,
    "one Gaussian": one_gaussian,
    "layered Gaussian": layered_gaussian,
}


class RivalReblur(Node):
    """Another method's blur, in place of the scatter."""

    name, writes = "reblur", "blurred"
    effect, lane, when = DEFOCUS, "composite", OUT_OF_FOCUS

    def __init__(self, rival: Callable[[DefocusedLayer, Box], BlurredLayer]) -> None:
        self._rival = rival

    def __call__(self, defocused: DefocusedLayer, frame_box: Box) -> BlurredLayer:
        """Blur one frame's object."""
        return self._rival(defocused, frame_box)


class GivenCoc(Node):
    """A given CoC, in place of the lens fit's."""

    name, writes = "object-coc", "defocused"
    effect = DEFOCUS

    def __init__(self, coc: Callable[[ObjectLayer], DefocusedLayer]) -> None:
        self._coc = coc

    def __call__(self, layer: ObjectLayer, fit: LensFit) -> DefocusedLayer:
        """The object with the given CoC."""
        return self._coc(layer)
