"""A compositor as a notebook shows it: last picture, lens and plan."""

from __future__ import annotations

from dataclasses import dataclass
from html import escape

from nlens_video.core.layers import Picture
from nlens_video.core.lens_fit import LensFit
from nlens_video.report.html import embedded_jpeg, jpeg, to_8_bit

_WIDEST_PX = 640


@dataclass(frozen=True, slots=True)
class Shown:
    """The state of a compositor; a notebook renders it as HTML.

    Attributes:
        picture: the last composite as a JPEG file, None before the first frame.
        size: its width and height [px].
        fit: the lens, None until it is found.
        plan: what runs, a line each.
    """

    picture: bytes | None
    size: tuple[int, int]
    fit: LensFit | None
    plan: tuple[str, ...]

    def _repr_html_(self) -> str:
        """HTML for Jupyter, self-contained."""
        parts = ["<p>no frame yet</p>"]
        if self.picture is not None:
            parts = [embedded_jpeg(self.picture, self.size, "The last composite")]
        if self.fit is not None:
            parts.append(
                f"<p>coc_px = {self.fit.slope:.4g} &middot; disparity {self.fit.intercept:+.4g}, "
                f"sign {escape(self.fit.sign)}</p>"
            )
        lines = "".join(f"<li>{escape(line)}</li>" for line in self.plan)
        return "".join(parts) + (f"<ul>{lines}</ul>" if lines else "")


def show(picture: Picture | None, fit: LensFit | None, plan: tuple[str, ...]) -> Shown:
    """Shrink the last composite; `picture` is None before the first frame."""
    if picture is None:
        return Shown(None, (0, 0), fit, plan)
    image = to_8_bit(picture.srgb(), _WIDEST_PX)
    return Shown(jpeg(image), (image.shape[1], image.shape[0]), fit, plan)
