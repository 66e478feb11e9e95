"""Axes and marks of inline SVG charts; all colours come from the page's style sheet.

Inline SVG follows the reader's light or dark theme, stays sharp at any size and is accessible to
screen readers; a picture of a chart is none of that.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from html import escape
from typing import TypeVar

from msgspec import Struct

from nlens_video.core.layers import Float64

Values = TypeVar("Values", float, Float64)
_CLEAR_PX = 46.0  # between neighbouring labels


class Axes(Struct, frozen=True, kw_only=True):
    """The data's rectangle inside a drawing.

    Attributes:
        width: of the drawing [SVG unit].
        height: of the drawing [SVG unit].
        x: values at its left and right edge.
        y: values at its bottom and top edge.
        margins: left, top, right, bottom, for labels [SVG unit].
    """

    width: float
    height: float
    x: tuple[float, float]
    y: tuple[float, float]
    margins: tuple[float, float, float, float] = (58.0, 22.0, 16.0, 50.0)

    @property
    def left(self) -> float:
        """Left edge of the data's rectangle [SVG unit]."""
        return self.margins[0]

    @property
    def top(self) -> float:
        """Top edge [SVG unit]."""
        return self.margins[1]

    @property
    def right(self) -> float:
        """Right edge [SVG unit]."""
        return self.width - self.margins[2]

    @property
    def bottom(self) -> float:
        """Bottom edge [SVG unit]."""
        return self.height - self.margins[3]

    def place_x(self, values: Values) -> Values:
        """Horizontal position of values [SVG unit]."""
        low, high = self.x
        return self.left + (values - low) / (high - low) * (self.right - self.left)

    def place_y(self, values: Values) -> Values:
        """Vertical position of values [SVG unit]."""
        low, high = self.y
        return self.bottom - (values - low) / (high - low) * (self.bottom - self.top)

    def points(self, x: Float64, y: Float64) -> list[tuple[float, float]]:
        """Positions in the drawing."""
        return list(zip(self.place_x(x).tolist(), self.place_y(y).tolist(), strict=True))

    def frame(self, x_label: str, y_label: str) -> str:
        """Grid lines, tick labels and axis titles."""
        parts = []
        for value in ticks(*self.x):
            x = self.place_x(value)
            parts.append(line((x, self.top), (x, self.bottom), "grid"))
            parts.append(text((x, self.bottom + 18), _number(value), "tick", "middle"))
        for value in ticks(*self.y):
            y = self.place_y(value)
            parts.append(line((self.left, y), (self.right, y), "grid"))
            parts.append(text((self.left - 8, y + 4), _number(value), "tick", "end"))
        middle = 0.5 * (self.left + self.right)
        parts.append(text((middle, self.height - 8), x_label, "title", "middle"))
        height = 0.5 * (self.top + self.bottom)
        parts.append(
            f'<text class="title" text-anchor="middle" transform="translate(14 {height:.1f}) '
            f'rotate(-90)">{escape(y_label)}</text>'
        )
        return "".join(parts)

    def top_labels(self, places: Sequence[tuple[float, str]], title: str) -> str:
        """A second axis above: labels at x values, without those that would collide."""
        parts, last = [], -math.inf
        for value, label in places:
            x = self.place_x(value)
            if self.left <= x <= self.right and abs(x - last) >= _CLEAR_PX:
                parts.append(line((x, self.top - 4), (x, self.top), "mark"))
                parts.append(text((x, self.top - 8), label, "tick", "middle"))
                last = x
        middle = 0.5 * (self.left + self.right)
        parts.append(text((middle, 12), title, "title", "middle"))
        return "".join(parts)

    def drawing(self, title: str, description: str, body: str) -> str:
        """The SVG element, with title and description for screen readers."""
        return (
            f'<svg class="chart" role="img" viewBox="0 0 {self.width:g} {self.height:g}" '
            f'aria-label="{escape(f"{title}. {description}")}">'
            f"<title>{escape(title)}</title><desc>{escape(description)}</desc>{body}</svg>"
        )


def ticks(low: float, high: float, count: int = 6) -> list[float]:
    """About `count` round values in [low, high]."""
    step = nice_step((high - low) / count)
    first = math.ceil(low / step - 1e-9)
    last = math.floor(high / step + 1e-9)
    return [at * step for at in range(first, last + 1)]


def nice_step(least: float) -> float:
    """The next of 1, 2, 2.5, 5 times a power of ten."""
    power = 10.0 ** math.floor(math.log10(max(least, 1e-12)))
    return next(
        step * power for step in (1.0, 2.0, 2.5, 5.0, 10.0) if step * power >= 0.999 * least
    )


def line(start: tuple[float, float], end: tuple[float, float], kind: str) -> str:
    """A straight line of a class of the style sheet."""
    return (
        f'<line class="{kind}" x1="{start[0]:.1f}" y1="{start[1]:.1f}" '
        f'x2="{end[0]:.1f}" y2="{end[1]:.1f}"/>'
    )


def text(place: tuple[float, float], words: str, kind: str, anchor: str) -> str:
    """Words; `anchor` is `start`, `middle` or `end`."""
    return (
        f'<text class="{kind}" x="{place[0]:.1f}" y="{place[1]:.1f}" '
        f'text-anchor="{anchor}">{escape(words)}</text>'
    )


def path(points: Iterable[tuple[float, float]], kind: str, *, closed: bool = False) -> str:
    """A line through points, or the area inside them."""
    steps = "L".join(f"{x:.1f} {y:.1f}" for x, y in points)
    return f'<path class="{kind}" d="M{steps}{"Z" if closed else ""}"/>'


def dots(points: Iterable[tuple[float, float]], kind: str) -> str:
    """Many dots as one path of lines without length and with round ends."""
    steps = "".join(f"M{x:.1f} {y:.1f}h0" for x, y in points)
    return f'<path class="{kind}" d="{steps}"/>' if steps else ""


def _number(value: float) -> str:
    return f"{0.0 if abs(value) < 1e-12 else value:.6g}".replace("-", "\N{MINUS SIGN}")
