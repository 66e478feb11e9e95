"""Measurements of the camera's effects beside defocus, on a shot's first pictures.

Each effect has a module that measures it, imported only when that effect may be simulated.
"""

from __future__ import annotations

import pkgutil
from collections.abc import Callable, Container, Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from importlib.util import find_spec
from typing import cast

import numpy as np

from nlens_video import effects
from nlens_video.core.color import transfer
from nlens_video.core.layers import Box, Float32, Picture
from nlens_video.core.optics import Distortion, LensOverrides, Vignetting


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
_MOST_COLUMNS, _MOST_ROWS = 1280, 720


@dataclass(frozen=True, slots=True, kw_only=True)
class Measurement:
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
    """Measure some of `PLATE_EFFECTS`, in their order, on a shot's first pictures, if any."""
    found = {}
    for effect in PLATE_EFFECTS:
        if effect in effects and pictures:
            module = import_module(PLATE_EFFECTS[effect])
            measure = cast("Callable[[Sequence[Picture]], Measurement]", module.measure)
            found[effect] = measure(pictures)
    return found


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


def middle_codes(picture: Picture) -> Float32:
    """Display-coded sRGB of a picture, of its middle where it is large (H, W, 3).

    Noise and sharpness are measured at full size, but need not be measured everywhere.
    """
    width, height = min(picture.width, _MOST_COLUMNS), min(picture.height, _MOST_ROWS)
    if (width, height) == (picture.width, picture.height):
        return picture.srgb()
    left, top = (picture.width - width) // 2, (picture.height - height) // 2
    linear = picture.linear(Box(left, top, left + width, top + height))
    clipped = np.clip(linear, 0.0, 1.0).astype(np.float64)
    return transfer("iec61966-2-1").to_coded(clipped).astype(np.float32)
