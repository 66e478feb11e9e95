"""What a person says about the plate's lens, in place of a measurement."""

from __future__ import annotations

from nlens_video.core.lens_models import Distortion, Optics, Vignetting
from nlens_video.effects.measurement import Measurement


def given(optics: Optics) -> dict[str, Measurement]:
    """A measurement for each effect that a person has said the strength of, 0 included."""
    told = {}
    if optics.vignetting_stops is not None:
        stops = optics.vignetting_stops
        model = Vignetting.of(stops) if stops else None
        told["vignetting"] = _said("vignetting", stops, "stops at the corner", model)
    if optics.distortion is not None:
        k1, k2 = optics.distortion
        bent = Distortion(k1=k1, k2=k2, of_focal=True) if k1 or k2 else None
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
