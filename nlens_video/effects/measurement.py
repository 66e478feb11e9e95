"""What a shot's first pictures say about the camera beside its focus.

Each effect has a module that measures it and nothing else; a module is imported when its effect is
asked about.
"""

from __future__ import annotations

import pkgutil
from collections.abc import Callable, Container, Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from importlib.util import find_spec
from typing import cast

from nlens_video import effects
from nlens_video.core.layers import Picture
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

MOST_PICTURES = 8
"""How many pictures of a shot are looked at, the first one included."""


@dataclass(frozen=True, slots=True, kw_only=True)
class Measurement:
    """How strong an effect is on the plate.

    Attributes:
        effect: its name.
        value: how strong, in `unit`.
        threshold: from where on it would be missed.
        unit: of both, in visible terms.
        evidence: what was looked at and found, in words.
        model: what the stage simulates with, None where the plate does not show enough.
        cost_ms: what a frame of this size is expected to cost [ms].
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
        """Whether a person would miss it."""
        return self.model is not None and self.value >= self.threshold


def measure_plate(effects: Container[str], pictures: Sequence[Picture]) -> dict[str, Measurement]:
    """Look for some effects on a shot's first pictures.

    Args:
        effects: names of `PLATE_EFFECTS`.
        pictures: the first ones, in order; left as they are.

    Returns:
        A measurement of each, in the order of `PLATE_EFFECTS`; none where there is no picture.
    """
    found = {}
    for effect in PLATE_EFFECTS:
        if effect in effects and pictures:
            module = import_module(PLATE_EFFECTS[effect])
            measure = cast("Callable[[Sequence[Picture]], Measurement]", module.measure)
            found[effect] = measure(pictures)
    return found


def overridden(optics: LensOverrides) -> dict[str, Measurement]:
    """A measurement for each effect that a person has said the strength of, 0 included."""
    told = {}
    if optics.vignetting_stops is not None:
        stops = optics.vignetting_stops
        model = Vignetting.of(stops) if stops else None
        told["vignetting"] = _said("vignetting", stops, "stops at the corner", model)
    if optics.distortion is not None:
        k1, k2 = optics.distortion
        bent = Distortion(k1=k1, k2=k2, focal_normalized=True) if k1 or k2 else None
        told["distortion"] = _said("distortion", abs(k1) + abs(k2), "of k1 and k2", bent)
    return told


def _said(effect: str, value: float, unit: str, model: object | None) -> Measurement:
    return Measurement(
        effect=effect,
        value=value,
        threshold=0.0,
        unit=unit,
        evidence=f"given by --{effect}" if model is not None else f"--{effect} 0",
        model=model,
        cost_ms=0.0,
    )
