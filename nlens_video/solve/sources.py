"""Which values of a solved camera are called measured, by their standard errors."""

from __future__ import annotations

import math

import numpy as np

from nlens_video.cameras.solved import CameraErrors, CameraKey, FovSource, PathKind, SolvedCamera
from nlens_video.core.layers import Float64
from nlens_video.solve.focal import KnownFov
from nlens_video.solve.still.prior import FOCAL_PRIOR, CameraPrior

FOV_MEASURED = 0.08
"""Largest standard error of a focal length that counts as measured [1]."""
_PITCH_MEASURED, _ROLL_MEASURED = math.radians(4.0), math.radians(1.5)
_UNKNOWN = np.array([
    math.radians(CameraErrors().pitch_deg), math.radians(CameraErrors().roll_deg), FOCAL_PRIOR[1],
])  # fmt: skip
_GROUND_ERROR = math.radians(0.5)  # of a plane through a path's points
_FINER = 0.6  # of the error that a tag has: smaller ones are measured [1]


def with_sources(
    size: tuple[int, int],
    keys: tuple[CameraKey, ...],
    errors: Float64,
    known: KnownFov | None,
    *,
    path: PathKind,
    method: str,
) -> SolvedCamera:
    """The camera, with what its values come from and their errors.

    Args:
        size: columns and rows [px].
        keys: the camera of each frame.
        errors: of pitch, roll [rad] and of the focal length (3,) [1].
        known: field of view from metadata or the user, None where it was measured alone.
        path: how the camera moves; the ground of one that leaves its place is measured where its
            errors are known.
        method: what it was solved by.
    """
    known_errors = bool(np.isfinite(errors).all())
    errors = np.where(np.isfinite(errors), errors, _UNKNOWN)
    source: FovSource = "assumed" if known is None else "metadata"
    if errors[2] < min(FOV_MEASURED, _FINER * (known.error if known else 1.0)):
        source = "measured"
    sure = bool(errors[0] < _PITCH_MEASURED and errors[1] < _ROLL_MEASURED)
    # d fov / d log focal = -sin(fov)
    fov_error = math.degrees(math.sin(math.radians(keys[0].fov_x_deg)) * float(errors[2]))
    return SolvedCamera(
        width=size[0],
        height=size[1],
        keys=keys,
        fov=source,
        horizon="measured" if sure or (path == "moving" and known_errors) else "assumed",
        path=path,
        errors=CameraErrors(
            fov_deg=fov_error,
            pitch_deg=math.degrees(errors[0]),
            roll_deg=math.degrees(errors[1]),
        ),
        method=method,
    )


def fov_of_focal(focal: float) -> float:
    """Field of view across the frame [deg] of a focal length by its width [1]."""
    return 2.0 * math.degrees(math.atan(0.5 / focal))


def errors_of_path(pitch: float, focal_error: float) -> Float64:
    """Errors of pitch, roll [rad] and focal length (3,) [1] of a path whose ground has points.

    A focal length that is off stretches the scene along the axis, and tilts its ground.

    Args:
        pitch: of the first camera, down or up [rad].
        focal_error: relative error of the focal length [1].
    """
    tilt = 0.5 * abs(math.sin(2.0 * pitch)) * focal_error
    return np.array([math.hypot(_GROUND_ERROR, tilt), _GROUND_ERROR, focal_error])


def fov_with_error(focal: float, error: float) -> tuple[float, float]:
    """Field of view and its error [deg] of a focal length by the width and its relative one [1]."""
    fov = fov_of_focal(focal)
    return fov, math.degrees(math.sin(math.radians(fov)) * error)


def method_of(lines: str, prior: CameraPrior) -> str:
    """Everything that told of a camera, in words."""
    told = [lines]
    told += ["blur"] if prior.blur else []
    told += ["the camera network"] if prior.picture else []
    return " and ".join(told) if len(told) < 3 else f"{', '.join(told[:-1])} and {told[-1]}"
