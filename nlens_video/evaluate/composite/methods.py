"""Methods of compositing, which inputs each is given, and the plates that they are scored on."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from msgspec import Struct
from scipy.ndimage import binary_erosion, distance_transform_edt

from nlens_video.core.errors import LensFitError
from nlens_video.core.layers import Bool, DefocusedLayer, Float32, ObjectLayer, UInt8
from nlens_video.core.lens_fit import LensFit
from nlens_video.evaluate.bench.case import Case, plate_case
from nlens_video.evaluate.bench.methods import (
    ObjectCoc,
    Rung,
    one_frame,
    opened,
    preset_rungs,
    rival_rung,
)
from nlens_video.evaluate.coc.baselines import Quadratic, SparseBlur, edge_blur, nearest_blur
from nlens_video.evaluate.coc.protocol import object_rms
from nlens_video.evaluate.metrics import WINDOW, psnr, rms_within, ssim_map
from nlens_video.evaluate.plates import Plate, load_plate, relative_disparity
from nlens_video.graph.base.profiler import Profiler
from nlens_video.stages.l_reblur import object_coc

DEFAULT = "standard"
"""The preset whose bounds are measured: the tool's default."""

NAIVE, BLIND, GAUSSIAN = "naive", "Blind Augmentation, DoF only", "layered Gaussian, true CoC"
TRUE_FIT, TRUE_COC = f"{DEFAULT}, true fit", f"{DEFAULT}, true CoC"
ABOUT = (
    f"{NAIVE}: the sharp object on the plate, in linear light. {BLIND} (Prakash et al. 2025): the "
    "blur of the plate as a quadratic of disparity, and a Gaussian of each pixel's own sigma; "
    "given the true depth of plate and object and, where it was rendered, the true sharp picture, "
    "which its networks would have to guess. "
    f"{GAUSSIAN}: the same blur, given the object's true CoC. "
    "The presets are given nothing: they find the lens on the plate. "
    f"{TRUE_FIT}: given the line from disparity to CoC; what a preset lacks against it is the "
    f"estimate's and the fit's error. {TRUE_COC}: given the CoC of each pixel; what it lacks is "
    "the blur's error."
)
_RIM_PX = 2.0  # of the renderer's reconstruction filter, on either side of a sharp outline


class Subject(Struct, frozen=True, kw_only=True):
    """A plate that composites are made on.

    Attributes:
        case: plate, object and truth.
        known: the plate's lens and depth.
        coc_px: true signed CoC of the object, off it that of its nearest pixel (H, W) [px].
        band: pixels over which the true lens mixes object and plate (H, W).
    """

    case: Case
    known: Plate
    coc_px: Float32
    band: Bool

    def score(self, picture: UInt8) -> dict[str, float]:
        """PSNR [dB] and SSIM [1] of a composite (H, W, 3) in the object's box, and in the band."""
        rim = WINDOW // 2
        part = tuple(
            slice(max(int(at.min()) - rim, 0), int(at.max()) + rim + 1)
            for at in np.nonzero(self.band)
        )
        seen, truth, band = picture[part], self.case.truth[part], self.band[part]
        likeness = ssim_map(seen, truth)[band[rim:-rim, rim:-rim]]
        return self.case.score(picture) | {
            "band_psnr_db": psnr(seen[band], truth[band]),
            "band_ssim": float(likeness.mean()),
        }

    def truly_defocused(self, layer: ObjectLayer) -> DefocusedLayer:
        """The object with its true CoC, pixel by pixel; the layer must lie within the frame."""
        box = layer.box
        coc = self.coc_px[box.y0 : box.y1, box.x0 : box.x1].copy()
        coc[layer.rgba[..., 3] <= 0] = 0.0
        return DefocusedLayer(layer=layer, coc_px=coc)


def load_subject(folder: Path) -> Subject:
    """Read a plate, its object and its truth.

    Raises:
        InputError: a file is missing, cannot be read or does not fit the others.
        SceneError: the GLB cannot be used.
    """
    known = load_plate(folder)
    coc = known.object_coc_px[_nearest(known.there)]
    outline = known.there & ~binary_erosion(known.there, border_value=1)  # none at the frame's edge
    away = distance_transform_edt(~outline)
    band = away <= 0.5 * np.abs(coc[_nearest(outline)]) + _RIM_PX
    return Subject(case=plate_case(known), known=known, coc_px=coc, band=band)


def _nearest(known: Bool) -> tuple[np.ndarray, np.ndarray]:
    """Row and column of the nearest known pixel, for every pixel (H, W) each."""
    rows, columns = distance_transform_edt(~known, return_distances=False, return_indices=True)
    return rows, columns


class MethodInputs(Struct, frozen=True, kw_only=True):
    """What a method is given of the lens."""

    fit: LensFit | None = None  # None to find it
    defocus: ObjectCoc | None = None  # gives the object its CoC in the place of a lens
    rms_px: float | None = None  # error of the object's CoC where no fit tells it


class Method(Struct, frozen=True, kw_only=True):
    """A way to composite: how it blurs, and what it is given on a plate."""

    name: str
    rung: Rung
    inputs: Callable[[Subject], MethodInputs]

    def measure(self, subject: Subject) -> dict[str, float]:
        """All figures on a plate; none where the plate tells no lens."""
        given = self.inputs(subject)
        case = subject.case
        try:
            with opened(self.rung, case, Profiler(), given.fit, given.defocus) as steps:
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
    known, fit = subject.known, subject.case.fit
    blur = edge_blur(known.rgb) if known.sharp is None else nearest_blur(known.rgb, known.sharp)
    law = BlindAugmentation(blur, known.coc_px, fit)
    rms = rms_within(law.of_coc(known.object_coc_px), np.abs(known.object_coc_px), known.solid)
    return MethodInputs(fit=fit, defocus=law, rms_px=rms)


class BlindAugmentation:
    """Their model of a plate's CoC, evaluated at true disparities of the object.

    Args:
        blur: what the model is fitted on.
        coc_px: true signed CoC of the plate (H, W) [px].
        fit: the true lens.
    """

    def __init__(self, blur: SparseBlur, coc_px: Float32, fit: LensFit) -> None:
        self._plate_coc_px, self._fit = coc_px, fit
        self._model = Quadratic.fit(blur, relative_disparity(coc_px, coc_px))

    def of_coc(self, true_coc_px: Float32) -> Float32:
        """Unsigned CoC diameter [px] of any shape where the true signed one is given [px]."""
        return self._model.coc_px(relative_disparity(true_coc_px, self._plate_coc_px))

    def coc_px(self, disparity: Float32) -> Float32:
        """Unsigned CoC diameter [px] of any shape from disparity [1 / scene unit]."""
        return self.of_coc(self._fit.coc_px(disparity))

    def __call__(self, layer: ObjectLayer) -> DefocusedLayer:
        """The object with its CoC by the model."""
        return object_coc(layer, self)
