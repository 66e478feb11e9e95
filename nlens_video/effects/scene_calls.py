"""Which effects the scene calls for, and why, for people."""

from __future__ import annotations

from typing import TYPE_CHECKING

from nlens_video.effects.motion_blur import NEGLIGIBLE_SPAN_PX

if TYPE_CHECKING:
    from nlens_video.effects.planner import ShotFacts

EACH_FRAME = "decided on each frame"


def motion_blur(shot: ShotFacts) -> tuple[bool, str]:
    """Blur of what moves while the shutter is open."""
    shutter = shot.shutter
    if shot.pre_rendered:
        return False, "pre-rendered layers already contain motion blur"
    if not shot.moves:
        return False, "neither object nor camera moves"
    if not shutter.frame_s:
        return False, "a still has no frame time"
    if not shutter.open_s:
        return False, "--shutter-angle 0"
    return True, (
        f"{EACH_FRAME}: called for where the object moves by {NEGLIGIBLE_SPAN_PX:g} px "
        f"while the shutter is open ({shutter.angle_deg:.4g} degrees or {shutter.open_s:.3g} s, "
        f"{shutter.source})"
    )


def shadow(shot: ShotFacts) -> tuple[bool, str]:
    """Shadow on the ground."""
    if shot.strength <= 0.0:
        return False, "--shadow-strength 0"
    if shot.pre_rendered and not shot.strength_given and not shot.sun:
        return False, (
            "the lighting of the layers is not known; "
            "--effects auto,+shadow casts one by the GLB's lights"
        )
    if shot.lamps:
        lights = f"{shot.lamps} light{'s' if shot.lamps > 1 else ''}"
        return True, f"cast on the ground by {lights}, plus contact shadow from ambient light"
    if shot.sun_from_plate:
        return True, "cast on the ground by ambient light, and by a sun estimated from the plate"
    return True, "contact shadow from ambient light; no light source casts another"


def self_shadow(shot: ShotFacts) -> tuple[bool, str]:
    """Shadows of the object's parts, and of objects, on each other."""
    if shot.pre_rendered:
        return False, "pre-rendered layers are lit already"
    if shot.on_object:
        under = "a light" if shot.on_object == 1 else f"the strongest of {shot.on_object} lights"
        return True, f"cast by parts of the object on each other under {under}"
    if shot.sun_from_plate:
        return True, "cast by parts of the object on each other where the plate tells a sun"
    return False, "no light source casts one"


def reflection(shot: ShotFacts) -> tuple[bool, str]:
    """Mirror image in the ground."""
    if shot.reflectance <= 0.0:
        return False, "the ground is assumed not to be glossy; give --ground-reflectance if it is"
    if shot.pre_rendered:
        return False, "pre-rendered layers do not show the object from below"
    return True, (
        f"--ground-reflectance: {shot.reflectance:g} at normal incidence, more at grazing "
        "angles (Schlick)"
    )
