"""Reblur methods that `bench` compares: presets, the sampled lens at other view counts, rivals.

Rivals are other methods' blur from the same sharp layer and CoC, as nodes in the place of ours.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import cv2
import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from nlens_video.core.layers import BlurredLayer, Box, DefocusedLayer, Float32, ObjectLayer, UInt8
from nlens_video.core.lens_fit import LensFit
from nlens_video.core.settings import ObjectSettings
from nlens_video.effects.planner import DEFOCUS
from nlens_video.evaluate.bench.case import Case
from nlens_video.graph.base.node import OUT_OF_FOCUS, Node
from nlens_video.graph.base.plate_preview import PlatePreview
from nlens_video.graph.base.profiler import Profiler
from nlens_video.graph.base.view import View
from nlens_video.graph.effect_plan import LensRequest
from nlens_video.graph.executor import GraphExecutor
from nlens_video.graph.nodes.plate_light import EstimateLight
from nlens_video.graph.pipeline_file import PipelineFile, load_pipeline, shipped_pipelines
from nlens_video.graph.session import open_session
from nlens_video.stages.l_lens_sampling import view_count
from nlens_video.stages.l_reblur import crop_to_frame
from nlens_video.video.info import SourceFrame
from nlens_video.video.pixels.picture import ArrayPicture

LENS_VIEWS = (8, 32)
"""Views of the lens that are measured beside those of the preset `reference`."""

SIGMA_PER_COC = 0.25
"""A disc of diameter D has a variance of D^2 / 16 along each axis."""

Rival = Callable[[DefocusedLayer, Box], BlurredLayer]
ObjectCoc = Callable[[ObjectLayer], DefocusedLayer]

_ORDER = ("draft", "realtime", "standard", "paper", "reference")  # the ladder's own
_SAMPLED, _SCATTER = "reference", "realtime"
_REACH = 3.0  # a Gaussian's end [sigma]
_STEP_PX = 1.0  # between the sigmas of the layered Gaussian
_FAINT = 1e-9  # coverage below which nothing is near


def naive(defocused: DefocusedLayer, frame: Box) -> BlurredLayer:
    """The sharp object as it is."""
    return crop_to_frame(defocused.layer, frame)


def one_gaussian(defocused: DefocusedLayer, frame: Box) -> BlurredLayer:
    """One Gaussian for the whole object, its sigma a quarter of the object's mean CoC."""
    alpha = defocused.layer.rgba[..., 3]
    total = float(alpha.sum())
    mean_px = float((np.abs(defocused.coc_px) * alpha).sum()) / total if total else 0.0
    sigma = SIGMA_PER_COC * mean_px
    rgba, _, box = _padded(defocused, sigma)
    return _cropped(_blurred(rgba, sigma), box, frame)


def layered_gaussian(defocused: DefocusedLayer, frame: Box) -> BlurredLayer:
    """A Gaussian for each pixel's own CoC, as Blind Augmentation blurs its objects.

    Prakash et al. 2025: each pixel gathers colour under a mask and the mask itself with a Gaussian
    of its own sigma, which is painted on beyond the silhouette. Here the Gaussians come from layers
    of rising sigma. Kinder than the released code: that cuts its kernels at 15 px and smooths the
    sigma by 64 px. It dilates and erodes the mask where the real scene hides the object, which no
    scene of `bench` does.
    """
    last = math.ceil(SIGMA_PER_COC * defocused.largest_coc_px / _STEP_PX)
    sigma_most = _STEP_PX * last
    rgba, coc, box = _padded(defocused, sigma_most)
    own = np.float32(SIGMA_PER_COC) * np.abs(coc)
    sigma = _extended(own, rgba[..., 3], max(sigma_most, 1.0))
    out = np.zeros_like(rgba)
    for at in range(last + 1):
        share = np.maximum(1.0 - np.abs(sigma / _STEP_PX - at), 0.0)
        out += share[..., None] * _blurred(rgba, _STEP_PX * at)
    return _cropped(out, box, frame)


def _padded(defocused: DefocusedLayer, sigma_px: float) -> tuple[Float32, Float32, Box]:
    """Colour and CoC with room for a Gaussian around them."""
    margin = math.ceil(_REACH * sigma_px) + 1
    rgba = np.pad(defocused.layer.rgba, ((margin, margin), (margin, margin), (0, 0)))
    return rgba, np.pad(defocused.coc_px, margin), defocused.layer.box.expanded(margin)


def _blurred(rgba: Float32, sigma_px: float) -> Float32:
    if sigma_px < 0.1:
        return rgba
    side = 2 * math.ceil(_REACH * sigma_px) + 1
    return np.asarray(cv2.GaussianBlur(rgba, (side, side), sigma_px), dtype=np.float32)


def _extended(sigma_px: Float32, alpha: Float32, spread_px: float) -> Float32:
    """The sigmas, and beyond the silhouette the mean of those near it."""
    weight = _blurred(alpha, spread_px)
    mean = _blurred(sigma_px * alpha, spread_px) / np.maximum(weight, _FAINT)
    return np.asarray(np.where(alpha > 0.0, sigma_px, mean), dtype=np.float32)


def _cropped(rgba: Float32, held: Box, frame: Box) -> BlurredLayer:
    box = held.intersection(frame)
    if box.empty:
        return BlurredLayer.nothing()
    return BlurredLayer(box=box, rgba=np.ascontiguousarray(rgba[box.slices_in(held)]))


RIVALS: dict[str, Rival] = {
    "naive": naive,
    "one Gaussian": one_gaussian,
    "layered Gaussian": layered_gaussian,
}


class _RivalReblur(Node):
    """Another method's blur, in place of the scatter."""

    name, writes = "reblur", "blurred"
    effect, lane, when = DEFOCUS, "composite", OUT_OF_FOCUS

    def __init__(self, rival: Rival) -> None:
        self._rival = rival

    def __call__(self, defocused: DefocusedLayer, frame_box: Box) -> BlurredLayer:
        return self._rival(defocused, frame_box)


class _GivenCoc(Node):
    """A given CoC, in place of the lens fit's."""

    name, writes = "object-coc", "defocused"
    effect = DEFOCUS

    def __init__(self, coc: ObjectCoc) -> None:
        self._coc = coc

    def __call__(self, layer: ObjectLayer, fit: LensFit) -> DefocusedLayer:
        return self._coc(layer)


class Rung(Struct, frozen=True, kw_only=True):
    """One way to reblur.

    Attributes:
        name: of its row.
        preset: the shipped pipeline that runs.
        rival: what stands in for that pipeline's scatter, a key of `RIVALS`; None for nothing.
        needs_views: whether it draws the object from points of the lens.
        accuracy_db: what its lens sampling is to reach, None for the pipeline's own [dB].
    """

    name: str
    preset: str
    rival: str | None = None
    accuracy_db: float | None = None
    needs_views: bool = False

    def can_run(self, case: Case) -> bool:
        """Whether a case gives what it needs: layers hold one view of the object only."""
        return case.layers is None or not self.needs_views


def all_rungs() -> list[Rung]:
    """Every rung, rivals first, then from the cheapest of ours to the dearest."""
    rungs = [rival_rung(name) for name in RIVALS]
    for rung in preset_rungs():
        if rung.needs_views:
            rungs += [_sampled(rung, views) for views in LENS_VIEWS]
        rungs.append(rung)
    return rungs


def rival_rung(name: str) -> Rung:
    """The rung of a rival, a key of `RIVALS`."""
    return Rung(name=name, preset=_SCATTER, rival=name)


def preset_rungs() -> list[Rung]:
    """The shipped presets, from the cheapest to the dearest, those of no known cost last."""
    shipped = shipped_pipelines()
    names = dict.fromkeys([*(name for name in _ORDER if name in shipped), *shipped])
    return [Rung(name=name, preset=name, needs_views=name == _SAMPLED) for name in names]


def _sampled(rung: Rung, views: int) -> Rung:
    """The preset `reference` for the accuracy that takes so many views."""
    accuracy = next(db / 1000 for db in range(30_000, 70_000) if view_count(db / 1000) == views)
    return replace(rung, name=f"lens, {views} views", accuracy_db=accuracy)


@contextmanager
def opened(
    rung: Rung,
    case: Case,
    profiler: Profiler,
    fit: LensFit | None,
    object_coc: ObjectCoc | None = None,
) -> Iterator[GraphExecutor]:
    """The graph that runs a rung on a case, ready for frames on this thread.

    Args:
        rung: what runs.
        case: on what; its true lens is not used.
        profiler: times the nodes.
        fit: the lens, None to find it on the plate.
        object_coc: gives the object its CoC in the place of a lens fit.

    Raises:
        As `open_session`.
    """
    height, width = case.plate.shape[:2]
    session = open_session(
        ObjectSettings(glb=case.glb, layers=None if case.layers is None else str(case.layers)),
        LensRequest(preset=rung.preset, effects="defocus", fit=fit),
        View(width=width, height=height),
        profiler,
        PlatePreview(lambda: ()),
        _pipeline(rung),
    )
    stand_ins: dict[str, Node] = {}
    if rung.rival is not None:
        stand_ins[_RivalReblur.name] = _RivalReblur(RIVALS[rung.rival])
    if object_coc is not None:
        stand_ins[_GivenCoc.name] = _GivenCoc(object_coc)
    steps = session.executor
    if stand_ins:
        nodes = tuple(stand_ins.get(node.name, node) for node in session.graph.nodes)
        steps = GraphExecutor(replace(session.graph, nodes=nodes), profiler, fit)
    with session.render_context():
        yield steps


def one_frame(steps: GraphExecutor, case: Case, index: int) -> tuple[UInt8, dict[str, float]]:
    """The composite (H, W, 3), and what each node took [ms]."""
    codes = case.plate.copy()
    state = steps.begin_frame(SourceFrame(index=index, picture=ArrayPicture(codes, "rgb")))
    steps.run(state, steps.graph.nodes)
    return codes, steps.profiler.close_frame(index, index).nodes


def _pipeline(rung: Rung) -> PipelineFile:
    """The rung's pipeline, its lens sampled as accurately as the rung asks.

    It takes no light from the plate: the truth has none, and what is compared is blur.
    """
    pipeline = load_pipeline(rung.preset)
    specs = [spec for spec in pipeline.nodes if spec.name != EstimateLight.name]
    if rung.accuracy_db is not None:
        options: dict[str, object] = {"accuracy_db": rung.accuracy_db}
        specs = [
            replace(spec, options=options) if spec.name == "lens-sampling" else spec
            for spec in specs
        ]
    return replace(pipeline, nodes=tuple(specs))
