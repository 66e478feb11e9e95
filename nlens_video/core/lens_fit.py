"""Linear lens model: slope and intercept stand for focal length, f-number, focus and scale."""

from __future__ import annotations

import json
import math
from functools import cache
from pathlib import Path
from typing import Literal, get_args

import numpy as np
import numpy.typing as npt
from msgspec import Struct
from msgspec.structs import asdict, fields

from nlens_video.core.errors import LensFitError
from nlens_video.core.known_lens import LensPrior
from nlens_video.core.layers import Float32, Float64
from nlens_video.core.numbers import with_error

Sign = Literal["resolved", "assumed", "ambiguous"]
MODEL = "coc_px = slope * disparity + intercept"
IN_FOCUS_PX = 0.5  # a CoC below it is not seen
LARGEST_COC_PX = 1e9
"""CoC diameters are clamped to this: larger than any frame, its square still a float32 [px]."""
_KINDS = (float, int)
_LARGEST = 1e18  # magnitude of any number of a fit: its square is still a float32


class LensFit(Struct, frozen=True, kw_only=True):
    """Linear lens model, coc_px = slope * disparity + intercept (paper, section 4.1, eq. 1 and 2).

    Attributes:
        slope: change of the signed CoC diameter per disparity [px * scene unit], >= 0.
        intercept: signed CoC diameter at infinity [px]; negative: infinity lies behind the focus.
        slope_stderr: standard error of the slope [px * scene unit].
        intercept_stderr: standard error of the intercept [px].
        correlation: of the errors of slope and intercept, -1 to 1 [1].
        readings_share: part of the standard errors that is of the readings; the rest is what they
            leave open, alike on every frame of a shot, 0 to 1 [1].
        rmse_px: weighted root mean square residual of the inliers [px].
        n: pixels that entered the fit [1].
        inlier_fraction: share of them that the robust loss kept, 0 to 1 [1].
        width: width of the frame whose pixels the diameters count [px].
        height: height of that frame [px].
        frame: index of the frame the fit was made on [1].
        sign: `resolved` by the data; `assumed`: given (`--prefer`), of one CoC for all depths, or
            lent by other frames; or `ambiguous`.
        sign_margin: relative cost by which the other sign fits worse, 0 = not at all [1].
        other: slope and intercept of the best lens of the other sign, where the plate does not
            tell the sign [px * scene unit, px].
        object_disparity: of the middle of the object's depths when the fit was made, 0 where it is
            not known [1 / scene unit].
        method: description of how it was found.
        ground_seen: pairs of disparity, rising, and the share of the plate there that shows the
            ground plane unoccluded, 0 to 1; empty where not measured [1 / scene unit].
    """

    slope: float
    intercept: float
    slope_stderr: float = 0.0
    intercept_stderr: float = 0.0
    correlation: float = 0.0
    readings_share: float = 1.0
    rmse_px: float = 0.0
    n: int = 0
    inlier_fraction: float = 1.0
    width: int
    height: int
    frame: int = 0
    sign: Sign = "resolved"
    sign_margin: float = 0.0
    other: tuple[float, float] | None = None
    object_disparity: float = 0.0
    method: str = "given"
    ground_seen: tuple[tuple[float, float], ...] = ()

    def __post_init__(self) -> None:
        if not (abs(self.slope) <= _LARGEST and abs(self.intercept) <= _LARGEST):  # or NaN
            raise LensFitError(
                f"lens fit out of range (slope {self.slope}, intercept {self.intercept}; at most "
                f"{_LARGEST:g}); give --fit FILE.json or --fallback constant"
            )
        if self.slope < 0:
            raise LensFitError(
                f"lens fit has a slope of {self.slope:g}; it must not be negative (coc_px is "
                "positive nearer than the focal plane)"
            )
        if self.width < 1 or self.height < 1:
            raise LensFitError(f"lens fit names a frame of {self.width}x{self.height} pixels")

    @property
    def focus_disparity(self) -> float:
        """Disparity at which the CoC is zero [1 / scene unit]; infinite for a constant CoC."""
        return -self.intercept / self.slope if self.slope else math.inf

    def coc_px(self, disparity: Float32 | Float64) -> Float32:
        """Signed CoC diameter [px], positive nearer than focus, of disparity [1 / scene unit].

        A finite number for any finite disparity: beyond `LARGEST_COC_PX` it stays there.
        """
        with np.errstate(over="ignore"):
            coc = np.float32(self.slope) * disparity + np.float32(self.intercept)
        return np.asarray(np.clip(coc, -LARGEST_COC_PX, LARGEST_COC_PX), dtype=np.float32)

    def coc_stderr_px(self, disparity: npt.ArrayLike) -> Float64:
        """Standard error of the CoC [px] of disparity [1 / scene unit], of the same shape."""
        far, near = self.intercept_stderr, self.slope_stderr * np.asarray(disparity, np.float64)
        variance = near**2 + far**2 + 2.0 * self.correlation * near * far
        return np.asarray(np.sqrt(np.maximum(variance, 0.0)))

    @property
    def depends_on_depth(self) -> bool:
        """Whether the slope is told from zero: it is at least two standard errors."""
        return self.slope > 0.0 and self.slope >= 2.0 * self.slope_stderr

    @property
    def usual_coc_px(self) -> float:
        """Unsigned CoC in the middle of the ground in view, at infinity if none was seen [px]."""
        seen = [disparity for disparity, _ in self.ground_seen]
        middle = seen[len(seen) // 2] if seen else 0.0
        return abs(self.slope * middle + self.intercept)

    def describe(self) -> str:
        """The lens in one line; a slope that is not told from zero is not shown as one."""
        if not self.depends_on_depth:
            blur = self.usual_coc_px
            alike = f"the same blur at all depths ({blur:.1f} px)"
            alike = "in focus everywhere" if blur < IN_FOCUS_PX else alike
            return f"{alike}{self._of_the_object()}; {self.method}"
        focus = self.focus_disparity
        depth = "infinity"
        if focus > 0.0:
            error = float(self.coc_stderr_px(focus)) / self.slope / focus**2
            depth = f"depth {with_error(1.0 / focus, error)}"
        return (
            f"coc_px = {with_error(self.slope, self.slope_stderr)} · disparity "
            f"{'-' if self.intercept < 0 else '+'} "
            f"{with_error(abs(self.intercept), self.intercept_stderr)}, in focus at {depth}"
            f"{self._of_the_object()}{self._of_the_fit()}"
        )

    def _of_the_fit(self) -> str:
        """Words on how well the lens fits; on where it is from, if no pixel was fitted."""
        if self.n == 0:
            return f"; {self.method}" if self.method else ""
        return f"; residual {self.rmse_px:.2f} px, sign {self.sign} (margin {self.sign_margin:.2g})"

    def _of_the_object(self) -> str:
        """Words on the object's CoC, empty where its depth is not known."""
        if self.object_disparity <= 0.0:
            return ""
        there = self.object_disparity
        coc_px = abs(self.slope * there + self.intercept)
        return f"; CoC of the object {with_error(coc_px, float(self.coc_stderr_px(there)))} px"

    def ground_share(self, disparity: Float32) -> Float32:
        """Share of the plate that shows the ground plane, by the plane's disparity >= 0 (h, w) [1].

        Interpolated linearly to 0 at the horizon beyond the farthest ground measured.
        """
        if not self.ground_seen:
            return np.zeros_like(disparity)
        knots, shares = np.array([(0.0, 0.0), *self.ground_seen]).T
        return np.asarray(np.interp(disparity, knots, shares), dtype=np.float32)

    def for_width(self, width: int, height: int) -> LensFit:
        """The same lens on a frame of another size: diameters scale with the width."""
        return self._scaled(width / self.width, width=width, height=height)

    def zoomed(self, ratio: float) -> LensFit:
        """The same lens at another focal length, with its f-number and its focus held.

        On the sensor the diameter of the aperture and the magnification both grow with the focal
        length f, and a CoC with their product: f A (1/s - 1/d), A = f / N.

        Args:
            ratio: that focal length by the one of the fit [1].
        """
        return self._scaled(ratio * ratio)

    def _scaled(self, scale: float, **changed: int) -> LensFit:
        """All diameters times a factor."""
        values = asdict(self)
        for name in ("slope", "intercept", "slope_stderr", "intercept_stderr", "rmse_px"):
            values[name] *= scale
        if self.other is not None:
            values["other"] = (scale * self.other[0], scale * self.other[1])
        return LensFit(**{**values, **changed})

    @classmethod
    def of_known(cls, known: LensPrior, width: int, height: int, frame: int) -> LensFit:
        """The lens that is known beforehand, where a plate tells nothing.

        Args:
            known: slope and focus.
            width: of the frame [px].
            height: of the frame [px].
            frame: index of the frame, kept in the fit.

        Raises:
            ValueError: slope or focus is missing.
        """
        slope, focus = known.slope, known.focus
        if slope is None or focus is None:
            raise ValueError("slope and focus are needed")
        far = slope.error * focus.value
        error = math.hypot(far, slope.value * focus.error)
        return cls(
            slope=slope.value,
            intercept=-slope.value * focus.value,
            slope_stderr=slope.error,
            intercept_stderr=error,
            correlation=-far / error if error else 0.0,
            width=width,
            height=height,
            frame=frame,
            method="the lens that is known, for the plate tells nothing",
        )

    def to_json(self) -> str:
        """The text of `fit.json`."""
        return json.dumps({"model": MODEL, **asdict(self)}, indent=2) + "\n"

    @classmethod
    def from_json(cls, text: str, source: str = "fit.json") -> LensFit:
        """Read the text of `fit.json`.

        Raises:
            LensFitError: not JSON, a number missing or of the wrong kind, another model.
        """
        try:
            raw = json.loads(text)
        except (ValueError, RecursionError) as error:
            raise LensFitError(f"{source}: not JSON ({error}); expected a saved fit") from error
        if not isinstance(raw, dict) or raw.get("model", MODEL) != MODEL:
            raise LensFitError(f'{source}: expected an object with "model": "{MODEL}"')
        known: dict[str, object] = {}
        for name, kind, required in _numbers():
            if name not in raw:
                if not required:
                    continue
                raise LensFitError(f'{source}: "{name}" is missing; it must be a number')
            value = raw[name]
            size = name.endswith("_stderr") or name == "rmse_px"
            if type(value) not in _KINDS or not abs(value) <= _LARGEST or (size and value < 0):
                raise LensFitError(f'{source}: "{name}" is {value!r:.40}, expected a number')
            known[name] = kind(value)
        known["ground_seen"] = _pairs(raw.get("ground_seen", ()), source)
        known["other"] = _other(raw.get("other"), source)
        sign = raw.get("sign", "resolved")
        if sign not in get_args(Sign):
            raise LensFitError(f'{source}: "sign" is {sign!r}, expected one of {get_args(Sign)}')
        return cls(**known, sign=sign, method=str(raw.get("method", "given")))  # type: ignore[arg-type]

    @classmethod
    def load(cls, path: Path) -> LensFit:
        """Read a `fit.json` file.

        Raises:
            LensFitError: the file cannot be read or is no fit.
        """
        try:
            return cls.from_json(path.read_text(encoding="utf-8"), str(path))
        except (OSError, UnicodeDecodeError) as error:
            raise LensFitError(f"{path}: cannot be read ({error}); expected a saved fit") from error


@cache
def _numbers() -> list[tuple[str, type[float] | type[int], bool]]:
    """Fields that are numbers: name, kind, and whether a file must hold it."""
    return [(one.name, one.type, one.required) for one in fields(LensFit) if one.type in _KINDS]


def _other(raw: object, source: str) -> tuple[float, float] | None:
    """Parse the lens of the other sign."""
    if raw is None:
        return None
    try:
        slope, intercept = np.array(raw, dtype=np.float64).reshape(2).tolist()
    except (TypeError, ValueError, OverflowError):
        slope = intercept = math.nan
    if not (0.0 <= slope <= _LARGEST and abs(intercept) <= _LARGEST):
        raise LensFitError(f'{source}: "other" must be a slope, not negative, and an intercept')
    return slope, intercept


def _pairs(raw: object, source: str) -> tuple[tuple[float, float], ...]:
    """Parse pairs of disparity and share."""
    try:
        values = np.array(raw, dtype=np.float64).reshape(-1, 2)
    except (TypeError, ValueError, OverflowError):
        values = np.full((1, 2), np.nan)
    disparity, share = values.T
    rising = bool((np.diff(disparity, prepend=0.0) > 0.0).all())
    if not (rising and np.isfinite(values).all() and (abs(share - 0.5) <= 0.5).all()):
        raise LensFitError(
            f'{source}: "ground_seen" must be pairs of a rising disparity > 0 and a share in [0, 1]'
        )
    return tuple((float(at), float(part)) for at, part in values)
