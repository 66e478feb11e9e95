"""Nodes of the plate's camera on the mirror image, each as its like on the object's layer.

The mirror image is a layer of its own, and not one with the object's: things may stand before the
ground that do not stand before the object, and the plate past its border does not move with that
of the object.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from nlens_video.effects.camera.bloom import add_bloom
from nlens_video.effects.camera.chromatic_aberration import displace_channels
from nlens_video.effects.camera.softness import missing_sigma, soften
from nlens_video.effects.camera.vignetting import vignette
from nlens_video.effects.exposure import match_exposure
from nlens_video.graph.nodes.camera import BloomNode, ChromaticAberration, Grain, Soften, Vignette
from nlens_video.graph.nodes.exposure import MatchExposure

if TYPE_CHECKING:
    from nlens_video.core.layers import BlurredLayer, Box, DefocusedLayer, Picture
    from nlens_video.effects.exposure import Exposure
    from nlens_video.video.info import SourceFrame


class VignetteReflection(Vignette):
    """Vignetting of the mirror image."""

    name, writes = "vignette-reflection", "mirrored"
    same_with = ("mirrored", "frame_box")

    def __call__(self, mirrored: BlurredLayer, frame_box: Box) -> BlurredLayer:
        return vignette(mirrored, self._model, frame_box)


class MatchExposureReflection(MatchExposure):
    """Exposure drift applied to the mirror image."""

    name, writes = "match-exposure-reflection", "mirrored"

    def __call__(self, mirrored: BlurredLayer, exposure: Exposure) -> BlurredLayer:
        return match_exposure(mirrored, exposure)


class BloomReflection(BloomNode):
    """Bloom around the highlights of the mirror image."""

    name, writes = "bloom-reflection", "mirrored"
    same_with = ("mirrored", "frame_box")

    def __call__(self, mirrored: BlurredLayer, frame_box: Box) -> BlurredLayer:
        return add_bloom(mirrored, self._model, frame_box)


class SoftenReflection(Soften):
    """Floor softness of the mirror image."""

    name, writes = "soften-reflection", "mirrored"
    same_with = ("mirrored", "frame_box", "reflection")

    def __call__(
        self, mirrored: BlurredLayer, frame_box: Box, reflection: DefocusedLayer | None
    ) -> BlurredLayer:
        return soften(mirrored, missing_sigma(self._floor, reflection), frame_box)


class ChromaticAberrationReflection(ChromaticAberration):
    """Lateral chromatic aberration of the mirror image."""

    name, writes = "chromatic-aberration-reflection", "mirrored"

    def __call__(self, mirrored: BlurredLayer, picture: Picture, frame_box: Box) -> BlurredLayer:
        return displace_channels(mirrored, self._model, picture, frame_box)


class GrainReflection(Grain):
    """Grain of the mirror image."""

    name, writes = "grain-reflection", "mirrored"
    draw = 1

    def __call__(
        self, picture: Picture, mirrored: BlurredLayer, frame: SourceFrame
    ) -> BlurredLayer:
        return self._add(picture, mirrored, frame.index)
