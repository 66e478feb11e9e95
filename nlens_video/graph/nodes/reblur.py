"""Nodes of L, the reblur: the object's layer through the plate's lens (paper, section 4.2)."""

from __future__ import annotations

import operator
from functools import partial
from typing import TYPE_CHECKING, cast

from nlens_video.effects.motion_blur import mean_layer
from nlens_video.effects.planner import DEFOCUS
from nlens_video.graph.base.node import DEPTH_RANGE, DEPTH_STEPS, OUT_OF_FOCUS, Node, Unavailable
from nlens_video.graph.nodes import warm_up
from nlens_video.kernels.scatter.scatter import DRAFT, FINE, blur_reach, scatter
from nlens_video.stages.composite import EdgeSurroundings, apply_edge_parallax, edge_surroundings
from nlens_video.stages.l_lens_sampling import (
    COVERAGE_DRAWS,
    BlurCell,
    LensSetup,
    SampleLens,
    view_count,
)
from nlens_video.stages.l_reblur import ReblurLayer, crop_to_frame, depth_peel, object_coc
from nlens_video.stages.l_view_blend import VIEWS, SampleSmallDiscs

if TYPE_CHECKING:
    from nlens_video.core.layers import (
        BlurredLayer,
        Box,
        DefocusedLayer,
        ObjectLayer,
        Picture,
    )  # fmt: skip
    from nlens_video.core.lens_fit import LensFit
    from nlens_video.graph.base.context import NodeContext
    from nlens_video.graph.base.view import ScreenBounds
    from nlens_video.render.base.box_renderer import BoxRenderer
    from nlens_video.scene.camera import Camera
    from nlens_video.stages.l_lens_sampling import Reblur
    from nlens_video.stages.l_view_blend import ViewBlend


_DETAILS = {"fine": FINE, "draft": DRAFT}


def make_reblur(context: NodeContext, detail: str = "fine") -> ReblurLayer:
    """The layered scatter that several nodes share, `fine`, or `draft` for layers that are soft."""
    chosen = _DETAILS[detail]
    return ReblurLayer(
        scatter=partial(scatter, aperture=context.aperture, detail=chosen, spread=context.spread),
        reach=partial(blur_reach, aperture=context.aperture, detail=chosen),
        pixel_aspect=context.pixel_aspect,
    )


def _renderer(context: NodeContext, why_not: str) -> BoxRenderer:
    """The renderer that shows the object from more than one side.

    Raises:
        Unavailable: the object's layers are given; the reason is `why_not`.
    """
    if context.renderer is None:
        raise Unavailable(why_not)
    return context.renderer


class ObjectCoc(Node):
    """CoC of each pixel of the object from its depth (paper, eq. 2)."""

    name, writes = "object-coc", "defocused"
    effect = DEFOCUS
    same_with = ("layer", "fit")
    description = "slope * disparity + intercept"

    def __call__(self, layer: ObjectLayer, fit: LensFit) -> DefocusedLayer:
        return object_coc(layer, fit)


class DepthPeel(Node):
    """Second depth layer of the object (depth peeling, Everitt 2001), where the lens sees it."""

    name, writes = "depth-peel", "defocused"
    effect, when, skip_if = DEFOCUS, DEPTH_RANGE, "moments"
    same_with = ("defocused", "fit")

    def __init__(self, context: NodeContext) -> None:
        self._renderer = _renderer(
            context,
            "pre-rendered layers hold the nearest surfaces only: what they hide of the object is "
            "guessed from what is seen of it",
        )
        self.description = f"depth-peeled second layer, {context.objects.description}"

    def __call__(
        self, defocused: DefocusedLayer, fit: LensFit, bounds: ScreenBounds
    ) -> DefocusedLayer:
        return depth_peel(defocused, fit, bounds.farthest, self._renderer)


def _setup(bounds: ScreenBounds, fit: LensFit, frame_box: Box) -> LensSetup:
    return LensSetup(
        time_s=bounds.time_s, camera=bounds.camera, fit=fit, frame=frame_box,
        plate_light=bounds.plate_light,
    )  # fmt: skip


class ApertureViews(Node):
    """The object from a few points of the aperture, where discs are small."""

    name, writes = "aperture-views", "views"
    effect, when, skip_if = DEFOCUS, OUT_OF_FOCUS, "moments"
    same_with = ("defocused", "fit", "frame_box")

    def __init__(self, context: NodeContext) -> None:
        renderer = _renderer(
            context,
            "pre-rendered layers hold one view of the object: the scatter blurs small discs too",
        )
        self._sample = SampleSmallDiscs(
            renderer=renderer, pixel_aspect=context.pixel_aspect, aperture=context.aperture
        )
        self.description = f"{VIEWS} more points of the aperture, {context.objects.description}"

    def __call__(
        self, defocused: DefocusedLayer, bounds: ScreenBounds, fit: LensFit, frame_box: Box
    ) -> ViewBlend | None:
        return self._sample(defocused, _setup(bounds, fit, frame_box))


class LensSampling(Node):
    """The reference: the mean of the object rendered from many points of the aperture."""

    name, writes = "lens-sampling", "blurred"
    effect = DEFOCUS
    same_with = ("defocused", "fit", "frame_box")
    ranges = (("accuracy_db", 10.0, 100.0),)

    def __init__(self, context: NodeContext, *, accuracy_db: float = 50.0) -> None:
        renderer = _renderer(
            context,
            "pre-rendered layers hold one view of the object, so the lens cannot be sampled: the "
            "blur of the preset standard stands in",
        )
        count = view_count(accuracy_db)
        wide = ReblurLayer(scatter=scatter, reach=blur_reach, pixel_aspect=context.pixel_aspect)
        self._sample = SampleLens(
            renderer=renderer,
            whole=cast("Reblur", make_reblur(context)),
            mean=mean_layer,
            cell=BlurCell(wide, context.pixel_aspect),
            count=count,
            aperture=context.aperture,
        )
        self.description = (
            f"L: aperture sampled at {count} points for {accuracy_db:g} dB, or {COVERAGE_DRAWS} "
            "shifted pictures of what needs one view"
        )

    def __call__(
        self, defocused: DefocusedLayer, bounds: ScreenBounds, fit: LensFit, frame_box: Box
    ) -> BlurredLayer:
        return self._sample(defocused, _setup(bounds, fit, frame_box))


class Scatter(Node):
    """The layered scatter: each pixel spread over its disc of confusion."""

    name, writes = "reblur", "blurred"
    effect, lane, when = DEFOCUS, "composite", OUT_OF_FOCUS
    same_with = ("defocused", "frame_box")
    choices = (("detail", tuple(_DETAILS)),)

    def __init__(self, context: NodeContext, *, detail: str = "fine") -> None:
        self._reblur = make_reblur(context, detail)
        backend = "C++" if context.spread is None else "torch on CUDA"
        self.description = f"L: layered exact-coverage scatter, {detail}, {backend}"

    def __call__(self, defocused: DefocusedLayer, frame_box: Box) -> BlurredLayer:
        return self._reblur(defocused, frame_box)

    def warm_up(self) -> None:
        """Fill the tables of this aperture."""
        self._reblur(warm_up.sharp_layer(), warm_up.FRAME)


class PaperReblur(Node):
    """The paper's own reblur: BokehMe's networks on the naive composite of the whole frame."""

    name, writes = "paper-reblur", "blurred"
    effect, lane, when = DEFOCUS, "composite", OUT_OF_FOCUS
    round_only = True

    def __init__(self, context: NodeContext) -> None:
        from nlens_video.kernels.scatter.paper_scatter import paper_scatter
        from nlens_video.networks.model_store import find_model
        from nlens_video.networks.onnx_networks import OnnxPaperNetworks
        from nlens_video.stages.l_paper import PaperReblur as Reblur

        arnet, iunet = find_model("paper-arnet").path, find_model("paper-iunet").path
        self._reblur = Reblur(scatter=paper_scatter, networks=OnnxPaperNetworks(arnet, iunet))
        self.description = "L: the paper's networks on the whole frame, onnxruntime on the CPU"

    def __call__(self, picture: Picture, defocused: DefocusedLayer, frame_box: Box) -> BlurredLayer:
        return self._reblur(picture, defocused, frame_box)


class CropSharp(Node):
    """The sharp layer cropped to the frame, where it is in focus."""

    name, writes = "crop-sharp", "blurred"
    lane = "composite"
    same_with = ("layer", "frame_box")
    description = "the sharp layer, cropped to the frame"

    def __call__(self, layer: ObjectLayer, frame_box: Box) -> BlurredLayer:
        return crop_to_frame(layer, frame_box)


class DepthOrder(Node):
    """Depth-ordered compositing of the object's own layers at discontinuities of its CoC."""

    name, writes = "depth-order", "blurred"
    effect, lane, when, skip_if = DEFOCUS, "composite", DEPTH_STEPS, "moments"
    same_with = ("blurred", "defocused")

    def __init__(self, context: NodeContext) -> None:
        if context.repair is None:
            raise Unavailable("no repair network is available: the scatter's result stands")
        self._repair = context.repair
        self._hidden_is_known = context.renderer is not None
        self.description = (
            "L: depth-ordered layers at CoC discontinuities, weighted by a network where hidden "
            "surfaces are not rendered"
        )

    def __call__(self, blurred: BlurredLayer, defocused: DefocusedLayer) -> BlurredLayer:
        return self._repair(defocused, blurred)

    def warm_up(self) -> None:
        """Load the network where hidden surfaces are not rendered."""
        self._repair(warm_up.sharp_layer(hidden=self._hidden_is_known), warm_up.blurred_layer())


class BlendViews(Node):
    """The mean of the aperture views in place of the scatter, where discs are small."""

    name, writes = "blend-views", "blurred"
    effect, lane = DEFOCUS, "composite"
    same_with = ("blurred", "views")
    description = "L: mean of the aperture views where discs are small"

    def __call__(self, blurred: BlurredLayer, views: ViewBlend) -> BlurredLayer:
        return views.blend_into(blurred)


class EdgeParallax(Node):
    """Parallax of the plate past edges, as the unoccluded part of the aperture sees it."""

    name, writes = "edge-parallax", "blurred"
    effect, lane, when = DEFOCUS, "composite", OUT_OF_FOCUS

    def __init__(self, context: NodeContext) -> None:
        self._context = context
        self._last: tuple[_EdgeInputs, EdgeSurroundings | None] | None = None
        self.description = "plate displaced as the unoccluded part of the aperture sees it"

    def __call__(
        self, blurred: BlurredLayer, picture: Picture, defocused: DefocusedLayer, fit: LensFit,
        bounds: ScreenBounds,
    ) -> BlurredLayer:  # fmt: skip
        given = blurred.box, defocused, fit, bounds.camera
        if self._last is None or not _same(self._last[0], given):  # it moves
            self._last = given, edge_surroundings(*given, self._context.ground_height)
        return apply_edge_parallax(blurred, picture, self._last[1])


_EdgeInputs = tuple["Box", "DefocusedLayer", "LensFit", "Camera"]


def _same(before: _EdgeInputs, now: _EdgeInputs) -> bool:
    return before[0] == now[0] and all(map(operator.is_, before[1:], now[1:]))
