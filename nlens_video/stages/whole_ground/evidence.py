"""What the ground as a whole tells of the lens, where F's readings are not sure."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from nlens_video.core.known_lens import NO_PRIOR, LensPrior
from nlens_video.core.layers import Bool, CocMap, Float64
from nlens_video.core.lens_fit import LensFit
from nlens_video.scene.camera import Camera
from nlens_video.stages.texture.reading import read_texture
from nlens_video.stages.whole_ground.combination import combined, lens_beforehand, lenses_of_fit
from nlens_video.stages.whole_ground.network_reading import LensNetwork, read_by_network
from nlens_video.stages.whole_ground.patches import ground_patches

SURE_PX = 1.0
"""Standard error of the CoC, in px of F, from which on the whole ground is read too."""

FASTEST = 6.0
"""Slope by the usual one beyond which a lens is not believed."""

_SHARP = 0.96  # log(1 + CoC) up to which F cannot tell a blur from the softness of a lens

Within = Callable[[Float64, Float64], Bool]
"""Whether places, columns and rows by the frame's size, lie in a part of the frame."""


def combined_with_ground(
    fit: LensFit, coc: CocMap, camera: Camera | None, ground_y: float, middle: float, *,
    known: LensPrior = NO_PRIOR, network: LensNetwork | None = None,
    within: Within | None = None,
) -> LensFit | None:  # fmt: skip
    """A fit by F's readings combined with what the whole ground tells, by their errors.

    That is the lens by its texture. Where that tells none, as in footage, it is the one by a
    network, which stands for F's readings: it has seen the same. It is combined with what is known
    beforehand.

    Args:
        fit: by the readings.
        coc: the plate's CoC, with the picture that it was read off, and its cells.
        camera: of the same frame, None where it is not at hand.
        ground_y: height of the ground [scene unit].
        middle: disparity of the ground where the object stands [1 / scene unit].
        known: of the lens beforehand; the fit holds it already.
        network: reads the lens off patches of the ground, None for the texture alone.
        within: the part of the frame that is read; None for all of it.

    Returns:
        None where the fit is sure, or the ground tells nothing.
    """
    if coc.luma is None or camera is None:
        return None
    height, width = coc.luma.shape
    scale = fit.width / width
    if fit.coc_stderr_px(middle) <= SURE_PX * scale:
        return None
    camera = camera.resized(width, height)
    part = None if within is None else lambda x, y: within(x / width, y / height)
    own = lenses_of_fit(fit)
    begin = [(lens.slope / scale, lens.intercept / scale) for lens in own]
    textures = read_texture(coc.luma, camera, ground_y, middle, begin, part)
    # a plain ground may look as if a very fast lens had blurred it wholly
    fastest = math.inf if known.usual_slope is None else FASTEST * known.usual_slope
    slow = [lens for one in textures if (lens := one.scaled(scale)).slope <= fastest]
    found = combined(fit, own, slow, middle, "the ground's texture")
    if found is not None or network is None or coc.cells is None:
        return found
    patches = ground_patches(coc.cells, (width, height), camera, ground_y, middle, part)
    if len(patches.readings) and float(np.quantile(patches.readings[:, 0], 0.9)) < _SHARP:
        return None
    lenses = [one.scaled(scale) for one in read_by_network(network, patches, middle)]
    return combined(fit, [lens_beforehand(known, fit, middle)], lenses, middle, "the lens network")
