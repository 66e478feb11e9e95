"""The lens distortion that the object is given, known before it is placed."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping

from nlens_video.cameras.solved import SolvedCamera
from nlens_video.core.optics import Distortion, LensOverrides
from nlens_video.effects.measurement import Measurement, overridden, solved_distortion
from nlens_video.effects.planner import EffectRequest

DISTORTION = "distortion"
_SEEN_PX = 1.0  # distance off at the corners from which on it is said


def known_distortion(optics: LensOverrides, solved: SolvedCamera | None) -> Measurement | None:
    """The distortion as it is given, else as it was solved; None where neither tells it.

    Args:
        optics: the user's values.
        solved: the plate's cameras, None where they are not known.
    """
    given = overridden(optics).get(DISTORTION)
    if given is not None or solved is None or not solved.distortion_k1:
        return given
    camera = solved.at(solved.keys[0].pts_s)
    half = 0.5 * math.hypot(camera.width, camera.height) / camera.fx
    return solved_distortion(solved.distortion_k1, half)


def followed_distortion(
    effects: str, simulated: frozenset[str], optics: LensOverrides, solved: SolvedCamera | None,
    measure: Callable[[], Mapping[str, Measurement]] = dict,
) -> Distortion | None:  # fmt: skip
    """The distortion that a run gives the object; None for none.

    Args:
        effects: as `EffectRequest.parse` reads them.
        simulated: effects that the pipeline has nodes for.
        optics: as of `known_distortion`.
        solved: as of `known_distortion`.
        measure: measures it on the plate; called where it is not known and may be simulated.

    Raises:
        UsageError: an effect that does not exist.
    """
    request = EffectRequest.parse(effects)
    if DISTORTION not in simulated.intersection(request.possible):
        return None
    found = known_distortion(optics, solved) or measure().get(DISTORTION)
    if found is None or not (found.called_for or request.asks_for(DISTORTION)):
        return None
    return found.model if isinstance(found.model, Distortion) else None


def note_if_straight(solved: SolvedCamera, pipeline: str) -> tuple[str, ...]:
    """A note where a pipeline leaves the object where a pinhole sees it, and the lens does not."""
    camera = solved.at(solved.keys[0].pts_s)
    corner_px = 0.5 * math.hypot(camera.width, camera.height)
    off_px = abs(solved.distortion_k1) * (corner_px / camera.fx) ** 2 * corner_px
    if off_px < _SEEN_PX:
        return ()
    return (
        f"the plate's lens is distorted (k1 {solved.distortion_k1:+.3f}), the pipeline "
        f"{pipeline!r} has no node for distortion: towards the corners the object is off by up to "
        f"{off_px:.0f} px; use --preset standard",
    )
