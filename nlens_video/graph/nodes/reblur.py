"""The stages that blur the object, as a pipeline file names them."""

from __future__ import annotations

from typing import TYPE_CHECKING, cast

from nlens_video.core.layers import (
    BlurredLayer,
    Box,
    DefocusedLayer,
    Picture,
)
from nlens_video.core.lens_fit import LensFit
from nlens_video.graph.nodes.context import (
    Made,
    Stage,
    Tools,
    Unavailable,
)
from nlens_video.graph.nodes.object_source import Placement
from nlens_video.graph.nodes.through_lens import through_lens
from nlens_video.stages.l_reblur import ReblurLayer

if TYPE_CHECKING:
    from nlens_video.stages.reblur.view_blend import FewViews


def make_peel(tools: Tools) -> Made:
    """What the object hides of itself, drawn."""
    from nlens_video.stages.reblur.depth_peel import look_behind

    if tools.behind is None:
        raise Unavailable(
            "pre-rendered layers hold the nearest surfaces only: what they hide of the object is "
            "guessed from what is seen of it"
        )
    renderer = tools.behind

    def run(defocused: DefocusedLayer, fit: LensFit, placement: Placement) -> DefocusedLayer:
        return look_behind(defocused, fit, placement.farthest, renderer)

    return Made(run, f"depth-peeled second layer, {tools.objects.description}")


def make_views(tools: Tools) -> Made:
    """The object from a few points of the lens."""
    from nlens_video.stages.reblur.lens_sampling import Shot
    from nlens_video.stages.reblur.view_blend import VIEWS, SampleSmallDiscs

    if tools.views is None:
        raise Unavailable(
            "pre-rendered layers hold one view of the object: the scatter stands where discs are "
            "small, too"
        )
    stage = SampleSmallDiscs(
        renderer=tools.views, pixel_aspect=tools.pixel_aspect, aperture=tools.aperture
    )

    def run(
        defocused: DefocusedLayer, placement: Placement, fit: LensFit, frame_box: Box
    ) -> FewViews | None:
        shot = Shot(time_s=placement.time_s, camera=placement.camera, fit=fit, frame=frame_box)
        return stage(defocused, shot)

    return Made(run, f"{VIEWS} more points of the lens, {tools.objects.description}")


def make_scatter(tools: Tools, *, detail: str = "fine") -> Made:
    """Each pixel over its disc."""
    stage = through_lens(tools, detail)

    def run(defocused: DefocusedLayer, frame_box: Box) -> BlurredLayer:
        return stage(defocused, frame_box)

    made_by = "numba" if tools.spread is None else "torch on CUDA"
    return Made(run, f"L: layered exact-coverage scatter, {detail}, {made_by}")


def make_lens(tools: Tools, *, accuracy_db: float = 50.0) -> Made:
    """The object from many points of the lens."""
    from nlens_video.kernels.scatter.scatter import blur_reach, scatter
    from nlens_video.stages.reblur.lens_sampling import (
        BlurCell,
        Reblur,
        SampleLens,
        Shot,
        view_count,
    )

    if tools.views is None:
        raise Unavailable(
            "pre-rendered layers hold one view of the object, so the lens cannot be sampled: the "
            "blur of the preset standard stands in"
        )
    count = view_count(accuracy_db)
    wide = ReblurLayer(scatter=scatter, reach=blur_reach, pixel_aspect=tools.pixel_aspect)
    stage = SampleLens(
        renderer=tools.views,
        whole=cast("Reblur", make_scatter(tools).run),
        cell=BlurCell(wide, tools.pixel_aspect),
        count=count,
        aperture=tools.aperture,
    )

    def run(
        defocused: DefocusedLayer, placement: Placement, fit: LensFit, frame_box: Box
    ) -> BlurredLayer:
        shot = Shot(time_s=placement.time_s, camera=placement.camera, fit=fit, frame=frame_box)
        return stage(defocused, shot)

    return Made(run, f"L: the lens sampled at {count} points for {accuracy_db:g} dB")


def make_repair(tools: Tools) -> Made:
    """Order where the CoC steps."""
    if tools.repair is None:
        raise Unavailable("this version ships no repair network: the scatter's result stands")
    return Made(
        tools.repair,
        "L: ordered layers at depth steps, weighed by a network where what is hidden is not known",
    )


def make_lay_views(tools: Tools) -> Made:
    """The few views laid in."""

    def run(blurred: BlurredLayer, views: FewViews) -> BlurredLayer:
        return views.laid_in(blurred)

    return Made(run, "L: the mean of the views where discs are small")


def make_past_edges(tools: Tools) -> Made:
    """The plate as the part of the lens sees it that the object leaves free."""
    from nlens_video.stages.reblur.edge_parallax import past_edges

    def run(
        blurred: BlurredLayer, picture: Picture, defocused: DefocusedLayer, fit: LensFit,
        placement: Placement,
    ) -> BlurredLayer:  # fmt: skip
        return past_edges(blurred, picture, defocused, fit, placement.camera, tools.ground_height())

    return Made(run, "the plate from the side of the lens that the object leaves free")


def make_paper(tools: Tools) -> Made:
    """The paper's own networks."""
    from nlens_video.kernels.reblur.paper_scatter import paper_scatter
    from nlens_video.networks.model_store import find_model
    from nlens_video.networks.paper_onnx import OnnxPaperNetworks
    from nlens_video.stages.reblur.l_paper import PaperReblur

    arnet, iunet = find_model("paper-arnet").path, find_model("paper-iunet").path
    stage = PaperReblur(scatter=paper_scatter, networks=OnnxPaperNetworks(arnet, iunet))

    def run(picture: Picture, defocused: DefocusedLayer, frame_box: Box) -> BlurredLayer:
        return stage(picture, defocused, frame_box)

    return Made(run, "L: the paper's networks on the whole frame, onnxruntime on the CPU")


BLUR: dict[str, Stage] = {
    "peel": Stage(make_peel, ("defocused", "fit", "placement"), "defocused"),
    "scatter": Stage(make_scatter, ("defocused", "frame_box"), "blurred"),
    "lens": Stage(make_lens, ("defocused", "placement", "fit", "frame_box"), "blurred"),
    "views": Stage(make_views, ("defocused", "placement", "fit", "frame_box"), "views"),
    "lay-views": Stage(make_lay_views, ("blurred", "views"), "blurred"),
    "past-edges": Stage(
        make_past_edges, ("blurred", "picture", "defocused", "fit", "placement"), "blurred"
    ),
    "repair": Stage(make_repair, ("defocused", "blurred"), "blurred"),
    "paper-reblur": Stage(make_paper, ("picture", "defocused", "frame_box"), "blurred"),
}
"""The stages of this module, by the names that pipeline files use."""
