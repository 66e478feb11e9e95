"""Section "Lens fit": the paper's fitted relationship (section 4.2), CoC against disparity."""

from __future__ import annotations

import numpy as np

from nlens_video.core.lens_fit import LensFit
from nlens_video.report.findings import Findings, MainFrame
from nlens_video.report.html import figure, key, missing, section, table
from nlens_video.report.svg import Axes, dots, line, nice_step, path, text
from nlens_video.stages.r_samples import FitSamples

_DRAWN_SAMPLES = 3000
_WEIGHT_STEPS = 4  # shades of a sample
_WIDTH, _HEIGHT = 560.0, 420.0
_MARGINS = (58.0, 46.0, 14.0, 52.0)


def unit_name(unit_m: float | None) -> str:
    """Name of the scene's unit in the report.

    Args:
        unit_m: its length, None where the scale is not known [m].
    """
    return "m" if unit_m == 1.0 else "units"


def object_disparity(main: MainFrame | None) -> tuple[float, float] | None:
    """Least and greatest disparity of the object on the main frame [1 / scene unit]."""
    if main is None or main.defocused is None:
        return None
    layer = main.defocused.layer
    depth = layer.depth[(layer.rgba[..., 3] > 0.5) & np.isfinite(layer.depth) & (layer.depth > 0)]
    if not depth.size:
        return None
    farthest, nearest = np.quantile(depth, [0.99, 0.01])
    return 1.0 / float(farthest), 1.0 / float(nearest)


def fit_section(findings: Findings) -> str:
    """The fit as two charts and in numbers."""
    regression, fit = findings.regression, findings.fit
    if fit is None:
        return ""  # the section before says why
    unit = unit_name(findings.session.context.unit_m)
    if regression is None:
        body = missing(findings.no_fit_reason or findings.doubt)
    else:
        around = object_disparity(findings.main)
        charts = "".join(
            figure(fit_plot(fit, regression.samples, around, unit, signed=signed), "", name)
            for name, signed in (("Unsigned, as estimated", False), ("Signed", True))
        )
        words = (
            "Each dot is a sample of the ground: its disparity (1 / depth) in the scene and its "
            "CoC in the plate. The lens relates both by a line, which is zero in the focal plane. "
            "The fainter a dot, the less weight it has in the robust fit."
        )
        marks = [
            ("plane w3", "ground"),
            ("anchor w3", "footprint"),
            ("fit", "fitted line"),
            ("band", "one standard error"),
        ]
        if around is not None:
            marks.append(("object", "depths of the object"))
        body = f'<p class="quiet">{words}</p>{key(marks)}<div class="pair">{charts}</div>'
    plus_minus = "\N{PLUS-MINUS SIGN}"
    rows = [
        ("Slope", f"{fit.slope:.5g} {plus_minus} {fit.slope_stderr:.2g} px {unit}"),
        ("CoC at infinity", f"{fit.intercept:.4g} {plus_minus} {fit.intercept_stderr:.2g} px"),
        ("Residual (RMS)", f"{fit.rmse_px:.2f} px"),
        ("Samples", f"{fit.n}, {fit.inlier_fraction:.0%} inliers"),
        ("Sign", f"{fit.sign}, {margin_words(fit)}"),
        ("Method", fit.method),
    ]
    if fit.other is not None:
        slope, intercept = fit.other
        other = f"slope {slope:.5g} px {unit}, CoC at infinity {intercept:.4g} px"
        rows.insert(-1, ("Lens of the other sign", other))
    if findings.shot.plate_coc is None:  # a fit that was given
        del rows[2:-1]
    return section("fit", "Lens fit", body + table("The fit in numbers", (), rows))


def margin_words(fit: LensFit) -> str:
    """How well the opposite sign fits."""
    if not np.isfinite(fit.sign_margin):
        return "the opposite sign does not fit at all"
    if fit.sign_margin >= 1:
        return f"the opposite sign fits {1 + fit.sign_margin:.2g} times as badly"
    return f"the opposite sign fits {fit.sign_margin:.0%} worse"


def fit_plot(
    fit: LensFit, samples: FitSamples, around: tuple[float, float] | None, unit: str, *,
    signed: bool,
) -> str:  # fmt: skip
    """SVG of the unsigned V, or of the signed line.

    Args:
        fit: the lens.
        samples: what it was fitted on.
        around: the object's range of disparities, marked; None for none.
        unit: name of the scene's unit.
        signed: whether samples take the sign that the fit gives them.
    """
    axes = _axes(fit, samples, around, signed=signed)
    subject = "Signed" if signed else "Unsigned"
    depths = [
        (1 / depth, f"{depth:g}")
        for power in range(6, -5, -1)
        for depth in (step * 10.0**power for step in (7, 5, 3, 2, 1.5, 1))
        if axes.x[0] < 1 / depth <= axes.x[1]
    ]
    body = [
        _object_range(axes, around),
        axes.frame(
            f"disparity (1 / {unit})", "signed CoC diameter (px)" if signed else "CoC diameter (px)"
        ),
        axes.top_labels([(0.0, "\N{INFINITY}"), *depths], f"depth ({unit})"),
        _samples(axes, fit, samples, signed=signed),
        _line(axes, fit, signed=signed),
        _focus(axes, fit, unit),
    ]
    return axes.drawing(
        f"{subject} CoC against disparity",
        f"{fit.n} samples of the ground and the fitted line, {fit.slope:.3g} px {unit} times "
        f"disparity {fit.intercept:+.3g} px; shaded: one standard error.",
        "".join(body),
    )


def _axes(
    fit: LensFit, samples: FitSamples, around: tuple[float, float] | None, *, signed: bool
) -> Axes:
    right = float(np.quantile(samples.disparity, 0.998))
    if around is not None:
        right = max(right, around[1])
    right *= 1.04
    ends = fit.coc_px(np.array([0.0, right], np.float32))
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
        chosen = np.flatnonzero(inside & (samples.anchor == anchor))
        if len(chosen) > _DRAWN_SAMPLES:  # the same ones on every run
            random = np.random.default_rng(0)
            chosen = np.sort(random.choice(chosen, _DRAWN_SAMPLES, replace=False))
        shade = np.minimum((samples.weight[chosen] * _WEIGHT_STEPS).astype(int), _WEIGHT_STEPS - 1)
        for step in range(_WEIGHT_STEPS):
            at = chosen[shade == step]
            parts.append(dots(axes.points(samples.disparity[at], coc[at]), f"{kind} w{step}"))
    return "".join(parts)


def _line(axes: Axes, fit: LensFit, *, signed: bool) -> str:
    focus = fit.focus_disparity
    disparity = np.linspace(*axes.x, 161)
    if axes.x[0] < focus < axes.x[1]:
        disparity = np.sort(np.append(disparity, focus))
    coc, error = fit.coc_px(disparity), fit.coc_stderr_px(disparity)
    if not signed:
        coc = np.abs(coc)
    low, high = np.clip([coc - error, coc + error], *axes.y)
    band = axes.points(disparity, high) + axes.points(disparity, low)[::-1]
    return path(band, "band", closed=True) + path(
        axes.points(disparity, np.clip(coc, *axes.y)), "fit"
    )


def _focus(axes: Axes, fit: LensFit, unit: str) -> str:
    focus = fit.focus_disparity
    if not axes.x[0] < focus < axes.x[1]:
        return ""
    x = axes.place_x(focus)
    near_right = x > axes.right - 110
    place = (x - 6 if near_right else x + 6, axes.top + 14)
    words = f"focus, {1 / focus:.3g} {unit}"
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
