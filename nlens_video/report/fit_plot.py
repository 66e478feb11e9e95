"""The paper's fitted relationship (its section 4.2): CoC against disparity, samples and line."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from nlens_video.core.layers import Float64
from nlens_video.core.lens_fit import LensFit
from nlens_video.report.findings import Shown
from nlens_video.report.svg import Axes, dots, line, nice_step, path, text
from nlens_video.stages.r_regression import FitSamples

_DRAWN_SAMPLES = 3000
_WEIGHT_STEPS = 4  # shades of a sample
_WIDTH, _HEIGHT = 560.0, 420.0
_MARGINS = (58.0, 46.0, 14.0, 52.0)


@dataclass(frozen=True, slots=True, kw_only=True)
class FitCurve:
    """The line and how sure it is.

    Attributes:
        fit: the lens.
        correlation: of the errors of slope and intercept, -1 to 1 [1].
    """

    fit: LensFit
    correlation: float

    @classmethod
    def of(cls, fit: LensFit, samples: FitSamples) -> FitCurve:
        """The correlation is that of weighted least squares on the same samples."""
        weight = samples.weight / np.maximum(samples.sigma_px, 1e-3) ** 2
        weight = weight / max(float(weight.sum()), 1e-300)
        mean = float(weight @ samples.disparity)
        square = float(weight @ samples.disparity**2)
        return cls(fit=fit, correlation=-mean / max(np.sqrt(square), 1e-300))

    def coc_px(self, disparity: Float64) -> Float64:
        """Signed CoC [px]."""
        return np.asarray(self.fit.slope * disparity + self.fit.intercept)

    def stderr_px(self, disparity: Float64) -> Float64:
        """Standard error of the line [px]."""
        slope, intercept = self.fit.slope_stderr, self.fit.intercept_stderr
        both = 2 * self.correlation * slope * intercept * disparity
        variance = (slope * disparity) ** 2 + intercept**2 + both
        return np.asarray(np.sqrt(np.maximum(variance, 0.0)))


def object_disparity(shown: Shown | None) -> tuple[float, float] | None:
    """Least and greatest disparity of the object on the frame shown [1 / scene unit]."""
    if shown is None or shown.defocused is None:
        return None
    layer = shown.defocused.layer
    depth = layer.depth[(layer.rgba[..., 3] > 0.5) & np.isfinite(layer.depth) & (layer.depth > 0)]
    if not depth.size:
        return None
    farthest, nearest = np.quantile(depth, [0.99, 0.01])
    return 1.0 / float(farthest), 1.0 / float(nearest)


def fit_plot(
    fit: LensFit, samples: FitSamples, around: tuple[float, float] | None, *, signed: bool
) -> str:
    """SVG of the unsigned V, or of the signed line that it stands for.

    Args:
        fit: the lens.
        samples: what it was fitted on.
        around: the object's range of disparities, marked; None for none.
        signed: whether samples take the sign that the fit gives them.
    """
    curve = FitCurve.of(fit, samples)
    axes = _axes(curve, samples, around, signed=signed)
    subject = "Signed" if signed else "Unsigned"
    body = [
        _object_range(axes, around),
        axes.frame(
            "disparity (1 / m)", "signed CoC diameter (px)" if signed else "CoC diameter (px)"
        ),
        axes.top_labels(_depth_places(axes.x), "depth (m)"),
        _samples(axes, fit, samples, signed=signed),
        _line(axes, curve, signed=signed),
        _focus(axes, fit),
    ]
    return axes.drawing(
        f"{subject} blur against disparity",
        f"{fit.n} samples of the ground and the fitted line, {fit.slope:.3g} px m times disparity "
        f"{fit.intercept:+.3g} px; shaded: one standard error.",
        "".join(body),
    )


def _axes(
    curve: FitCurve, samples: FitSamples, around: tuple[float, float] | None, *, signed: bool
) -> Axes:
    right = float(np.quantile(samples.disparity, 0.998))
    if around is not None:
        right = max(right, around[1])
    right *= 1.04
    ends = curve.coc_px(np.array([0.0, right]))
    high = max(float(np.quantile(samples.coc_px, 0.99)), float(np.abs(ends).max()) * 1.05, 1.0)
    low = 0.0
    if signed:
        low = min(float(ends[0]) * 1.15, -0.05 * high)
        high = max(float(ends[1]) * 1.15, 0.15 * (float(ends[1]) - float(ends[0])), 1.0)
        step = nice_step((high - low) / 6)
        low, high = np.floor(low / step) * step, np.ceil(high / step) * step
    return Axes(
        width=_WIDTH, height=_HEIGHT, x=(0.0, right), y=(float(low), float(high)), margins=_MARGINS
    )


def _samples(axes: Axes, fit: LensFit, samples: FitSamples, *, signed: bool) -> str:
    """Dots, the fainter the less the robust loss left of them; the footprint's on top."""
    coc = samples.coc_px
    if signed:
        coc = coc * np.where(samples.disparity >= fit.focus_disparity, 1.0, -1.0)
    inside = (coc <= axes.y[1]) & (coc >= axes.y[0]) & (samples.disparity <= axes.x[1])
    parts = []
    for anchor, kind in ((False, "plane"), (True, "anchor")):
        chosen = _thinned(np.flatnonzero(inside & (samples.anchor == anchor)))
        shade = np.minimum((samples.weight[chosen] * _WEIGHT_STEPS).astype(int), _WEIGHT_STEPS - 1)
        for step in range(_WEIGHT_STEPS):
            at = chosen[shade == step]
            parts.append(dots(axes.points(samples.disparity[at], coc[at]), f"{kind} w{step}"))
    return "".join(parts)


def _thinned(
    places: np.ndarray[tuple[int], np.dtype[np.intp]],
) -> np.ndarray[tuple[int], np.dtype[np.intp]]:
    """At most `_DRAWN_SAMPLES`, the same ones on every run."""
    if len(places) <= _DRAWN_SAMPLES:
        return places
    chosen = np.random.default_rng(0).choice(len(places), _DRAWN_SAMPLES, replace=False)
    return places[np.sort(chosen)]


def _line(axes: Axes, curve: FitCurve, *, signed: bool) -> str:
    focus = curve.fit.focus_disparity
    disparity = np.linspace(*axes.x, 161)
    if axes.x[0] < focus < axes.x[1]:
        disparity = np.sort(np.append(disparity, focus))
    coc, error = curve.coc_px(disparity), curve.stderr_px(disparity)
    if not signed:
        coc = np.abs(coc)
    low, high = np.clip([coc - error, coc + error], *axes.y)
    band = axes.points(disparity, high) + axes.points(disparity, low)[::-1]
    return path(band, "band", closed=True) + path(
        axes.points(disparity, np.clip(coc, *axes.y)), "fit"
    )


def _focus(axes: Axes, fit: LensFit) -> str:
    focus = fit.focus_disparity
    if not axes.x[0] < focus < axes.x[1]:
        return ""
    x = float(axes.place_x(np.array(focus)))
    near_right = x > axes.right - 110
    place = (x - 6 if near_right else x + 6, axes.top + 14)
    words = f"focus, {1 / focus:.3g} m"
    return line((x, axes.top), (x, axes.bottom), "focus") + text(
        place, words, "label", "end" if near_right else "start"
    )


def _object_range(axes: Axes, around: tuple[float, float] | None) -> str:
    if around is None:
        return ""
    left, right = axes.place_x(np.clip(np.array(around), *axes.x)).tolist()
    return (
        f'<rect class="object" x="{left:.1f}" y="{axes.top:.1f}" '
        f'width="{max(right - left, 2):.1f}" height="{axes.bottom - axes.top:.1f}"/>'
        + text((0.5 * (left + right), axes.bottom - 8), "object", "label", "middle")
    )


def _depth_places(x: tuple[float, float]) -> list[tuple[float, str]]:
    """Round depths over the range of disparities, from far to near."""
    depths = sorted(
        (step * 10.0**power for power in range(-4, 7) for step in (1, 1.5, 2, 3, 5, 7)),
        reverse=True,
    )
    places = [(1 / depth, f"{depth:g}") for depth in depths if x[0] < 1 / depth <= x[1]]
    return [(0.0, "\N{INFINITY}"), *places]
