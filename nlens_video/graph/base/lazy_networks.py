"""Stages with networks that are loaded by the first frame that needs them."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cache, partial
from typing import TYPE_CHECKING

from nlens_video.core.layers import BlurredLayer, CocMap, DefocusedLayer, Picture
from nlens_video.networks.device import DeviceChoice
from nlens_video.stages.protocols import ReblurNetwork

if TYPE_CHECKING:
    from nlens_video.stages.reblur.depth_order_repair import RepairNetwork


def lazy_depth_order(pixel_aspect: float, device: DeviceChoice) -> ReblurNetwork:
    """Depth ordering at CoC discontinuities, set up by the first frame that has one.

    Args:
        pixel_aspect: width of a pixel by its height [1].
        device: where network and scatter run.
    """
    repairing: ReblurNetwork | None = None

    @cache
    def network() -> RepairNetwork:
        from nlens_video.networks.model_store import find_model
        from nlens_video.networks.onnx_networks import OnnxRepairNetwork

        return OnnxRepairNetwork(find_model("reblur").path, device=device)

    def repair(defocused: DefocusedLayer, blurred: BlurredLayer) -> BlurredLayer:
        nonlocal repairing
        if repairing is None:  # loaded by the first frame that has a depth step
            from nlens_video.kernels.scatter.scatter import blur_reach, scatter
            from nlens_video.stages.reblur.depth_order_repair import RepairDepthOrder

            repairing = RepairDepthOrder(
                network=lambda geometry: network()(geometry),  # it may never be asked
                scatter=partial(scatter, spread=device.spread),
                reach=blur_reach,
                pixel_aspect=pixel_aspect,
            )
        return repairing(defocused, blurred)

    return repair


def lazy_coc_estimator(
    pixel_aspect: float, device: DeviceChoice
) -> Callable[[Picture, Sequence[Picture]], CocMap]:
    """F, whose network is loaded by the first picture.

    Args:
        pixel_aspect: width of a pixel by its height [1].
        device: where the network runs.
    """
    from nlens_video.networks.model_store import find_model
    from nlens_video.networks.onnx_networks import OnnxCocNetwork
    from nlens_video.stages.f_coc import EstimateCoc

    estimator: Callable[[Picture, Sequence[Picture]], CocMap] | None = None

    def estimate(picture: Picture, following: Sequence[Picture]) -> CocMap:
        nonlocal estimator
        if estimator is None:  # loading takes as long as a few frames: only when it is needed
            estimator = EstimateCoc(
                OnnxCocNetwork(find_model("coc").path, device=device), pixel_aspect
            )
        return estimator(picture, following)

    return estimate
