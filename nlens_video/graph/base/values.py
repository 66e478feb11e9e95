"""Values on the edges of the frame graph: one typed attribute per port."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

from msgspec import Struct

if TYPE_CHECKING:
    from nlens_video.core.layers import (
        BlurredLayer,
        Box,
        CocMap,
        DefocusedLayer,
        DepthMap,
        ObjectLayer,
        Picture,
    )
    from nlens_video.core.lens_fit import LensFit
    from nlens_video.effects.exposure import Exposure
    from nlens_video.effects.motion_blur import Motion
    from nlens_video.effects.occlusion_cues import OcclusionCue
    from nlens_video.effects.shadow.apply import Shadow
    from nlens_video.effects.shadow.casters import FrameCasters
    from nlens_video.graph.base.view import ScreenBounds
    from nlens_video.scene.illumination import Illumination
    from nlens_video.stages.composite import Foreground
    from nlens_video.stages.l_view_blend import ViewBlend
    from nlens_video.stages.p_projection import GroundProjection
    from nlens_video.stages.r_regression import Regression
    from nlens_video.video.info import SourceFrame

FramesFitted = Literal["one", "several"]
"""On how many frames the lens is fitted: on several, these fits are compared or pooled.

Then each is read in the same way, off F's readings alone.
"""


class FoundLens(Struct, frozen=True, kw_only=True):
    """R's result on one frame.

    Attributes:
        fit: the lens.
        regression: the fit with its samples; None where a constant CoC or a known lens stands in.
        warning: why the fit may be wrong; empty for a sound one.
    """

    fit: LensFit
    regression: Regression | None
    warning: str = ""


@dataclass(slots=True, kw_only=True)
class FrameValues:
    """Values of one frame. None: no node has written the port on this frame.

    Attributes:
        frame: index, time [s] and picture from the source; given.
        picture: the plate, in its own pixel format; composited in place; given.
        frame_box: the pixels that are composited: the frame, with overscan under a distortion;
            given.
        following: pictures of later frames, where the source can be read ahead; given.
        lens_before: the lens so far, on a frame of a stream whose blur differs from it; given.
        frames_fitted: whether other frames of the shot are fitted too; given.
        fit: linear lens model coc_px = slope * disparity + intercept; given, or from `found_lens`.
        plate_light: lighting of the object, estimated from the plate.
        bounds: time, camera, screen bounds and depth range of the object.
        plate_coc: unsigned CoC diameter of the plate and its expected error (H, W) [px] (F).
        plate_depth: depth of what the plate shows, as the pinhole camera sees it.
        ground: footprint mask and disparity of the ground plane (H, W) (P).
        found_lens: lens fit of this frame with its samples (R).
        exposure: gain of the plate per channel relative to the first frame.
        motion: screen-space motion of the object over the shutter interval.
        moments: the same motion, where temporal samples of the object are rendered.
        layer: premultiplied colour, coverage and depth of the sharp object.
        defocused: that layer with its signed CoC [px] and the surfaces that it hides.
        views: mean of a few aperture samples, and its share of the result.
        casters: what casts the shadow, and the light on the ground.
        shadow: share of the ground's light that the object blocks, with the ground's CoC.
        darkening: what darkens the plate, as a layer whose colours are multiples of its light.
        reflection: mirror image of the object in the ground, with its CoC.
        mirrored: the mirror image blurred by the lens; value of its chain of layer operations.
        occlusion_cue: matte, depth map or CoC map from which occlusion is derived.
        foreground: mattes of real things before the object and before the ground.
        blurred: the object's layer blurred by the lens; value of the chain of layer operations.
    """

    frame: SourceFrame
    picture: Picture
    frame_box: Box
    following: tuple[Picture, ...] | None = None
    lens_before: LensFit | None = None
    frames_fitted: FramesFitted = "one"
    fit: LensFit | None = None
    plate_light: Illumination | None = None
    bounds: ScreenBounds | None = None
    plate_coc: CocMap | None = None
    plate_depth: DepthMap | None = None
    ground: GroundProjection | None = None
    found_lens: FoundLens | None = None
    exposure: Exposure | None = None
    motion: Motion | None = None
    moments: Motion | None = None
    layer: ObjectLayer | None = None
    defocused: DefocusedLayer | None = None
    views: ViewBlend | None = None
    casters: FrameCasters | None = None
    shadow: Shadow | None = None
    darkening: BlurredLayer | None = None
    reflection: DefocusedLayer | None = None
    mirrored: BlurredLayer | None = None
    occlusion_cue: OcclusionCue | None = None
    foreground: Foreground | None = None
    blurred: BlurredLayer | None = None

    def drop_maps(self) -> None:
        """Free the maps that the lens was found from: all that reads them runs on one lane."""
        for port in MAPS:
            setattr(self, port, None)


@dataclass(slots=True, kw_only=True)
class ShotValues:
    """Latest values of the ports that the lens was found from.

    Attributes:
        keeps_maps: whether the maps are kept, which take as much as a few frames; for reports.
    """

    keeps_maps: bool = False
    plate_coc: CocMap | None = None
    ground: GroundProjection | None = None
    found_lens: FoundLens | None = None

    def take(self, port: str, value: object) -> None:
        """Keep what a node has written to a port, if that is one of these."""
        if port == "found_lens" or (port in MAPS and self.keeps_maps):
            setattr(self, port, value)


MAPS = ("plate_coc", "ground")
"""Ports that hold maps of the size of the frame, from which the lens is found."""
GIVEN = ("frame", "picture", "frame_box", "following", "lens_before", "frames_fitted", "fit")
"""Ports with a value before the first node runs."""
