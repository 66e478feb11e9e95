"""Placement of an object in a frame without a camera; focal lengths. Imports nothing heavy."""

from __future__ import annotations

import math
from collections.abc import Sequence

from msgspec import Struct

from nlens_video.core.errors import UsageError

ASSUMED_FOCAL_MM = 35.0
"""35 mm equivalent focal length assumed for plates without metadata [mm]."""
FULL_FRAME_DIAGONAL_MM = math.hypot(36.0, 24.0)
LEVEL = 0.5
"""Row of the horizon of a camera that is not pitched [frame height]."""
_FARTHEST = 5.0  # from the frame's middle: farther off it is a number of pixels [frame]
_STEEPEST_DEG = 45.0  # of a horizon
_USUAL = 0.35  # size of what is placed without one [frame height]
_HEADROOM = 0.05  # between it and the frame's top [frame height]
SMALLEST = 0.02
"""Size of an object, below which none is chosen [frame height]."""
_TALLEST = 20.0  # close-ups show a part of something taller than the frame [frame height]


class Region(Struct, frozen=True):
    """A part of the frame: a polygon; by the even-odd rule where it crosses itself.

    Attributes:
        corners: three or more, in fractions of the frame from its upper left corner
            [frame width, frame height].
    """

    corners: tuple[tuple[float, float], ...]

    @classmethod
    def of(cls, numbers: Sequence[float]) -> Region:
        """A region from numbers in [0, 1].

        Args:
            numbers: left, upper, right and lower border of a box; or column and row of each corner
                of a polygon.

        Raises:
            UsageError: they are not those of a region.
        """
        if not all(0.0 <= one <= 1.0 for one in numbers):
            raise UsageError("a region lies in the frame: numbers from 0 to 1")
        if len(numbers) == 4:
            left, upper, right, lower = numbers
            if not (left < right and upper < lower):
                raise UsageError("a box has its left and upper border first")
            return cls(((left, upper), (right, upper), (right, lower), (left, lower)))
        if len(numbers) < 6 or len(numbers) % 2:
            raise UsageError("a region has four numbers, or two for each of three corners or more")
        return cls(tuple(zip(numbers[::2], numbers[1::2], strict=True)))


class Placement(Struct, frozen=True, kw_only=True):
    """A place in the frame, in fractions of it, from its upper left corner.

    Attributes:
        at: column and row where the object touches the ground [frame width, frame height].
        size: rows from there up to the object's highest point, > 0 [frame height].
        yaw_deg: turn of the object about the vertical, counter-clockwise seen from above; at 0 its
            front (glTF's +Z) faces the viewer [deg].
        horizon: row of the horizon in the middle of the frame, above `at`; 0.5 is that of a level
            camera, None that of a solved camera [frame height].
        roll_deg: how steeply that horizon falls to the right, -45 to 45 [deg].
    """

    at: tuple[float, float]
    size: float
    yaw_deg: float = 0.0
    horizon: float | None = LEVEL
    roll_deg: float = 0.0

    def __post_init__(self) -> None:
        if not all(map(math.isfinite, (*self.at, self.size, self.yaw_deg, self.horizon or 0.0))):
            raise UsageError(f"--at, --size, --yaw, --horizon must be numbers: {self.describe()}")
        _check_place(self.at)
        _check_size(self.size)
        if self.horizon is None:
            return
        if abs(self.horizon - 0.5) > _FARTHEST:
            raise UsageError(
                f"--horizon {self.horizon:g} is far off; expected a fraction of the frame's "
                "height, 0 to 1, such as 0.4"
            )
        if not abs(self.roll_deg) <= _STEEPEST_DEG:
            raise UsageError(f"--roll {self.roll_deg:g} is not an angle from -45 to 45 degrees")
        if self.roll_deg == 0.0 and self.at[1] <= self.horizon:
            raise self.no_ground

    @property
    def horizon_row(self) -> float:
        """Row of the horizon, that of a level camera where none is given [frame height]."""
        return LEVEL if self.horizon is None else self.horizon

    @property
    def no_ground(self) -> UsageError:
        """What is said where the place lies above the horizon."""
        roll = f" --roll {self.roll_deg:g}" if self.roll_deg else ""
        return UsageError(
            f"--at {self.at[0]:g},{self.at[1]:g} lies above the horizon (--horizon "
            f"{self.horizon_row:g}{roll}), where no ground is; "
            "give a greater Y or a smaller --horizon"
        )

    def describe(self) -> str:
        """The command-line options that give this placement."""
        x, y = self.at
        given = f"--at {x:.4g},{y:.4g} --size {self.size:.4g} --yaw {self.yaw_deg:.4g}"
        if self.horizon is None:
            return given
        roll = f" --roll {self.roll_deg:.4g}" if self.roll_deg else ""
        return f"{given} --horizon {self.horizon:.4g}{roll}"


class GroundPlacing(Struct, frozen=True, kw_only=True):
    """A place on the ground of a solved camera; what is None is chosen.

    Attributes:
        at: column and row where the object touches the ground [frame width, frame height].
        size: rows from there up to the object's highest point, > 0 [frame height].
        height_m: height of the object, in place of `size` [m].
        yaw_deg: as of `Placement` [deg].
    """

    at: tuple[float, float] | None = None
    size: float | None = None
    height_m: float | None = None
    yaw_deg: float = 0.0

    def __post_init__(self) -> None:
        if self.size is not None and self.height_m is not None:
            raise UsageError("--size and --height both give the object's height; leave one out")
        if not math.isfinite(self.yaw_deg):
            raise UsageError(f"--yaw {self.yaw_deg:g} must be a number of degrees")
        if self.at is not None:
            _check_place(self.at)
        if self.size is not None:
            _check_size(self.size)

    def under(self, horizon: float | None = None, roll_deg: float = 0.0) -> Placement:
        """The place in a frame whose camera is not solved.

        Args:
            horizon: as of `Placement`; None: that of a level camera [frame height].
            roll_deg: as of `Placement` [deg].

        Raises:
            UsageError: no place is given, or it needs a scale.
        """
        if self.height_m is not None:
            raise UsageError(
                "--height needs a camera in metres (--camera-from); give --size in its place"
            )
        if self.at is None:
            if horizon is None:
                raise UsageError(
                    "to place the object give --at X,Y, fractions of the frame, or --camera-from "
                    "CAMERA, on whose ground a place is chosen"
                )
            raise UsageError(
                "to place the object under --horizon give --at X,Y, fractions of the frame"
            )
        size = usual_size(self.at) if self.size is None else self.size
        return Placement(
            at=self.at, size=size, yaw_deg=self.yaw_deg,
            horizon=LEVEL if horizon is None else horizon, roll_deg=roll_deg,
        )  # fmt: skip


def usual_size(at: tuple[float, float]) -> float:
    """Size of an object whose size is not given: it leaves room above [frame height].

    Args:
        at: where it touches the ground, as of `GroundPlacing`.
    """
    return min(_USUAL, max(at[1] - _HEADROOM, SMALLEST))


def _check_place(at: tuple[float, float]) -> None:
    x, y = at
    if not max(abs(x - 0.5), abs(y - 0.5)) <= _FARTHEST:
        raise UsageError(
            f"--at {x:g},{y:g} is far off; expected fractions of the frame, 0 to 1, such as "
            "0.5,0.8, and no pixels"
        )


def _check_size(size: float) -> None:
    if not 0.0 < size <= _TALLEST:
        raise UsageError(f"--size {size:g} is a share of the frame's height, above 0, such as 0.3")


def focal_of_fov(fov_deg: float, size: tuple[int, int], pixel_aspect: float = 1.0) -> float:
    """35 mm equivalent focal length, by the frame's diagonal, of a field of view [mm].

    Args:
        fov_deg: across the frame's width, above 0 and below 180 [deg].
        size: columns and rows of the frame [px].
        pixel_aspect: width of a pixel by its height [1].
    """
    width = size[0] * pixel_aspect
    distance = 0.5 * width / math.tan(0.5 * math.radians(fov_deg))  # in rows
    return distance * FULL_FRAME_DIAGONAL_MM / math.hypot(width, size[1])


def fov_of_focal(focal_mm: float, size: tuple[int, int]) -> float:
    """Field of view across a frame of square pixels, the inverse of `focal_of_fov` [deg]."""
    distance = focal_mm * math.hypot(*size) / FULL_FRAME_DIAGONAL_MM
    return 2.0 * math.degrees(math.atan(0.5 * size[0] / distance))
