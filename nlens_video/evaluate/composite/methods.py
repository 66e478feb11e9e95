"""Methods of compositing, and which inputs each is given beside plate and object."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from nlens_video.core.errors import LensFitError
from nlens_video.core.layers import Float32
from nlens_video.core.lens_fit import LensFit
from nlens_video.evaluate.bench.measure import one_frame
from nlens_video.evaluate.bench.methods import (
    ObjectCoc,
    Rung,
    opened,
    preset_rungs,
    rival_rung,
)
from nlens_video.evaluate.coc.protocol import object_rms
from nlens_video.evaluate.coc.quadratic import Quadratic, fit_quadratic, nearest_blur
from nlens_video.evaluate.coc.reblur_ratio import edge_blur
from nlens_video.evaluate.composite.subject import Subject
from nlens_video.evaluate.metrics import rms_within
from nlens_video.graph.base.profiler import Profiler
from nlens_video.stages.l_reblur import object_coc

DEFAULT = "standard"
"""The preset whose bounds are measured: the tool's default."""

NAIVE, BLIND, GAUSSIAN = "naive", "Blind Augmentation, DoF only", "layered Gaussian, true CoC"
TRUE_FIT, TRUE_COC = f"{DEFAULT}, true fit", f"{DEFAULT}, true CoC"
ABOUT = (
    f"{NAIVE}: the sharp object on the plate, in linear light. {BLIND} (Prakash et al. 2025): the "
    "blur of the plate as a quadratic of disparity, and a Gaussian of each pixel's own sigma; told "
    "the true depth of plate and object and, where it was rendered, the true sharp picture, which "
    f"its networks would have to guess. {GAUSSIAN}: the same blur, told the object's true CoC. "
    "The presets are told nothing: they find the lens on the plate. "
    f"{TRUE_FIT}: told the line from disparity to CoC; what a preset lacks against it is the "
    f"estimate's and the fit's error. {TRUE_COC}: told the CoC of each pixel; what it lacks is "
    "the blur's error."
)


@dataclass(frozen=True, slots=True, kw_only=True)
class MethodInputs:
    """What a method is given of the lens.

    Attributes:
        fit: the lens, None to find it.
        defocus: gives the object its CoC in the place of a lens, None for the lens.
        rms_px: error of the object's CoC where no fit tells it [px].
    """

    fit: LensFit | None = None
    defocus: ObjectCoc | None = None
    rms_px: float | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Method:
    """A way to composite.

    Attributes:
        name: of its row.
        rung: how it blurs.
        inputs: what it is given on a plate.
    """

    name: str
    rung: Rung
    inputs: Callable[[Subject], MethodInputs]

    def measure(self, subject: Subject) -> dict[str, float]:
        """All figures on a plate; none where the plate tells no lens."""
        given = self.inputs(subject)
        profiler = Profiler()
        case = subject.case
        try:
            with opened(self.rung, case, profiler, given.fit, given.defocus) as steps:
                picture, spent = one_frame(steps, case, 0)
        except LensFitError:
            return {}
        rms = object_rms(subject.known, steps.fit) if given.rms_px is None else given.rms_px
        return subject.score(picture) | {
            "object_rms_px": rms,
            "time_s": sum(spent.values()) / 1e3,
        }


def all_methods() -> list[Method]:
    """Rivals, every preset that layers are enough for, and the bounds of the default one."""
    presets = [rung for rung in preset_rungs() if not rung.needs_views]
    default = next(rung for rung in presets if rung.name == DEFAULT)
    layered = rival_rung("layered Gaussian")
    return [
        Method(name=NAIVE, rung=rival_rung("naive"), inputs=_no_blur),
        Method(name=BLIND, rung=layered, inputs=_quadratic),
        Method(name=GAUSSIAN, rung=layered, inputs=_true_coc),
        *(Method(name=rung.name, rung=rung, inputs=lambda _: MethodInputs()) for rung in presets),
        Method(
            name=TRUE_FIT, rung=default, inputs=lambda subject: MethodInputs(fit=subject.case.fit)
        ),
        Method(name=TRUE_COC, rung=default, inputs=_true_coc),
    ]


def _no_blur(subject: Subject) -> MethodInputs:
    known = subject.known
    nothing = np.zeros_like(known.object_coc_px)
    rms = rms_within(nothing, known.object_coc_px, known.solid)
    return MethodInputs(fit=subject.case.fit, rms_px=rms)


def _true_coc(subject: Subject) -> MethodInputs:
    return MethodInputs(fit=subject.case.fit, defocus=subject.truly_defocused, rms_px=0.0)


def _quadratic(subject: Subject) -> MethodInputs:
    """Their model of the plate, evaluated at the object's true depth."""
    known, fit = subject.known, subject.case.fit
    if known.sharp is None:
        blur = edge_blur(known.rgb)
    else:
        blur = nearest_blur(known.rgb, known.sharp)
    model = fit_quadratic(blur, known.relative_disparity)
    law = ByDisparity(model, lambda disparity: known.relative(fit.coc_px(disparity)))
    rms = rms_within(
        model.coc_px(known.relative(known.object_coc_px)),
        np.abs(known.object_coc_px),
        known.solid,
    )
    return MethodInputs(fit=fit, defocus=lambda layer: object_coc(layer, law), rms_px=rms)


@dataclass(frozen=True, slots=True)
class ByDisparity:
    """A quadratic evaluated at disparities in the scene's unit.

    Attributes:
        model: of the plate.
        relative: disparity [1 / scene unit] to that of the model [1].
    """

    model: Quadratic
    relative: Callable[[Float32], Float32]

    def coc_px(self, disparity: Float32) -> Float32:
        """Unsigned CoC diameter [px] of any shape from disparity [1 / scene unit]."""
        return self.model.coc_px(self.relative(disparity))
