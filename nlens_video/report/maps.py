"""Section "Circle of confusion": maps of plate and object in colours, their expected error."""

from __future__ import annotations

from collections.abc import Iterator

import cv2
import numpy as np
from msgspec import Struct

from nlens_video.core.layers import Bool, Box, DefocusedLayer, Float32
from nlens_video.report.findings import NEVER_SEEN, Findings, MainFrame
from nlens_video.report.html import Image, figure, missing, picture, section

_WIDEST_PX = 960
_QUALITY = 86
_OPACITY = 0.72
_CLOSE_UP_MARGIN = 0.2  # of the object, on each side
COC_MAP, SIGMA_MAP = cv2.COLORMAP_VIRIDIS, cv2.COLORMAP_CIVIDIS  # readable with any colour vision


class Scale(Struct, frozen=True, kw_only=True):
    """A colour scale from 0 to `top_px`.

    Attributes:
        top_px: value of the last colour; larger values have it as well [px].
        colormap: OpenCV's number of the map.
    """

    top_px: float
    colormap: int

    def colors(self, values: Float32) -> Image:
        """Colours (H, W, 3), sRGB, of values (H, W) [px]."""
        levels = np.clip(values / self.top_px * 255.0, 0.0, 255.0).astype(np.uint8)
        return np.asarray(cv2.applyColorMap(levels, self.colormap)[..., ::-1], np.uint8)

    def legend(self) -> str:
        """The scale as HTML."""
        ramp = np.linspace(0.0, self.top_px, 9, dtype=np.float32)[None]
        stops = ", ".join(f"rgb({r} {g} {b})" for r, g, b in self.colors(ramp)[0])
        ends = "".join(f"<span>{self.top_px * part:.3g}</span>" for part in (0.0, 0.25, 0.5, 0.75))
        return (
            '<div class="legend" role="img" '
            f'aria-label="Colour scale from 0 to {self.top_px:g} pixels">'
            f'<div class="ramp" style="background: linear-gradient(to right, {stops})"></div>'
            f'<div class="ends">{ends}<span>{self.top_px:.3g} px</span></div></div>'
        )


def maps_section(findings: Findings) -> str:
    """CoC of plate and object, expected error of the plate's, and the composite close up."""
    figures = "" if findings.main is None else "".join(_figures(findings, findings.main))
    reason = findings.no_fit_reason
    body = missing(reason) if reason else ""
    if figures:
        body += f'<div class="pair">{figures}</div>'
    return section("maps", "Circle of confusion", body or missing(NEVER_SEEN))


def _figures(findings: Findings, main: MainFrame) -> Iterator[str]:
    frame = Box(0, 0, findings.info.width, findings.info.height)
    plate_coc, ground = findings.shot.plate_coc, findings.shot.ground
    footprint = None if ground is None or not ground.mask.any() else ground.mask
    tops = [] if plate_coc is None else [float(np.quantile(plate_coc.coc_px, 0.98))]
    if main.defocused is not None:
        tops.append(main.defocused.largest_coc_px)
    # one scale for plate and object, so that equal colours are equal CoC
    scale = Scale(top_px=_round_up(max(tops, default=1.0)), colormap=COC_MAP)

    def coc_map(
        name: str, words: str, values: Float32, scale: Scale, alpha: Float32 | None = None
    ) -> str:
        image = _overlay(main.before, values, scale, alpha)
        if footprint is not None:
            image = _outlined(image, footprint)
        shown = picture(image, f"{name}, in colours over the picture", _QUALITY)
        return figure(shown + scale.legend(), words, name)

    if plate_coc is not None:
        words = "Diameter of the circle of confusion (CoC), estimated from the picture."
        if footprint is not None:
            words += " The white outline is the object's footprint on the ground."
        yield coc_map("CoC of the plate", words, plate_coc.coc_px, scale)
    if main.defocused is not None:
        words = "Same scale: where the object touches the ground, both maps should agree."
        coc, alpha = _on_frame(main.defocused, frame)
        yield coc_map("CoC of the object", words, coc, scale, alpha)
    if plate_coc is not None:
        top = _round_up(float(np.quantile(plate_coc.sigma_px, 0.98)))
        errors = Scale(top_px=top, colormap=SIGMA_MAP)
        words = "Where it is dark, the estimate is confident."
        yield coc_map("Expected error of the plate's CoC", words, plate_coc.sigma_px, errors)
    if main.after is not None and main.defocused is not None:
        seen = main.defocused.layer.box.intersection(frame)
        near = _close_up(main.after, seen, main.after.shape[1] / frame.width)
        shown = picture(near, "The object in the composite, close up")
        yield figure(shown, f"Composite, frame {main.index}.", "Close-up of the result")


def _close_up(composite: Image, seen: Box, scale: float) -> Image:
    """The composite around the object, in the shape of the frame.

    Args:
        composite: the frame, which may be reduced.
        seen: the object's box on the frame [px].
        scale: of the composite against the frame [1].
    """
    height, width = composite.shape[:2]
    across = max(seen.width, seen.height * width / height)
    columns = min(width, max(16, round(scale * across * (1 + 2 * _CLOSE_UP_MARGIN))))
    rows = min(height, round(columns * height / width))
    x0 = round(scale * 0.5 * (seen.x0 + seen.x1) - 0.5 * columns)
    y0 = round(scale * 0.5 * (seen.y0 + seen.y1) - 0.5 * rows)
    x0, y0 = min(max(x0, 0), width - columns), min(max(y0, 0), height - rows)
    return composite[y0 : y0 + rows, x0 : x0 + columns]


def _overlay(picture: Image, values: Float32, scale: Scale, alpha: Float32 | None = None) -> Image:
    """Colours over the grey picture, everywhere or where alpha (H, W) is."""
    base = _reduced(picture)
    height, width = base.shape[:2]
    gray = cv2.cvtColor(base, cv2.COLOR_RGB2GRAY).astype(np.float32)[..., None]
    colors = cv2.resize(scale.colors(values), (width, height), interpolation=cv2.INTER_AREA)
    if alpha is None:
        # colours keep their lightness, which is what is read; the picture only shades them
        shade = 1.0 + (1.0 - _OPACITY) * (gray - float(gray.mean())) / 128.0
        mixed = colors * shade
    else:
        cover = cv2.resize(alpha, (width, height), interpolation=cv2.INTER_AREA)[..., None]
        mixed = gray + cover * (colors - gray)
    return np.asarray(np.clip(mixed, 0.0, 255.0), np.uint8)


def _outlined(image: Image, footprint: Bool) -> Image:
    """The footprint's outline, white on black, so that it is seen on any colour."""
    height, width = image.shape[:2]
    mask = cv2.resize(footprint.astype(np.uint8), (width, height), interpolation=cv2.INTER_NEAREST)
    outlines, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
    drawn = np.ascontiguousarray(image)
    for color, thickness in (((0, 0, 0), 4), ((255, 255, 255), 2)):
        cv2.drawContours(drawn, outlines, -1, color, thickness, lineType=cv2.LINE_AA)
    return drawn


def _reduced(picture: Image) -> Image:
    height, width = picture.shape[:2]
    if width <= _WIDEST_PX:
        return picture
    size = (_WIDEST_PX, max(1, round(height * _WIDEST_PX / width)))
    return np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA), np.uint8)


def _on_frame(defocused: DefocusedLayer, frame: Box) -> tuple[Float32, Float32]:
    """Unsigned CoC [px] and alpha of the object on the whole frame (H, W) each."""
    coc = np.zeros((frame.height, frame.width), np.float32)
    alpha = np.zeros_like(coc)
    box = defocused.layer.box
    inside = box.intersection(frame)
    if not inside.empty:
        here, there = inside.slices_in(frame), inside.slices_in(box)
        coc[here] = np.abs(defocused.coc_px[there])
        alpha[here] = np.clip(defocused.layer.rgba[there][..., 3], 0.0, 1.0)
    return coc, alpha


def _round_up(value_px: float) -> float:
    """The next number that reads well [px]."""
    if not value_px > 0:
        return 1.0
    power = 10.0 ** np.floor(np.log10(value_px))
    steps = (1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0)
    return float(next(step * power for step in steps if step * power >= value_px * 0.999))
