"""The stages that a pipeline file can name, and how each is made from the run's tools."""

from __future__ import annotations

from typing import TYPE_CHECKING

from nlens_video.core.errors import UsageError
from nlens_video.core.layers import CocMap, ObjectLayer, Picture
from nlens_video.core.lens_fit import LensFit
from nlens_video.graph.nodes.camera import OPTICS
from nlens_video.graph.nodes.camera_stages import make_grain, make_soften
from nlens_video.graph.nodes.context import Made, Stage, Tools
from nlens_video.graph.nodes.motion_blur import (
    make_expose,
    make_moments,
    make_motion,
    make_smear,
)
from nlens_video.graph.nodes.object_source import Placement
from nlens_video.graph.nodes.occlusion import (  # fmt: skip
    make_hold_out,
    make_lay_reflection,
    make_matte,
    make_reflect,
)
from nlens_video.graph.nodes.reblur import BLUR
from nlens_video.graph.nodes.shadow import make_darken, make_light, make_shadow
from nlens_video.stages.composite import composite
from nlens_video.stages.l_reblur import crop_to_frame, object_coc
from nlens_video.stages.p_projection import GroundProjection, project_to_ground
from nlens_video.stages.r_regression import FitLens, constant_fit

if TYPE_CHECKING:
    from nlens_video.graph.nodes.stream_frame import StreamFrame

Options = dict[str, object]


def make_stage(stage: str, options: Options, tools: Tools) -> Made:
    """Make a stage by its registry name.

    Raises:
        UsageError: no such stage, or an option it does not have.
        Unavailable: nothing here can run it.
    """
    try:
        return STAGES[stage].make(tools, **options)
    except KeyError:
        raise UsageError(f"no stage {stage!r}; there are {', '.join(STAGES)}") from None
    except TypeError as error:
        raise UsageError(f"stage {stage!r}: wrong options {sorted(options)} ({error})") from error


def check_ports(name: str, stage: str, inputs: tuple[str, ...], output: str) -> None:
    """See that a node is wired as its stage is called.

    Args:
        name: the node's.
        stage: its stage.
        inputs: ports as the pipeline file lists them, "?" included.
        output: port as the file names it.

    Raises:
        UsageError: no such stage, or other ports.
    """
    made = STAGES.get(stage)
    if made is None:
        raise UsageError(f"node {name!r}: no stage {stage!r}; there are {', '.join(STAGES)}")
    if (inputs, output) != (made.inputs, made.output):
        raise UsageError(
            f"node {name!r}: stage {stage!r} reads {list(made.inputs)} and writes "
            f"{made.output!r}, the file says {list(inputs)} and {output!r}"
        )


def _locate(tools: Tools) -> Made:
    def run(frame: StreamFrame) -> Placement | None:
        return tools.objects.locate(frame.number, frame.time_s)

    return Made(run, "camera and depth bounds of the GLB")


def _estimate_coc(tools: Tools) -> Made:
    estimate = tools.estimate_coc()

    def run(
        picture: Picture, placement: Placement, following: tuple[Picture, ...] | None
    ) -> CocMap:
        tools.record.plate_coc = estimate(picture, following or ())
        return tools.record.plate_coc

    return Made(run, "F: CoC network, onnxruntime on the CPU")


def _project(tools: Tools) -> Made:
    def run(placement: Placement) -> GroundProjection:
        triangles = tools.objects.footprint(placement.time_s)
        height = tools.ground_height()
        tools.record.ground = project_to_ground(triangles, placement.camera, height)
        return tools.record.ground

    return Made(run, "P: footprint cast down on the ground plane")


def _fit(tools: Tools, *, whole_plane: bool = True, anchor_weight: float = 0.1) -> Made:
    fit = FitLens(whole_plane=whole_plane, anchor_weight=anchor_weight)

    def run(coc: CocMap, ground: GroundProjection, frame: StreamFrame) -> LensFit:
        from nlens_video.core.errors import LensFitError

        try:
            tools.record.regression = fit(coc, ground, frame.index)
        except LensFitError as error:
            if not tools.fallback_constant:
                raise
            reason = str(error).partition("; give ")[0]  # what it advises is done already
            tools.record.note = f"constant CoC instead of a fit: {reason}"
            return constant_fit(coc, ground, frame.index)
        tools.record.note = _doubt(tools.record.regression.fit, ground)
        return tools.record.regression.fit

    return Made(run, "R: robust V-fit over the ground plane")


def _doubt(fit: LensFit, ground: GroundProjection) -> str:
    """What a person should know about a fit, empty if nothing."""
    if fit.slope < 2 * fit.slope_stderr:
        return "the plate's blur hardly changes with depth: so the object's will not either"
    if fit.sign == "ambiguous":
        return "the plate does not tell whether the ground lies before or behind the focus"
    if not ground.mask.any():
        return "no footprint in view: fitted on the ground plane as a whole"
    return ""


def _render(tools: Tools) -> Made:
    def run(placement: Placement, fit: LensFit | None) -> ObjectLayer | None:
        return tools.objects.render(placement, fit)

    return Made(run, tools.objects.description)


def _object_coc(tools: Tools) -> Made:
    return Made(object_coc, "slope * disparity + intercept")


def _sharp(tools: Tools) -> Made:
    return Made(crop_to_frame, "the layer as it is")


def _composite(tools: Tools) -> Made:
    return Made(composite, "premultiplied over, scene-linear")


STAGES: dict[str, Stage] = {
    "locate": Stage(_locate, ("frame",), "placement"),
    "estimate-coc": Stage(_estimate_coc, ("picture", "placement", "following?"), "plate_coc"),
    "project": Stage(_project, ("placement",), "ground"),
    "fit": Stage(_fit, ("plate_coc", "ground", "frame"), "fit"),
    "render": Stage(_render, ("placement", "fit?"), "layer"),
    "object-coc": Stage(_object_coc, ("layer", "fit"), "defocused"),
    "sharp": Stage(_sharp, ("layer", "frame_box"), "blurred"),
    "motion": Stage(make_motion, ("placement", "fit?"), "motion"),
    "moments": Stage(make_moments, ("motion",), "moments"),
    "expose": Stage(make_expose, ("placement", "moments", "layer", "frame_box", "fit?"), "exposed"),
    "smear": Stage(make_smear, ("motion", "frame_box", "blurred?", "exposed?"), "blurred"),
    "light": Stage(make_light, ("picture",), "illumination"),
    "shadow": Stage(make_shadow, ("placement", "fit?", "motion?"), "shadow"),
    "matte": Stage(make_matte, ("frame", "picture", "placement", "plate_coc?"), "front"),
    "reflect": Stage(make_reflect, ("placement", "fit?", "motion?"), "reflection"),
    "hold-out": Stage(
        make_hold_out,
        (
            *("front", "picture", "placement", "frame_box"),
            *("fit?", "layer?", "blurred?", "shadow?", "reflection?"),
        ),
        "foreground",
    ),
    "darken": Stage(make_darken, ("picture", "shadow", "frame_box", "foreground?"), "picture"),
    "lay-reflection": Stage(
        make_lay_reflection, ("picture", "reflection", "frame_box", "foreground?"), "picture"
    ),
    **BLUR,
    **OPTICS,
    "soften": Stage(make_soften, ("blurred", "frame_box", "defocused?"), "blurred"),
    "grain": Stage(make_grain, ("picture", "blurred", "frame"), "blurred"),
    "composite": Stage(_composite, ("picture", "blurred", "foreground?"), "picture"),
}
