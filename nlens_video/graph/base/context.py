"""What nodes are made from."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import Protocol

from nlens_video.core.aperture import ROUND, Aperture
from nlens_video.core.layers import CocMap, OcclusionCue, Picture
from nlens_video.core.shutter import Shutter
from nlens_video.effects.measurement import Measurement
from nlens_video.graph.base.object_source import ObjectSource
from nlens_video.kernels.scatter.scatter import Spread
from nlens_video.scene.posed import PosedScene
from nlens_video.scene.scene_light import SceneLight
from nlens_video.stages.protocols import BehindRenderer, ReblurNetwork, ViewRenderer


@dataclass(frozen=True, slots=True, kw_only=True)
class ShadowScene:
    """What a shadow is cast from.

    Attributes:
        pose: the scene at a time [s].
        light: what lights it.
        pre_rendered: whether the object comes with its own light, as layers do.
        strength: of the shadow, 1 as the light has it [1].
        strength_given: whether the user has said it.
    """

    pose: Callable[[float], PosedScene]
    light: SceneLight
    pre_rendered: bool
    strength: float
    strength_given: bool = False


class OcclusionSource(Protocol):
    """Tells what really stands before the object, frame by frame."""

    @property
    def description(self) -> str:
        """What tells it, in words."""
        ...

    def read(self, index: int, picture: Picture, plate_coc: CocMap | None) -> OcclusionCue:
        """What is known of a frame, its picture as it was decoded.

        Args:
            index: of the frame.
            picture: the plate.
            plate_coc: its CoC, where this very frame's is known already.
        """
        ...


@dataclass(frozen=True, kw_only=True)
class NodeContext:
    """What nodes are made from.

    Attributes:
        objects: the object's place, geometry and picture.
        estimate_coc: loads F; called only by a pipeline that needs it.
        ground_y: height of the ground plane, None for the object's lowest point at time 0.
        fallback_constant: whether a constant CoC may stand in for a fit that fails.
        pixel_aspect: width of a pixel by its height [1].
        aperture: shape of the lens' aperture.
        spread: spreads the scatter's discs, None for the CPU's kernel.
        views: draws the object from points of the lens, None where only one view of it is there.
        hidden: draws what the object hides of itself, None where that is not known.
        repair: the network that repairs the scatter, None where there is none.
        shadow_scene: what stands on the ground, and its light; None: no shadow to cast.
        shutter: of the plate.
        measured: what the plate's first pictures say, by effect.
        occlusion: tells what really stands before the object, None where nothing does.
        reflectance: of the ground seen from straight above, 0 to 1 [1].
    """

    objects: ObjectSource
    estimate_coc: Callable[[], Callable[[Picture, Sequence[Picture]], CocMap]]
    ground_y: float | None
    fallback_constant: bool
    pixel_aspect: float
    aperture: Aperture = ROUND
    spread: Spread | None = None
    views: ViewRenderer | None = None
    hidden: BehindRenderer | None = None
    repair: ReblurNetwork | None = None
    shadow_scene: ShadowScene | None = None
    shutter: Shutter = Shutter()
    measured: Mapping[str, Measurement] = field(default_factory=dict)
    occlusion: OcclusionSource | None = None
    reflectance: float = 0.0

    @cached_property
    def ground_height(self) -> float:
        """Height of the ground: as given, else the object's lowest point at time 0 [scene unit]."""
        if self.ground_y is not None:
            return self.ground_y
        return float(self.objects.footprint(0.0)[:, :, 1].min())
