"""What to say of a solved camera, and where it is uncertain."""

from __future__ import annotations

from nlens_video.cameras.solved import CameraErrors, SolvedCamera
from nlens_video.core.numbers import with_error

_PITCH_DEG = 5.0  # standard error from which the ground visibly tilts
_FOV_SHARE = 0.15  # standard error of the field of view, as a share of it [1]
_REAL_DEG = (3.0, 150.0)  # fields of view of lenses in use
_BESIDE = 0.001  # of the width: half of a path's points are off by more [1]
_NAMED = 3  # segments in a note
# What to give, to a command that solves the camera, and to one that got it from a file.
_LENS = "--fov DEG if the lens is known", "--fov DEG to `nlens-video solve` if the lens is known"
_GROUND = (
    "--at, --size and --horizon to set the ground by eye",
    "--at, --size and --horizon without --camera-from to set the ground by eye",
)
_PATH = (
    "--range to leave out the frames that are crossed",
    "--range to `nlens-video solve` to leave out the frames that are crossed",
)
_GIVEN = "another --fov DEG or none", "another --fov DEG or none to `nlens-video solve`"
_FILE = "--camera-from CAMERA", "another --camera-from CAMERA"


def what_was_found(solved: SolvedCamera) -> str:
    """A plate's camera in one line; empty of a still one that is all a guess: `doubt` says it."""
    if solved.path == "still" and solved.fov == solved.horizon == "assumed":
        return ""
    first, errors = solved.keys[0], solved.errors
    level = round(first.pitch_deg, 1) + 0.0  # no negative zero
    fov, pitch = f"{first.fov_x_deg:.3g}", f"{level:.1f}"
    if solved.fov == solved.horizon == "measured" and errors == CameraErrors():
        return (
            f"the plate's camera: field of view {fov} degrees, pitch {pitch}, path {solved.path}; "
            "its file does not say how sure they are"
        )
    if solved.fov == "assumed":
        fov = with_error(first.fov_x_deg, errors.fov_deg)
    if solved.horizon == "assumed":
        pitch = with_error(level, errors.pitch_deg)
    return (
        f"the plate's camera: field of view {fov} degrees ({solved.fov_source}), "
        f"pitch {pitch} ({solved.horizon}), path {solved.path}"
    )


def doubt(solved: SolvedCamera, *, from_file: bool = False) -> str:
    """One sentence on what is uncertain about a plate's camera and what to give; empty if nothing.

    A field of view that is assumed is no fault of a camera that moves: its path then makes up for
    it where the object stands.

    Args:
        solved: the camera.
        from_file: whether the user gave it by a file.
    """
    fov, errors = solved.keys[0].fov_x_deg, solved.errors
    guessed = solved.fov == solved.horizon == "assumed"
    found, remedies = [], []
    if not _REAL_DEG[0] <= fov <= _REAL_DEG[1]:
        found.append(f"its field of view came out as {fov:.3g} degrees, which no usual lens has")
    elif solved.fov == "assumed" and solved.path != "moving":
        if guessed or not errors.fov_deg <= _FOV_SHARE * fov:
            found.append(f"its field of view is a guess, {fov:.0f} ± {errors.fov_deg:.0f} degrees")
    tilted = solved.horizon == "assumed" and (guessed or not errors.pitch_deg <= _PITCH_DEG)
    if found or (tilted and solved.fov == "assumed"):
        remedies.append(_LENS)
    if tilted:
        pitch = solved.keys[0].pitch_deg
        found.append(f"its pitch is a guess, {round(pitch)} ± {errors.pitch_deg:.0f} degrees")
    if found:
        remedies.append(_GROUND)
    if solved.fov_told_deg is not None:
        told = with_error(*solved.fov_told_deg)
        found.append(f"its movement tells a field of view of {told} degrees, not {fov:.3g}")
        remedies.append(_GIVEN)
    off = solved.reprojection_px
    # Before a still camera that says what moves, not where the camera is.
    if solved.path in ("rotation", "moving") and off is not None and off > _BESIDE * solved.width:
        found.append(f"half of the points that it follows lie over {off:.2g} px beside its path")
        remedies.append(_PATH)
    if not found:
        return ""
    *first, last = [remedy[from_file] for remedy in (*remedies, _FILE)]
    doubted = found[0] if len(found) == 1 else f"{', '.join(found[:-1])} and {found[-1]}"
    return f"the plate's camera is uncertain: {doubted}; give {', '.join(first)}, or {last}"


def missed(solved: SolvedCamera) -> str:
    """One sentence on lines that were to be ignored and are not there; empty if none."""
    if not solved.missed_lines:
        return ""
    ends = [",".join(f"{number:.3g}" for number in one) for one in solved.missed_lines[:_NAMED]]
    more = len(solved.missed_lines) - len(ends)
    named = f"{' or '.join(ends)}{f' or {more} others' if more else ''}"
    return (
        f"--ignore-lines: no line of the first frame lies along {named}; "
        "nlens-video studio shows where lines are, or leave these out"
    )
