"""CoC and confidence as colours over the picture, the footprint outlined."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from nlens_video.core.layers import Bool, Box, DefocusedLayer, Float32
from nlens_video.report.findings import Findings, Shown
from nlens_video.report.pictures import Image

_WIDEST_PX = 960
_OPACITY = 0.72
_CLOSE_UP_MARGIN = 0.2  # of the object, on each side
COC_MAP, SIGMA_MAP = cv2.COLORMAP_VIRIDIS, cv2.COLORMAP_CIVIDIS  # readable with any colour vision


@dataclass(frozen=True, slots=True, kw_only=True)
class Scale:
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

    def stops(self, count: int = 9) -> list[str]:
        """CSS colours, evenly spread over the scale."""
        ramp = np.linspace(0.0, self.top_px, count, dtype=np.float32)[None]
        return [f"rgb({r} {g} {b})" for r, g, b in self.colors(ramp)[0]]


@dataclass(frozen=True, slots=True, kw_only=True)
class Map:
    """A picture with colours over it, and what they mean."""

    image: Image
    scale: Scale


def coc_scale(findings: Findings) -> Scale:
    """One scale for plate and object, so that equal colours are equal blur."""
    values = []
    if findings.shot.plate_coc is not None:
        values.append(float(np.quantile(findings.shot.plate_coc.coc_px, 0.98)))
    if findings.shown is not None and findings.shown.defocused is not None:
        values.append(findings.shown.defocused.largest_coc_px)
    return Scale(top_px=_round_up(max(values, default=1.0)), colormap=COC_MAP)


def plate_coc_map(findings: Findings, shown: Shown) -> Map | None:
    """The plate's CoC with the footprint outlined; None where it was not estimated."""
    if findings.shot.plate_coc is None:
        return None
    scale = coc_scale(findings)
    image = _overlay(shown.before, findings.shot.plate_coc.coc_px, scale)
    return Map(image=_outlined(image, findings), scale=scale)


def sigma_map(findings: Findings, shown: Shown) -> Map | None:
    """Expected error of the plate's CoC; None where it was not estimated."""
    if findings.shot.plate_coc is None:
        return None
    sigma = findings.shot.plate_coc.sigma_px
    scale = Scale(top_px=_round_up(float(np.quantile(sigma, 0.98))), colormap=SIGMA_MAP)
    return Map(image=_outlined(_overlay(shown.before, sigma, scale), findings), scale=scale)


def object_coc_map(findings: Findings, shown: Shown) -> Map | None:
    """The object's CoC, before it is blurred; None where it was left sharp."""
    if shown.defocused is None:
        return None
    frame = Box(0, 0, findings.info.width, findings.info.height)
    coc, alpha = _on_frame(shown.defocused, frame)
    scale = coc_scale(findings)
    image = _overlay(shown.before, coc, scale, alpha)
    return Map(image=_outlined(image, findings), scale=scale)


def close_up(findings: Findings, shown: Shown) -> Image | None:
    """The composite around the object, in the shape of the frame; None where there is none."""
    if shown.after is None or shown.defocused is None:
        return None
    height, width = shown.after.shape[:2]
    scale = width / findings.info.width
    frame = Box(0, 0, findings.info.width, findings.info.height)
    seen = shown.defocused.layer.box.intersection(frame)
    across = max(seen.width, seen.height * width / height)
    columns = min(width, max(16, round(scale * across * (1 + 2 * _CLOSE_UP_MARGIN))))
    rows = min(height, round(columns * height / width))
    x0 = round(scale * 0.5 * (seen.x0 + seen.x1) - 0.5 * columns)
    y0 = round(scale * 0.5 * (seen.y0 + seen.y1) - 0.5 * rows)
    x0, y0 = min(max(x0, 0), width - columns), min(max(y0, 0), height - rows)
    return shown.after[y0 : y0 + rows, x0 : x0 + columns]


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


def _outlined(image: Image, findings: Findings) -> Image:
    """The footprint's outline, white on black, so that it is seen on any colour."""
    if findings.shot.ground is None or not findings.shot.ground.mask.any():
        return image
    height, width = image.shape[:2]
    mask = _resized_mask(findings.shot.ground.mask, (width, height))
    outlines, _ = cv2.findContours(mask, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_SIMPLE)
    drawn = np.ascontiguousarray(image)
    for color, thickness in (((0, 0, 0), 4), ((255, 255, 255), 2)):
        cv2.drawContours(drawn, outlines, -1, color, thickness, lineType=cv2.LINE_AA)
    return drawn


def _resized_mask(mask: Bool, size: tuple[int, int]) -> Image:
    return np.asarray(
        cv2.resize(mask.astype(np.uint8), size, interpolation=cv2.INTER_NEAREST), np.uint8
    )


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
