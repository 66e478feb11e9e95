"""Opens what nodes depend on: networks, loaded on first use, source of occlusion, shadow scene."""

from __future__ import annotations

from functools import cache, partial
from typing import TYPE_CHECKING

from nlens_video.core.layers import (
    BlurredLayer,
    CocMap,
    DefocusedLayer,
    OcclusionCue,
    Picture,
)
from nlens_video.core.settings import ObjectSettings, RealSettings
from nlens_video.graph.base.context import CocEstimator, DepthOrder, OcclusionSource, ShadowScene
from nlens_video.networks.device import DeviceChoice
from nlens_video.scene.illumination import SceneLight
from nlens_video.scene.scene import Scene

if TYPE_CHECKING:
    from nlens_video.networks.onnx_networks import OnnxRepairNetwork
    from nlens_video.stages.f_coc import EstimateCoc
    from nlens_video.stages.l_depth_order import RepairDepthOrder


def lazy_depth_order(pixel_aspect: float, device: DeviceChoice) -> DepthOrder:
    """Depth ordering at CoC discontinuities, set up by the first frame that has one.

    Args:
        pixel_aspect: width of a pixel by its height [1].
        device: where network and scatter run.
    """

    @cache
    def network() -> OnnxRepairNetwork:
        from nlens_video.networks.model_store import find_model
        from nlens_video.networks.onnx_networks import OnnxRepairNetwork

        return OnnxRepairNetwork(find_model("reblur").path, device=device)

    @cache
    def ordering() -> RepairDepthOrder:
        from nlens_video.kernels.scatter.scatter import blur_reach, scatter
        from nlens_video.stages.l_depth_order import RepairDepthOrder

        return RepairDepthOrder(
            network=lambda geometry: network()(geometry),  # never called where all is known
            scatter=partial(scatter, spread=device.spread),
            reach=blur_reach,
            pixel_aspect=pixel_aspect,
        )

    def repair(defocused: DefocusedLayer, blurred: BlurredLayer) -> BlurredLayer:
        return ordering()(defocused, blurred)

    return repair


def lazy_coc_estimator(pixel_aspect: float, device: DeviceChoice) -> CocEstimator:
    """F, whose network is loaded by the first picture.

    Args:
        pixel_aspect: width of a pixel by its height [1].
        device: where the network runs.
    """

    @cache
    def estimator() -> EstimateCoc:
        from nlens_video.networks.model_store import find_model
        from nlens_video.networks.onnx_networks import OnnxCocNetwork
        from nlens_video.stages.f_coc import EstimateCoc

        return EstimateCoc(OnnxCocNetwork(find_model("coc").path, device=device), pixel_aspect)

    return lambda picture, following: estimator()(picture, following)


def open_occlusion_source(
    real: RealSettings, size: tuple[int, int], estimate: CocEstimator, *, asked_for: bool
) -> OcclusionSource | None:
    """The matte or depth file, or the plate's CoC; None where no option calls for either.

    Args:
        real: the options on occlusion.
        size: width and height of the plate [px].
        estimate: F.
        asked_for: whether the effect is requested by name: the plate's CoC is the last resort.

    Raises:
        InputError: the holdout cannot be read.
    """
    if real.holdout is not None:
        from nlens_video.video.input.holdout import open_holdout

        reader = open_holdout(real.holdout, size)
        return OcclusionSource(
            reader.description, lambda index, picture, plate_coc: reader.read(index), reader.close
        )
    if real.occlusion != "auto" and not asked_for:
        return None

    def coc_of_frame(index: int, picture: Picture, plate_coc: CocMap | None) -> OcclusionCue:
        """CoC map of this frame alone, since the foreground may move."""
        if plate_coc is not None and plate_coc.frames == 1:
            return plate_coc
        return estimate(picture, ())

    return OcclusionSource("F: CoC network on each frame, onnxruntime on the CPU", coc_of_frame)


def shadow_scene(objects: ObjectSettings, scene: Scene) -> ShadowScene:
    """Geometry and lighting of the shadow: the posed scene, lights and environment map.

    Raises:
        InputError: the environment map cannot be read.
    """
    environment = None
    light = objects.light
    if light.env is not None:
        from nlens_video.scene.environment import load_environment

        environment = load_environment(light.env, light.env_rotation_deg, light.env_exposure_ev)
    given = light.shadow_strength
    return ShadowScene(
        pose=scene.pose,
        light=SceneLight(scene.light_count, environment),
        pre_rendered=objects.layers is not None,
        strength=1.0 if given is None else given,
        strength_given=given is not None,
    )
