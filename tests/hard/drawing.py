"""What the page shows of a case: pictures side by side, or a plot."""

from __future__ import annotations

import io
from collections.abc import Callable, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from PIL import Image, ImageDraw, ImageFont

if TYPE_CHECKING:
    from matplotlib.axes import Axes

GAP, TITLE, HEIGHT = 8, 20, 180
INK, OURS, OTHER, PALE = "#222222", "#0072b2", "#d55e00", "#9aa5ad"


def srgb8(linear):
    """Scene-linear light to 8-bit sRGB."""
    light = np.clip(np.nan_to_num(linear), 0.0, 1.0)
    coded = np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)
    return np.round(255.0 * coded).astype(np.uint8)


def over_grey(rgba, grey: float = 0.18):
    """A premultiplied layer over a checkerboard, for display (h, w, 3) uint8."""
    rows, columns = rgba.shape[:2]
    squares = np.add.outer(np.arange(rows) // 8, np.arange(columns) // 8) % 2
    plate = (grey + 0.08 * squares)[..., None]
    return srgb8(rgba[..., :3] + (1.0 - rgba[..., 3:]) * plate)


def haze(rgba):
    """Coverage of a thin layer, its greatest as full colour (h, w, 3) uint8."""
    return heat(rgba[..., 3], max(float(rgba[..., 3].max()), 1e-30))


def heat(values, largest: float):
    """A map as shades, blue below zero, red above; `largest` is full colour (h, w, 3) uint8."""
    share = np.clip(np.nan_to_num(values) / largest, -1.0, 1.0)[..., None]
    low, high = np.array([0, 114, 178.0]), np.array([213, 94, 0.0])
    shade = np.where(share < 0, low, high)
    return np.round(255 + (shade - 255) * np.abs(share)).astype(np.uint8)


def panels(pictures: Mapping[str, object], height: int = HEIGHT) -> Image.Image:
    """Pictures (h, w, 3) uint8 side by side, each under its title, all of one height."""
    shown = []
    for title, values in pictures.items():
        picture = Image.fromarray(np.ascontiguousarray(values))
        width = max(1, round(picture.width * height / picture.height))
        enlarged = height >= 2 * picture.height
        how = Image.Resampling.NEAREST if enlarged else Image.Resampling.LANCZOS
        shown.append((title, picture.resize((width, height), how)))
    font = ImageFont.load_default(13)
    widths = [max(one.width, round(font.getlength(title)) + 4) for title, one in shown]
    sheet = Image.new("RGB", (sum(widths) + GAP * (len(shown) - 1), height + TITLE), "white")
    draw, left = ImageDraw.Draw(sheet), 0
    for width, (title, one) in zip(widths, shown, strict=True):
        draw.text((left, 2), title, font=font, fill=INK)
        sheet.paste(one, (left, TITLE))
        draw.rectangle((left, TITLE, left + one.width - 1, TITLE + one.height - 1), outline=PALE)
        left += width + GAP
    return sheet


def plot(
    draw: Callable[[Axes], None], *, x: str, y: str, log: Sequence[str] = (), legend: bool = True
) -> Image.Image:
    """A plot; `draw` puts lines on its axes."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(6.4, 2.7), dpi=100, layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots()
    draw(axes)
    axes.set(xlabel=x, ylabel=y, **{f"{axis}scale": "log" for axis in log})
    axes.spines[["top", "right"]].set_visible(False)
    if legend:
        axes.legend(frameon=False, fontsize=8)
    file = io.BytesIO()
    figure.savefig(file, format="png")
    return Image.open(file).convert("RGB")


def bars(figures: Mapping[str, float], limits: Mapping[str, float], *, x: str) -> Image.Image:
    """A figure beside its limit for each name, on a logarithmic scale."""
    names = list(figures)
    least = 1e-3 * min(limits.values())

    def draw(axes: Axes) -> None:
        places = np.arange(len(names))[::-1]
        values = [max(figures[name], least) for name in names]
        axes.barh(places, values, color=OURS, height=0.6, label="measured")
        axes.plot([limits[n] for n in names], places, "|", color=OTHER, ms=12, mew=2, label="limit")
        axes.set_yticks(places, names, fontsize=8)

    return plot(draw, x=x, y="", log=("x",))
