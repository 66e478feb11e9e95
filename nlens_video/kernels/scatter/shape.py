"""The geometry of an aperture, in units of the radius of the disc of its area.

Coordinates are those of the picture of a highlight behind the focus: x right, y down. A point `a`
of the aperture displaces light there by `-coc_px / 2 * a`: with a positive CoC, before the focus,
the shape is turned by half a turn.
"""

from __future__ import annotations

import math
import sys
import warnings
from functools import lru_cache
from pathlib import Path

import cv2
import numpy as np
import PIL.Image

from nlens_video.core.errors import InputError
from nlens_video.core.layers import Bool, Float64
from nlens_video.core.optics import Aperture

LARGEST_PICTURE_PX = 4096
_OUTLINE_POINTS = 7200


def boundary(aperture: Aperture, angle_rad: Float64) -> Float64:
    """Distance of the outline from the centre, the cat's eye left out [radius].

    Args:
        aperture: round or of blades.
        angle_rad: direction from the centre, 0 to the right, growing downwards [rad].
    """
    if aperture.blades == 0:
        return np.ones_like(angle_rad)
    return _blades(aperture, angle_rad) / _mean_radius(aperture.blades, aperture.roundness)


def _blades(aperture: Aperture, angle_rad: Float64) -> Float64:
    """Outline of blades whose corners lie on the unit circle: arcs of radius 1 / roundness."""
    half_turn = math.pi / aperture.blades
    from_corner = angle_rad - math.radians(aperture.rotation_deg)
    across = np.mod(from_corner, 2.0 * half_turn) - half_turn  # from the middle of a blade
    apothem = math.cos(half_turn)
    if aperture.roundness < 1e-6:
        return np.asarray(apothem / np.cos(across))
    radius = 1.0 / aperture.roundness
    centre = apothem - math.sqrt(radius * radius - math.sin(half_turn) ** 2)
    return np.asarray(
        centre * np.cos(across) + np.sqrt(radius * radius - (centre * np.sin(across)) ** 2)
    )


@lru_cache(maxsize=256)
def _mean_radius(blades: int, roundness: float) -> float:
    """Radius of the disc of the area of blades whose corners lie on the unit circle."""
    aperture = Aperture(blades=blades, roundness=roundness)
    angle = np.linspace(0.0, 2.0 * math.pi, _OUTLINE_POINTS, endpoint=False)
    return float(np.sqrt(np.mean(_blades(aperture, angle) ** 2)))


def outer_radius(aperture: Aperture) -> float:
    """Distance of the outline's furthest point from the centre, >= 1 [radius]."""
    corner = np.array([math.radians(aperture.rotation_deg)])
    return float(boundary(aperture, corner)[0])


def row_ends(aperture: Aperture, y: Float64) -> tuple[Float64, Float64]:
    """Left and right end of the aperture at heights y, right < left where it is not [radius]."""
    angle = np.linspace(0.0, 2.0 * math.pi, _OUTLINE_POINTS, endpoint=False)
    radius = boundary(aperture, angle)
    down, across = radius * np.sin(angle), radius * np.cos(angle)
    top, bottom = int(down.argmin()), int(down.argmax())
    right = np.arange(top, bottom + _OUTLINE_POINTS + 1) % _OUTLINE_POINTS
    right = right[: (bottom - top) % _OUTLINE_POINTS + 1]
    left = np.arange(bottom, bottom + (top - bottom) % _OUTLINE_POINTS + 1) % _OUTLINE_POINTS
    outside = (y < down[top]) | (y > down[bottom])
    ends = (
        np.interp(y, down[left][::-1], across[left][::-1]),
        np.interp(y, down[right], across[right]),
    )
    return np.where(outside, 1.0, ends[0]), np.where(outside, -1.0, ends[1])


def barrel_centre(
    aperture: Aperture, x: Float64, y: Float64, frame_size: tuple[float, float]
) -> tuple[Float64, Float64]:
    """Centre of the disc, as large as `outer_radius`, to which the barrel cuts the aperture.

    Light from beyond the focus loses the side of the aperture that faces away from the middle of
    the frame: the rim in front of the lens hides it.

    Args:
        aperture: its `cat_eye` is how far the centre lies off at the corners.
        x: columns in the frame [px].
        y: rows in the frame [px].
        frame_size: width and height of the frame, in the units of `x` and `y`.

    Returns:
        x and y of the centre in the aperture [radius].
    """
    width, height = frame_size
    scale = -aperture.cat_eye / (0.5 * math.hypot(width, height))
    return scale * (x - 0.5 * width), scale * (y - 0.5 * height)


def contains(
    aperture: Aperture, x: Float64, y: Float64, barrel: tuple[float, float] = (0.0, 0.0)
) -> Bool:
    """Whether points lie within an aperture that is no picture.

    Args:
        aperture: round or of blades.
        x: to the right [radius].
        y: downwards [radius].
        barrel: `barrel_centre` at that place of the frame [radius].
    """
    within = np.hypot(x, y) <= boundary(aperture, np.arctan2(y, x))
    rim = outer_radius(aperture)
    return np.asarray(within & (np.hypot(x - barrel[0], y - barrel[1]) <= rim))


def read_picture(path: Path) -> Float64:
    """Transmission of an aperture given as a picture, (h, w), its maximum is 1.

    Raises:
        InputError: not a picture, too large, or all black.
    """
    stated = _stated_size(path)
    picture = None
    if stated is not None:
        if max(stated) > LARGEST_PICTURE_PX:
            size = f"{stated[0]}x{stated[1]}"
            raise InputError(f"aperture {path}: {size} px; at most {LARGEST_PICTURE_PX} a side")
        held = np.frombuffer(path.read_bytes(), np.uint8)  # imread takes names in UTF-8 alone
        picture = cv2.imdecode(held, cv2.IMREAD_GRAYSCALE | cv2.IMREAD_ANYDEPTH)
    if picture is None:
        raise InputError(
            f"aperture {path}: cannot be read as a picture; give a PNG, white on black"
        )
    light = np.maximum(np.nan_to_num(picture.astype(np.float64), posinf=0.0), 0.0)
    if not light.max() > 0.0:
        raise InputError(f"aperture {path}: all black, so no light would pass; white lets it pass")
    return np.asarray(light / light.max())


def _stated_size(path: Path) -> tuple[int, int] | None:
    """Width and height by the header, before anything is decoded; None where it is no picture."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of tags that do not matter; the size is bounded here
            with PIL.Image.open(path, formats=("PNG", "JPEG", "TIFF", "BMP")) as picture:
                return picture.size
    except PIL.Image.DecompressionBombError:
        return (sys.maxsize, sys.maxsize)
    except (OSError, SyntaxError, ValueError):
        return None
