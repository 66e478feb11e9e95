"""The values that nodes hand to each other: an attribute a port, its annotation the type."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from nlens_video.core.layers import (
        BlurredLayer,
        Box,
        CocMap,
        DefocusedLayer,
        ObjectLayer,
        OcclusionCue,
        Picture,
    )  # fmt: skip
    from nlens_video.core.lens_fit import LensFit
    from nlens_video.effects.exposure import Exposure
    from nlens_video.effects.motion_blur import Motion
    from nlens_video.effects.shadow.apply import Shadow
    from nlens_video.graph.base.object_source import ScreenBounds
    from nlens_video.scene.illumination import Illumination
    from nlens_video.stages.composite import Foreground
    from nlens_video.stages.p_projection import GroundProjection
    from nlens_video.stages.r_regression import Regression
    from nlens_video.stages.reblur.view_blend import ViewBlend
from typing import Protocol

from nlens_video.core.layers import Picture


@dataclass(frozen=True, slots=True, kw_only=True)
class FoundLens:
    """R's result on one frame.

    Attributes:
        fit: the lens.
        regression: the fit with its samples; None where a constant CoC stands in for it.
        doubt: what a person should know about it; empty if nothing.
    """

    fit: LensFit
    regression: Regression | None
    doubt: str = ""


@dataclass(slots=True, kw_only=True)
class FrameValues:
    """The values of one frame on its way through the graph. None: no node has written it.

    Attributes:
        frame: the source's frame; given.
        picture: the plate, composited in place; given.
        frame_box: the pixels that are composited: the frame, or more while a lens distorts; given.
        following: pictures of later frames, where the source may be read ahead; given.
        fit: the lens, once it is known; given, or from `found_lens`.
        plate_light: the light on the object, estimated from the plate.
        bounds: the object's time, camera and bounds.
        plate_coc: the plate's CoC (F).
        ground: footprint of the object and ground plane (P).
        found_lens: the lens fit of this frame (R).
        exposure: the plate's exposure against the first frame.
        motion: the object's motion on the screen while the shutter is open.
        moments: the same, where the object must be rendered at several moments.
        layer: the object, sharp.
        defocused: the object, sharp, with its CoC and what it hides of itself.
        views: the mean of a few aperture samples, where discs are small.
        shadow: the object's shadow on the ground.
        reflection: the object's mirror image in the ground.
        occlusion_cue: what is known of real things in front.
        foreground: what hides object and ground.
        blurred: the object as the lens shows it, on its way through the chain of layer operations.
    """

    frame: StreamFrame
    picture: Picture
    frame_box: Box
    following: tuple[Picture, ...] | None = None
    fit: LensFit | None = None
    plate_light: Illumination | None = None
    bounds: ScreenBounds | None = None
    plate_coc: CocMap | None = None
    ground: GroundProjection | None = None
    found_lens: FoundLens | None = None
    exposure: Exposure | None = None
    motion: Motion | None = None
    moments: Motion | None = None
    layer: ObjectLayer | None = None
    defocused: DefocusedLayer | None = None
    views: ViewBlend | None = None
    shadow: Shadow | None = None
    reflection: DefocusedLayer | None = None
    occlusion_cue: OcclusionCue | None = None
    foreground: Foreground | None = None
    blurred: BlurredLayer | None = None


@dataclass(slots=True, kw_only=True)
class ShotValues:
    """What the lens was found from, kept for reports: the last values of these ports."""

    plate_coc: CocMap | None = None
    ground: GroundProjection | None = None
    found_lens: FoundLens | None = None


GIVEN = ("frame", "picture", "frame_box", "following", "fit")
"""Ports that hold a value before the first node runs."""


class StreamFrame(Protocol):
    """A frame of a source, as the graph needs it; see `video.source`."""

    @property
    def index(self) -> int:
        """Position in the stream."""
        ...

    @property
    def number(self) -> int:
        """The same with lost pictures counted, for files that lie beside the stream's."""
        ...

    @property
    def time_s(self) -> float:
        """Moment of the animation [s]."""
        ...

    @property
    def picture(self) -> Picture:
        """The plate; composited in place."""
        ...


@dataclass(frozen=True, slots=True)
class LoopFrame:
    """A frame of somebody's own loop."""

    index: int
    time_s: float
    picture: Picture

    @property
    def number(self) -> int:
        """Its index: nothing is lost in a loop."""
        return self.index
