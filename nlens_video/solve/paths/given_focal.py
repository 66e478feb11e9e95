"""Whether a path goes with the focal length that the user gives."""

from __future__ import annotations

import math

from nlens_video.core.errors import InputError
from nlens_video.core.numbers import with_error
from nlens_video.solve.paths.moving import Part, PartSolver

_NOMINAL = 0.01  # relative error of a focal length as lenses and fields of view are named
_MOST_ERRORS = 3.0  # standard errors: what lies farther off is contradicted


def told_against(
    solver: PartSolver, keyframes: list[int], focal_px: float, largest_error: float
) -> tuple[float, float] | None:
    """The focal length that a path tells by itself, where that contradicts a given one.

    Args:
        solver: of the part.
        keyframes: of it, at least two, in order.
        focal_px: the given focal length of the first one [px].
        largest_error: standard error of a focal length that counts as told [1].

    Returns:
        It by the frame's width and its relative standard error [1]; None where it goes with the
        given one, where the path does not tell one, and for a zoom.
    """
    try:
        found = solver.solve(keyframes, None)
    except InputError:
        return None
    if found.zooms:
        return None
    told = float(found.focals_px[0])
    apart = abs(math.log(told / focal_px))
    if apart <= _MOST_ERRORS * _NOMINAL:  # no error makes it more than three
        return None
    error = found.focal_error if isinstance(found, Part) else solver.focal_errors(found)[0]
    if error > largest_error or apart <= _MOST_ERRORS * math.hypot(error, _NOMINAL):
        return None
    return told / solver.size[0], error


def without_fov(told_deg: tuple[float, float] | None) -> str:
    """The beginning of advice to give no field of view, with what `told_against` found."""
    told = "" if told_deg is None else f"the movement tells {with_error(*told_deg)} degrees: "
    return f"{told}leave --fov out, or "
