"""Networks of a run, each loaded when it is first needed."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache, partial
from typing import TYPE_CHECKING

from nlens_video.core.layers import BlurredLayer, CocMap, DefocusedLayer, Float32, Picture
from nlens_video.networks.device import DeviceChoice
from nlens_video.scene.camera import Camera
from nlens_video.scene.plate_sun import PlateSun, plate_sun
from nlens_video.stages.whole_ground.patches import Patches

if TYPE_CHECKING:
    from nlens_video.networks.lens_network import OnnxLensNetwork
    from nlens_video.networks.onnx_networks import OnnxRepairNetwork
    from nlens_video.networks.sun_network import OnnxSunNetwork
    from nlens_video.stages.f_coc import EstimateCoc
    from nlens_video.stages.l_depth_order import RepairDepthOrder

_CocEstimator = Callable[[Picture, Sequence[Picture]], CocMap]
_DepthOrder = Callable[[DefocusedLayer, BlurredLayer], BlurredLayer]
_SunReader = Callable[[Picture, Camera, float], PlateSun | None]


def lazy_depth_order(pixel_aspect: float, device: DeviceChoice) -> _DepthOrder:
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


def lazy_coc_estimator(pixel_aspect: float, device: DeviceChoice) -> _CocEstimator:
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


def lazy_sun_reader() -> _SunReader:
    """Reads the sun off a plate; its network is loaded by the first."""

    @cache
    def network() -> OnnxSunNetwork:
        from nlens_video.networks.model_store import find_model
        from nlens_video.networks.sun_network import OnnxSunNetwork

        return OnnxSunNetwork(find_model("sun").path)

    return lambda picture, camera, ground_y: plate_sun(network(), picture, camera, ground_y)


def lazy_lens_network() -> Callable[[Patches], Float32]:
    """A `LensNetwork`, loaded by the first ground."""

    @cache
    def network() -> OnnxLensNetwork:
        from nlens_video.networks.lens_network import OnnxLensNetwork
        from nlens_video.networks.model_store import find_model

        return OnnxLensNetwork(find_model("lens").path)

    return lambda patches: network()(patches)
