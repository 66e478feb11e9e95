"""Errors of a solved camera's attitude and field of view, against what it states of them."""

from __future__ import annotations

import math

from msgspec import Struct

from nlens_video.cameras.solved import SolvedCamera


class AngleError(Struct, frozen=True, kw_only=True):
    """The error of one quantity; not a number where nothing was solved.

    Attributes:
        true: its true value [deg].
        error: found - true [deg, or % of the true value].
        stated: the standard error that the camera states, not a number for none [as error].
        measured: whether the camera calls it measured.
    """

    true: float
    error: float
    stated: float
    measured: bool

    def figures(self, name: str) -> dict[str, float]:
        """Figures of a row that is one plate's."""
        parts = {"true": self.true, "error": self.error, "stated": self.stated}
        return {f"{name}_{part}": value for part, value in parts.items()} | {
            f"{name}_measured": float(self.measured)
        }

    def summary(self) -> dict[str, float]:
        """Figures to summarise over plates."""
        size = abs(self.error)
        known = math.isfinite(size) and math.isfinite(self.stated)
        within = 100.0 * (size <= self.stated) if known else math.nan
        return {
            "all": size,
            "sure": size if self.measured else math.nan,
            "measured": 100.0 * self.measured,
            "within": within,
            "sure_within": within if self.measured else math.nan,
        }

    def area(self, threshold: float) -> float:
        """Its part in the area under the recall curve up to a threshold, 0 to 100 [%].

        The mean over plates is that area: the curve is the share of plates whose error is smaller.
        """
        if math.isnan(self.error):
            return 0.0
        return 100.0 * max(0.0, 1.0 - abs(self.error) / threshold)


UNSOLVED = AngleError(true=math.nan, error=math.nan, stated=math.nan, measured=False)


def angle_errors(known: SolvedCamera, found: SolvedCamera) -> dict[str, AngleError]:
    """Errors in the first frame: `pitch`, `roll`, `fov` across, `fov_share` and `yfov`.

    `fov_share` is that of `fov` by the true one [%].
    """
    true, seen, stated = known.keys[0], found.keys[0], found.errors
    level, lens = found.horizon == "measured", found.fov == "measured"
    share = 100.0 / true.fov_x_deg
    across = seen.fov_x_deg - true.fov_x_deg
    high = _yfov(known, true.fov_x_deg)
    return {
        "pitch": AngleError(
            true=true.pitch_deg, error=seen.pitch_deg - true.pitch_deg, stated=stated.pitch_deg,
            measured=level,
        ),
        "roll": AngleError(
            true=true.roll_deg, error=seen.roll_deg - true.roll_deg, stated=stated.roll_deg,
            measured=level,
        ),
        "fov": AngleError(
            true=true.fov_x_deg, error=across, stated=stated.fov_deg, measured=lens
        ),
        "fov_share": AngleError(
            true=true.fov_x_deg, error=share * across, stated=share * stated.fov_deg, measured=lens
        ),
        "yfov": AngleError(
            true=high, error=_yfov(found, seen.fov_x_deg) - high, stated=math.nan, measured=lens
        ),
    }  # fmt: skip


def _yfov(camera: SolvedCamera, fov_x_deg: float) -> float:
    half = math.tan(0.5 * math.radians(fov_x_deg)) / camera.aspect
    return 2.0 * math.degrees(math.atan(half))
