"""The parts of the page about the lens: blur as maps, and the fit."""

from __future__ import annotations

from nlens_video.report.findings import Findings, Shown
from nlens_video.report.fit_plot import fit_plot, object_disparity
from nlens_video.report.maps import Map, close_up, object_coc_map, plate_coc_map, sigma_map
from nlens_video.report.markup import figure, image, key, missing, section, table
from nlens_video.report.prose import NEVER_SEEN, margin_words, no_fit_reason

_MAP_QUALITY = 86


def maps_part(findings: Findings) -> str:
    """Blur of plate and object in colours, how sure it is, and the result close up."""
    shown = findings.shown
    figures = [] if shown is None else _map_figures(findings, shown)
    reason = no_fit_reason(findings)
    body = missing(reason) if reason else ""
    if figures:
        body += f'<div class="pair">{"".join(figures)}</div>'
    return section("maps", "The blur", body or missing(NEVER_SEEN))


def _map_figures(findings: Findings, shown: Shown) -> list[str]:
    outline = " The white outline is the object's footprint on the ground."
    if findings.shot.ground is None or not findings.shot.ground.mask.any():
        outline = ""
    entries = (
        (
            plate_coc_map(findings, shown),
            "Blur of the plate",
            f"Diameter of the circle of confusion, estimated from the picture.{outline}",
        ),
        (
            object_coc_map(findings, shown),
            "Blur given to the object",
            "Same colours, same scale: where the object touches the ground, both pictures should "
            "agree.",
        ),
        (
            sigma_map(findings, shown),
            "How far the estimate may be off",
            "Expected error of the plate's blur; dark is confident.",
        ),
    )
    made = [_map_figure(one, name, words) for one, name, words in entries if one is not None]
    near = close_up(findings, shown)
    if near is not None:
        picture = image(near, "The object in the composite, close up")
        made.append(figure(picture, f"Composite, frame {shown.index}.", "The result, close up"))
    return made


def _map_figure(made: Map, name: str, words: str) -> str:
    top = made.scale.top_px
    ramp = ", ".join(made.scale.stops())
    ends = "".join(f"<span>{top * part:.3g}</span>" for part in (0.0, 0.25, 0.5, 0.75))
    legend = (
        f'<div class="legend" role="img" aria-label="Colour scale from 0 to {top:g} pixels">'
        f'<div class="ramp" style="background: linear-gradient(to right, {ramp})"></div>'
        f'<div class="ends">{ends}<span>{top:.3g} px</span></div></div>'
    )
    picture = image(made.image, f"{name}, in colours over the picture", _MAP_QUALITY)
    return figure(picture + legend, words, name)


def fit_part(findings: Findings) -> str:
    """The fitted relationship, drawn and in numbers."""
    regression, fit = findings.regression, findings.fit
    title = "The lens, fitted"
    if fit is None:
        return ""  # the maps' place says why
    if regression is None:
        reason = no_fit_reason(findings) or findings.doubt
        return section("fit", title, missing(reason) + _fit_numbers(findings))
    around = object_disparity(findings.shown)
    charts = "".join(
        figure(fit_plot(fit, regression.samples, around, signed=signed), "", name)
        for name, signed in (("As estimated, without sign", False), ("With sign", True))
    )
    words = (
        "Every dot is a piece of ground: its disparity (1 / depth) in the scene and the blur that "
        "the plate shows there. Both lie on one line, which is the lens: where it crosses zero is "
        "the focus. The fainter a dot, the less it was trusted."
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
    return section("fit", title, body + _fit_numbers(findings))


def _fit_numbers(findings: Findings) -> str:
    fit = findings.fit
    if fit is None:
        return ""
    plus_minus = "\N{PLUS-MINUS SIGN}"
    rows = [
        ("Slope", f"{fit.slope:.5g} {plus_minus} {fit.slope_stderr:.2g} px m"),
        ("Blur at infinity", f"{fit.intercept:.4g} {plus_minus} {fit.intercept_stderr:.2g} px"),
        ("Residual", f"{fit.rmse_px:.2f} px"),
        ("Samples", f"{fit.n}, {fit.inlier_fraction:.0%} of them agree"),
        ("Sign", f"{fit.sign}, {margin_words(fit)}"),
        ("Method", fit.method),
    ]
    if findings.shot.plate_coc is None:
        rows = [rows[0], rows[1], rows[-1]]
    return table("The fit in numbers", (), rows)
