"""Measurements of the plate's camera beside its focus, on a shot's first pictures.

Each effect has a module that measures it, imported only when that effect may be simulated. The
shutter angle is measured from the blur of a moving camera: between two pictures the whole view
moves by D, and while the shutter is open by the shutter's share of D. A line blur of length L
leaves every edge twice in the derivative along the motion, with opposite sign, L apart: its
autocorrelation has a minimum there (Yitzhaky and Kopeika 1997).
"""

from __future__ import annotations

import math
import pkgutil
from collections.abc import Callable, Container, Mapping, Sequence
from importlib import import_module
from importlib.util import find_spec
from typing import cast

import cv2
import numpy as np
from msgspec import Struct

from nlens_video import effects
from nlens_video.core.layers import Float32, Picture
from nlens_video.core.optics import Distortion, LensOverrides, Vignetting
from nlens_video.effects.plate_pictures import PlatePictures
from nlens_video.kernels.thread_pool import parallel_for
from nlens_video.stages.f_coc import LUMA


def _own_folders() -> dict[str, str]:
    """Effects in folders of their own: `effects/NAME/measure.py`."""
    found = {}
    for folder in pkgutil.iter_modules(effects.__path__):
        module = f"{effects.__name__}.{folder.name}.measure"
        if folder.ispkg and find_spec(module) is not None:
            found[folder.name.replace("_", "-")] = module
    return found


PLATE_EFFECTS: Mapping[str, str] = {
    "aberration": "nlens_video.effects.camera.chromatic_aberration",
    "bloom": "nlens_video.effects.camera.bloom",
    "distortion": "nlens_video.effects.camera.distortion_measure",
    "vignetting": "nlens_video.effects.camera.vignetting",
    "softness": "nlens_video.effects.camera.softness",
    "grain": "nlens_video.effects.camera.grain_measure",
    **_own_folders(),
}
"""Effect to the module whose `measure(pictures)` detects it."""

MOST_PICTURES = 8  # of a shot that are measured, the first one included
_LEAST_BENT = 0.3  # shift of a corner that is visible [% of its distance from the middle]
_LEAST_MOVE_PX = 8.0
_LEAST_RESPONSE = 0.05  # of the phase correlation: less is no common motion
_LEAST_BLUR_PX = 3.0
_LEAST_MINIMUM = 0.12  # of the derivative's energy; a clear blur has near to 0.5
_AGREEMENT = 0.1
_LAG_STEP_PX = 0.25
_STEADY = 0.2  # share by which the motions of two pairs of pictures may differ


class Measurement(Struct, frozen=True, kw_only=True):
    """Strength of an effect on the plate.

    Attributes:
        effect: its name.
        value: its strength, in `unit`.
        threshold: least strength that is visible.
        unit: of both, in visible terms.
        evidence: what was found, for people.
        model: parameters of the simulation, None where the plate does not show enough.
        cost_ms: expected cost of a frame of this size [ms].
    """

    effect: str
    value: float
    threshold: float
    unit: str
    evidence: str
    model: object | None
    cost_ms: float

    @property
    def called_for(self) -> bool:
        """Whether the effect is visible."""
        return self.model is not None and self.value >= self.threshold


def measure_plate(effects: Container[str], pictures: Sequence[Picture]) -> dict[str, Measurement]:
    """Measure some of `PLATE_EFFECTS` on a shot's first pictures, if any; several at once."""
    chosen = [effect for effect in PLATE_EFFECTS if effect in effects and pictures]
    if not chosen:
        return {}
    plate = PlatePictures(pictures)
    found: dict[str, Measurement] = {}

    def measure(effect: str) -> None:
        module = import_module(PLATE_EFFECTS[effect])
        found[effect] = cast("Callable[[Sequence[Picture]], Measurement]", module.measure)(plate)

    # grain takes longest, and softness would wait for pictures that grain decodes
    parallel_for(measure, sorted(chosen, key=lambda one: (one != "grain", one == "softness")))
    return {effect: found[effect] for effect in chosen}


def overridden(optics: LensOverrides) -> dict[str, Measurement]:
    """A measurement for each effect whose strength is given by an option, 0 included."""
    given = {}
    if optics.vignetting_stops is not None:
        stops = optics.vignetting_stops
        model = Vignetting.of(stops) if stops else None
        given["vignetting"] = _given("vignetting", stops, "stops at the corner", model)
    if optics.distortion is not None:
        k1, k2 = optics.distortion
        distortion = Distortion(k1=k1, k2=k2, focal_normalized=True) if k1 or k2 else None
        given["distortion"] = _given("distortion", abs(k1) + abs(k2), "of k1 and k2", distortion)
    return given


def solved_distortion(k1: float, half: float) -> Measurement:
    """The distortion that was solved with the plate's camera.

    Args:
        k1: of the lens, by focal lengths [1].
        half: half the frame's diagonal by the focal length [1].
    """
    return Measurement(
        effect="distortion",
        value=100.0 * abs(k1) * half**2,
        threshold=_LEAST_BENT,
        unit="% of the corner's distance from the middle",
        evidence=f"solved with the plate's camera: k1 {k1:+.3f}",
        model=Distortion(k1=k1, focal_normalized=True),
        cost_ms=0.0,
    )


def _given(effect: str, value: float, unit: str, model: object | None) -> Measurement:
    return Measurement(
        effect=effect,
        value=value,
        threshold=0.0,
        unit=unit,
        evidence=f"given by --{effect}" if model is not None else f"--{effect} 0",
        model=model,
        cost_ms=0.0,
    )


def shutter_angle(pictures: Sequence[Picture]) -> float | None:
    """Shutter angle of a shot, from its first three pictures [deg].

    None where the camera does not move enough, or not evenly, or leaves no measurable blur.
    """
    if len(pictures) < 3:
        return None
    first, second = (_luma(picture) for picture in pictures[:2])
    move = _common_move(first, second)
    if move is None:
        return None
    third = _luma(pictures[2])
    again = _common_move(second, third)
    if again is None or math.dist(move, again) > _STEADY * math.hypot(*move):
        return None
    along = [_along_rows(luma, move) for luma in (first, second, third)]
    ways = (math.hypot(*move), math.hypot(*again))
    pairs = list(zip(along[:2], along[1:], ways, strict=True))
    # a minimum that is the texture's own moves with the order of the derivative
    blur, other = (_line_blur_px(pairs, order) for order in (2, 3))
    if blur is None or other is None or abs(blur - other) > _AGREEMENT * blur:
        return None
    # the second picture lies in the middle of both motions
    return min(360.0, 360.0 * blur / (0.5 * sum(ways)))


def _luma(picture: Picture) -> Float32:
    return np.asarray(picture.srgb() @ LUMA, np.float32)


def _common_move(first: Float32, second: Float32) -> tuple[float, float] | None:
    """Motion of the whole view, columns and rows [px]; None where there is none."""
    if min(first.shape) < 2.0 * _LEAST_MOVE_PX:
        return None
    window = np.asarray(cv2.createHanningWindow(first.shape[::-1], cv2.CV_32F), np.float32)
    centred = [(luma - luma.mean()) * window for luma in (first, second)]
    (across, down), response = cv2.phaseCorrelate(centred[0], centred[1])
    if math.hypot(across, down) < _LEAST_MOVE_PX or response < _LEAST_RESPONSE:
        return None
    return across, down


def _along_rows(luma: Float32, move: tuple[float, float]) -> Float32:
    """The picture rotated so that the motion lies along its rows, cropped to what it covers."""
    height, width = luma.shape
    turn = math.degrees(math.atan2(move[1], move[0]))
    turned = cv2.warpAffine(
        luma,
        cv2.getRotationMatrix2D((0.5 * (width - 1), 0.5 * (height - 1)), turn, 1.0),
        (width, height),
        flags=cv2.INTER_CUBIC,
    )
    angle = math.radians(turn)
    across, down = abs(math.cos(angle)), abs(math.sin(angle))
    # the largest rectangle of the same shape within the rotated picture
    scale = 0.98 * min(width / (width * across + height * down),
                       height / (width * down + height * across))  # fmt: skip
    rows, columns = int(height * scale), int(width * scale)
    top, left = (height - rows) // 2, (width - columns) // 2
    return np.asarray(turned[top : top + rows, left : left + columns], np.float32)


def _line_blur_px(pairs: Sequence[tuple[Float32, Float32, float]], order: int) -> float | None:
    """Length of a line blur along the rows [px], None where there is none.

    Args:
        pairs: two pictures, whose noise differs, and the motion along the rows between them [px].
        order: of the derivative, which is hardly correlated over the picture's width.
    """
    limit = 1.1 * min(way for _, _, way in pairs) + 2.0
    lags = np.arange(0.0, limit, _LAG_STEP_PX)
    folded = np.zeros(len(lags))
    for first, second, way in pairs:
        edges = [np.diff(luma, n=order, axis=1) for luma in (first, second)]
        size = 1 << (2 * edges[0].shape[1] - 1).bit_length()
        before, after = (np.fft.rfft(part, size, axis=1) for part in edges)
        correlation = np.roll(np.fft.irfft((np.conj(before) * after).sum(axis=0)), size // 2)
        around = np.arange(size) - size // 2
        for side in (-1, 1):
            folded += np.interp(way + side * lags, around, correlation)
    lowest = round(_LEAST_BLUR_PX / _LAG_STEP_PX)
    if not folded[0] > 0.0 or len(folded) < lowest + 2:
        return None
    at = lowest + int(np.argmin(folded[lowest:]))
    if folded[at] > -_LEAST_MINIMUM * folded[0] or at in (lowest, len(folded) - 1):
        return None
    return float(lags[at])
