"""L as the paper has it: the network blurs the naive composite (section 4.2, "Lens Reblur").

The sharp object lies over the plate, which already is defocused; the CoC map holds the object's CoC
and zero everywhere else. A classical scatter of the whole picture and a neural rendering of it are
blended by an error map that the network predicts (BokehMe, Peng et al. 2022). It is the reference
for what the paper's method costs. The other presets keep object and plate apart.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

import cv2
import numpy as np
from msgspec import Struct

from nlens_video.core.layers import BlurredLayer, Box, DefocusedLayer, Float32, Picture

NEURAL_RADIUS_PX = 10.0
"""Largest radius that the networks blur by; larger ones at a fraction of the size [px]."""

GAMMA = 2.2
"""The networks read code values, light^(1 / GAMMA)."""

SPARE_PX = 4
"""How much farther than the largest disc the result may differ from the plate [px]."""

_MASK_SIGMA = 0.005  # of height + width: BokehMe's softness between levels

PaperScatter = Callable[[Float32, Float32], tuple[Float32, Float32]]


class PaperNetworks(Protocol):
    """BokehMe's two networks on code values; any size."""

    def render(self, code: Float32, defocus: Float32) -> tuple[Float32, Float32]:
        """ARNet: blur a picture (h, w, 3) by `defocus` (h, w), in units of NEURAL_RADIUS_PX.

        Returns:
            The blurred picture (h, w, 3) and where the classical one is wrong (h, w), in [0, 1].
        """
        ...

    def refine(self, code: Float32, defocus: Float32, coarse: Float32) -> Float32:
        """IUNet: the blurred picture (h, w, 3) at twice the size of `coarse`, or at any other."""
        ...


def level_sizes(shape: tuple[int, int], largest_radius_px: float) -> list[tuple[int, int]]:
    """Sizes (h, w) that the neural rendering goes through, from ARNet's to the picture's.

    The first is as many halvings down as bring the radius to NEURAL_RADIUS_PX. The scale is a power
    of two, so that it seldom changes from frame to frame.
    """
    halvings = max(0, int(np.ceil(np.log2(max(largest_radius_px, 1e-6) / NEURAL_RADIUS_PX))))
    return [
        (-(-shape[0] // 2**level), -(-shape[1] // 2**level)) for level in range(halvings, -1, -1)
    ]


def neural_rendering(
    code: Float32, radius_px: Float32, dilated_px: Float32, networks: PaperNetworks
) -> tuple[Float32, Float32]:
    """ARNet at a size where all radii are small, IUNet up to the full size.

    Args:
        code: code values (h, w, 3).
        radius_px: signed radius (h, w) [px].
        dilated_px: largest radius whose disc covers each pixel (h, w) [px].
        networks: both.

    Returns:
        The blurred picture (h, w, 3) and the error map (h, w).
    """
    sizes = level_sizes(radius_px.shape, float(np.abs(radius_px).max()))
    defocus, dilated = radius_px / NEURAL_RADIUS_PX, dilated_px / NEURAL_RADIUS_PX
    share = sizes[0][0] / sizes[-1][0]
    neural, error = networks.render(_at(code, sizes[0]), share * _at(defocus, sizes[0]))
    for size in sizes[1:] or sizes:
        share = size[0] / sizes[-1][0]
        small = np.clip(share * _at(defocus, size), -1.0, 1.0).astype(np.float32)
        refined = networks.refine(_at(code, size), small, neural)
        within = (share * _at(dilated, size) < 1.0).astype(np.float32)
        mask = cv2.GaussianBlur(within, (0, 0), _MASK_SIGMA * sum(size))[..., None]
        neural = mask * refined + (1.0 - mask) * _at(neural, size)
    return neural, np.clip(_at(error, sizes[-1]), 0.0, 1.0)


def _at(values: Float32, size: tuple[int, int]) -> Float32:
    """Resized to (h, w), with the corners kept where they are as BokehMe does."""
    if values.shape[:2] == size:
        return values
    method = cv2.INTER_AREA if size[0] < values.shape[0] else cv2.INTER_LINEAR
    return np.asarray(cv2.resize(values, size[::-1], interpolation=method), dtype=np.float32)


def paper_reblur(
    light: Float32, coc_px: Float32, scatter: PaperScatter, networks: PaperNetworks
) -> Float32:
    """Blur a naive composite as the paper does.

    Args:
        light: scene-linear naive composite (h, w, 3).
        coc_px: signed CoC diameter, zero off the object (h, w) [px].
        scatter: (light, radius_px) -> blurred light and dilated radius.
        networks: ARNet and IUNet.

    Returns:
        The blurred composite (h, w, 3), scene-linear.
    """
    radius = np.asarray(0.5 * coc_px, dtype=np.float32)
    classical, dilated = scatter(light, np.abs(radius))
    code = np.asarray(np.maximum(light, 0.0) ** (1.0 / GAMMA), dtype=np.float32)
    neural, error = neural_rendering(code, radius, dilated, networks)
    coded = np.maximum(classical, 0.0) ** (1.0 / GAMMA)
    blended = coded + error[..., None] * (np.maximum(neural, 0.0) - coded)
    return np.asarray(np.maximum(blended, 0.0) ** GAMMA, dtype=np.float32)


class PaperReblur(Struct, frozen=True, kw_only=True):
    """The paper's L as a stage: the whole frame goes through, the object's reach is kept.

    Attributes:
        scatter: the classical renderer.
        networks: ARNet and IUNet.
    """

    scatter: PaperScatter
    networks: PaperNetworks

    def __call__(self, picture: Picture, defocused: DefocusedLayer, frame: Box) -> BlurredLayer:
        """Blur one frame.

        Args:
            picture: the plate.
            defocused: the sharp object and its CoC.
            frame: the frame's own box.

        Returns:
            An opaque layer where the object's blur reaches, nothing elsewhere.
        """
        layer = defocused.layer
        reach = int(np.ceil(0.5 * defocused.largest_coc_px)) + SPARE_PX
        box = layer.box.expanded(reach).intersection(frame)
        if box.empty:
            return BlurredLayer.nothing()
        plate = picture.linear(frame)
        common = layer.box.intersection(frame)
        light, coc = plate.copy(), np.zeros(plate.shape[:2], np.float32)
        near = np.zeros(plate.shape[:2], np.uint8)
        if not common.empty:
            inside, cut = common.slices_in(frame), common.slices_in(layer.box)
            rgba = layer.rgba[cut]
            light[inside] = rgba[..., :3] + (1.0 - rgba[..., 3:]) * plate[inside]
            coc[inside] = np.where(rgba[..., 3] > 0.0, defocused.coc_px[cut], np.float32(0.0))
            near[inside] = rgba[..., 3] > 0.0
        blurred = paper_reblur(light, coc, self.scatter, self.networks)
        disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * reach + 1, 2 * reach + 1))
        kept = cv2.dilate(near, disc).astype(np.float32)
        rgba = np.dstack([blurred * kept[..., None], kept])
        return BlurredLayer(box=box, rgba=np.ascontiguousarray(rgba[box.slices_in(frame)]))
