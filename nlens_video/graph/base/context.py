"""Dependencies that nodes are constructed from: object, networks, renderer, measurements."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import cached_property
from typing import TYPE_CHECKING, Protocol

from msgspec import Struct, field

from nlens_video.core.known_lens import UNKNOWN_LENS, KnownLens
from nlens_video.core.layers import (
    BlurredLayer,
    CocMap,
    DefocusedLayer,
    DepthMap,
    Picture,
)
from nlens_video.core.optics import ROUND, Aperture, Shutter
from nlens_video.core.placement import Region
from nlens_video.effects.measurement import Measurement
from nlens_video.effects.occlusion_cues import OcclusionCue
from nlens_video.graph.base.lens_search import LensSearch
from nlens_video.graph.base.object_source import ObjectSource
from nlens_video.kernels.scatter.scatter import Spread
from nlens_video.scene.camera import Camera
from nlens_video.scene.plate_sun import PlateSun
from nlens_video.scene.posed import PosedScene
from nlens_video.scene.scene_light import SceneLight
from nlens_video.video.info import SourceFrame

if TYPE_CHECKING:
    from nlens_video.render.base.box_renderer import BoxRenderer
    from nlens_video.stages.r_samples import FitSamples
    from nlens_video.stages.whole_ground.network_reading import LensNetwork

CocEstimator = Callable[[Picture, Sequence[Picture]], CocMap]
"""F: the CoC map of a picture, from it and the ones that follow."""

SunReader = Callable[[Picture, Camera, float], PlateSun | None]
"""Reads the sun off a plate that a camera saw, whose ground is so high; None if not sure."""

DepthOrder = Callable[[DefocusedLayer, BlurredLayer], BlurredLayer]
"""L: the blurred layer of a sharp one, with depth order between the object's parts."""


class ReadAgain(Protocol):
    """Reads the frames of a shot from its first one; may be called more than once."""

    def __call__(self, *, sparse: bool = False) -> Iterator[SourceFrame]:
        """Read the shot; a sparse one may lack frames, and its numbers do not count."""
        ...


class ShadowScene(Struct, frozen=True, kw_only=True):
    """Geometry and lighting that cast the shadow.

    Attributes:
        pose: the scene at a time [s].
        light: lights of the GLB and the environment map.
        pre_rendered: whether the object is a pre-rendered layer, lit elsewhere.
        strength: factor on the shadow, 1 is physical [1].
        strength_given: whether the user set it.
        moments: a few of the whole run, whatever part of it is rendered [s].
    """

    pose: Callable[[float], PosedScene]
    light: SceneLight
    pre_rendered: bool
    strength: float
    strength_given: bool = False
    moments: tuple[float, ...] = (0.0,)


class OcclusionSource(Struct, frozen=True):
    """Source of foreground occlusion, frame by frame.

    Attributes:
        description: the source in one phrase.
        read: the occlusion cue of a frame, from it, the plate before the composite, and the frame's
            CoC map if that was estimated already.
        close: closes its file.
        depth: depth of a frame; None where the source is not one of depth.
        notes: for the user, as of now.
    """

    description: str
    read: Callable[[SourceFrame, Picture, CocMap | None], OcclusionCue]
    close: Callable[[], None] = lambda: None
    depth: Callable[[SourceFrame], DepthMap] | None = None
    notes: Callable[[], tuple[str, ...]] = tuple


class NodeContext(Struct, frozen=True, kw_only=True, dict=True):
    """Dependencies of nodes.

    Attributes:
        objects: bounds, geometry and rendering of the object.
        estimate_coc: F; loads its network when first called.
        read_lens: reads the lens off the whole ground, None to read none; loads its network when
            first called.
        ground_y: height of the ground plane, None for the object's lowest point at time 0.
        fallback_constant: whether a constant CoC may stand in for a fit that fails.
        pixel_aspect: width of a pixel by its height [1].
        known_lens: what is known of the lens beforehand.
        tagged_lens: what the recording states of it.
        other_samples: samples of other frames for the lens fit.
        lens_search: which frames are looked at until one tells the lens.
        fit_region: part of the frame whose ground tells the lens, None for all of it.
        unit_m: the scene's unit, None where it is not known [m].
        aperture: shape of the lens' aperture.
        spread: accelerated kernel of the scatter, None for the CPU's.
        renderer: renders the object from any camera, and surfaces that it hides; None for
            pre-rendered layers.
        read_sun: reads the sun off the plate, None to read none; loads its network when first
            called.
        repair: depth ordering of the blurred layer, None without its network.
        shadow_scene: casters and light of the shadow, None without a scene.
        shutter: of the plate.
        measured: camera effects measured on the plate's first frames, by effect.
        occlusion: source of foreground occlusion, None without one.
        reflectance: of the ground at normal incidence, 0 to 1 [1].
        first_lit_frame: the first frame that tells the light of a shot whose first one does not;
            None where the shot cannot be read ahead. Called before the first frame.
    """

    objects: ObjectSource
    estimate_coc: CocEstimator
    ground_y: float | None
    fallback_constant: bool
    pixel_aspect: float
    read_lens: LensNetwork | None = None
    known_lens: KnownLens = UNKNOWN_LENS
    tagged_lens: KnownLens = UNKNOWN_LENS
    other_samples: tuple[FitSamples, ...] = ()
    lens_search: LensSearch = field(default_factory=LensSearch)
    fit_region: Region | None = None
    unit_m: float | None = 1.0
    aperture: Aperture = ROUND
    spread: Spread | None = None
    renderer: BoxRenderer | None = None
    read_sun: SunReader | None = None
    repair: DepthOrder | None = None
    shadow_scene: ShadowScene | None = None
    shutter: Shutter = Shutter()
    measured: Mapping[str, Measurement] = field(default_factory=dict)
    occlusion: OcclusionSource | None = None
    reflectance: float = 0.0
    first_lit_frame: Callable[[], SourceFrame | None] = lambda: None

    @cached_property
    def ground_height(self) -> float:
        """Height of the ground: as given, else the object's lowest point at time 0 [scene unit]."""
        if self.ground_y is not None:
            return self.ground_y
        return float(self.objects.footprint(0.0)[:, :, 1].min())
