"""What stages are made from, and what is kept of a shot."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Protocol

from nlens_video.core.aperture import ROUND, Aperture
from nlens_video.core.layers import CocMap, Front, Picture
from nlens_video.core.shutter import Shutter
from nlens_video.effects.measurement import Measurement
from nlens_video.graph.nodes.object_source import ObjectSource
from nlens_video.kernels.scatter.scatter import Spread
from nlens_video.scene.posed import PosedScene
from nlens_video.scene.scene_light import SceneLight
from nlens_video.stages.p_projection import GroundProjection
from nlens_video.stages.protocols import BehindRenderer, ReblurNetwork, ViewRenderer
from nlens_video.stages.r_regression import Regression


@dataclass(slots=True, kw_only=True)
class ShotRecord:
    """What the shot's fit was made from, kept for reports; one shot's worth.

    Attributes:
        plate_coc: the plate's CoC, once estimated.
        ground: footprint and plane, once projected.
        regression: the fit and its samples, once fitted.
        note: what a person should know about the fit, empty if nothing.
        ground_y: height of the ground plane, once asked for [scene unit].
    """

    plate_coc: CocMap | None = None
    ground: GroundProjection | None = None
    regression: Regression | None = None
    note: str = ""
    ground_y: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class LitGround:
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


class FrontSource(Protocol):
    """Tells what really stands before the object, frame by frame."""

    @property
    def description(self) -> str:
        """What tells it, in words."""
        ...

    def read(self, index: int, picture: Picture, plate_coc: CocMap | None) -> Front:
        """What is known of a frame, its picture as it was decoded.

        Args:
            index: of the frame.
            picture: the plate.
            plate_coc: its CoC, where this very frame's is known already.
        """
        ...


@dataclass(frozen=True, slots=True, kw_only=True)
class Tools:
    """What stages are made from.

    Attributes:
        objects: the object's place, geometry and picture.
        estimate_coc: loads F; called only by a pipeline that needs it.
        ground_y: height of the ground plane, None for the object's lowest point at time 0.
        fallback_constant: whether a constant CoC may stand in for a fit that fails.
        pixel_aspect: width of a pixel by its height [1].
        record: where the shot's intermediate results are kept.
        aperture: shape of the lens' aperture.
        spread: spreads the scatter's discs, None for the CPU's kernel.
        views: draws the object from points of the lens, None where only one view of it is there.
        behind: draws what the object hides of itself, None where that is not known.
        repair: the network that repairs the scatter, None where there is none.
        ground: what stands on the ground, and its light, None where there is no shadow to cast.
        shutter: of the plate.
        measured: what the plate's first pictures say, by effect.
        front: tells what really stands before the object, None where nothing does.
        reflectance: of the ground seen from straight above, 0 to 1 [1].
    """

    objects: ObjectSource
    estimate_coc: Callable[[], Callable[[Picture, Sequence[Picture]], CocMap]]
    ground_y: float | None
    fallback_constant: bool
    pixel_aspect: float
    record: ShotRecord
    aperture: Aperture = ROUND
    spread: Spread | None = None
    views: ViewRenderer | None = None
    behind: BehindRenderer | None = None
    repair: ReblurNetwork | None = None
    ground: LitGround | None = None
    shutter: Shutter = Shutter()
    measured: Mapping[str, Measurement] = field(default_factory=dict)
    front: FrontSource | None = None
    reflectance: float = 0.0

    def ground_height(self) -> float:
        """Height of the ground plane: as given, else the object's lowest point at time 0."""
        if self.record.ground_y is None:
            given = self.ground_y
            lowest = float(self.objects.footprint(0.0)[:, :, 1].min()) if given is None else given
            self.record.ground_y = lowest
        return self.record.ground_y


class Unavailable(Exception):
    """A stage that this installation cannot run, and why."""


@dataclass(frozen=True, slots=True)
class Made:
    """A stage ready to run.

    Attributes:
        run: the stage.
        backend: what runs it, in words.
        remembers: whether what it does on a frame depends on frames before it; such a stage takes
            nothing but `picture`, and sees the frames before a range, too.
    """

    run: Callable[..., object]
    backend: str
    remembers: bool = False


@dataclass(frozen=True, slots=True)
class Stage:
    """A stage that a pipeline file can name.

    Attributes:
        make: makes it.
        inputs: ports it is called with, in order; with "?" if one may be missing.
        output: port it gives a value for.
    """

    make: Callable[..., Made]
    inputs: tuple[str, ...]
    output: str
