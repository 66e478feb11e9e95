"""HTML building blocks: self-contained pages, sections, figures, tables and JPEG pictures.

Arguments named `html` are not escaped, all others are.
"""

from __future__ import annotations

import base64
import re
from collections.abc import Sequence
from html import escape
from importlib.resources import files
from pathlib import PurePath
from string import Template

import cv2
import numpy as np
import numpy.typing as npt

from nlens_video.core.layers import Float32
from nlens_video.core.version import VERSION

Image = npt.NDArray[np.uint8]
"""Display-coded sRGB (H, W, 3)."""

_WIDEST_PX = 1600
_MARKS = {
    "fit": '<path d="M0 6h22" class="fit"/>',
    "slowest": '<path d="M0 6h22" class="slowest"/>',
    "plane w3": '<path d="M6 6h0M16 6h0" class="plane w3"/>',
    "anchor w3": '<path d="M6 6h0M16 6h0" class="anchor w3"/>',
}


def document(
    command: str, title: str, lead: str, html: str, *, header: str = "", footer: str = ""
) -> str:
    """A page that loads nothing from outside itself.

    Args:
        command: the command that makes it.
        title: of the page.
        lead: first sentences.
        html: the sections.
        header: HTML below the lead.
        footer: words after program and version.
    """
    folder = files("nlens_video.report")
    return Template(folder.joinpath("page.html").read_text(encoding="utf-8")).substitute(
        style=folder.joinpath("page.css").read_text(encoding="utf-8"),
        command=escape(command),
        title=escape(title),
        lead=prose(lead),
        header=header,
        sections=html,
        footer=escape(f"Made by nlens-video {VERSION}. {footer}".strip()),
    )


def section(name: str, title: str, html: str) -> str:
    """A section of the page under its heading."""
    return (
        f'<section aria-labelledby="{name}-title">'
        f'<h2 id="{name}-title">{escape(title)}</h2>{html}</section>'
    )


def prose(words: str) -> str:
    """Words with command-line options as code, in which no line breaks."""
    return re.sub(r"(?<![\w-])--[a-z][a-z-]*", r"<code>\g<0></code>", escape(words))


def missing(reason: str) -> str:
    """Placeholder of a section that could not be made."""
    return f'<p class="missing">{prose(reason)}</p>'


def to_8_bit(rgb: Float32, widest_px: int = _WIDEST_PX) -> Image:
    """An sRGB picture (H, W, 3) in [0, 1] as 8 bit, reduced to at most `widest_px` columns."""
    height, width = rgb.shape[:2]
    if width > widest_px:
        size = (widest_px, max(1, round(height * widest_px / width)))
        rgb = np.asarray(cv2.resize(rgb, size, interpolation=cv2.INTER_AREA), np.float32)
    return np.asarray(np.round(np.clip(rgb, 0.0, 1.0) * 255.0), np.uint8)


def jpeg(image: Image, quality: int = 90) -> bytes:
    """The picture as a JPEG file."""
    flags = [cv2.IMWRITE_JPEG_QUALITY, quality, cv2.IMWRITE_JPEG_OPTIMIZE, 1]
    done, data = cv2.imencode(".jpg", image[..., ::-1], flags)
    if not done:
        raise ValueError(f"{image.shape = } cannot be written as a JPEG")
    return data.tobytes()


def picture(image: Image, alt: str, quality: int = 90) -> str:
    """An embedded picture."""
    return embedded_jpeg(jpeg(image, quality), (image.shape[1], image.shape[0]), alt)


def embedded_jpeg(data: bytes, size: tuple[int, int], alt: str) -> str:
    """A JPEG file as a data URI; `size` (width, height) reserves its place [px]."""
    source = "data:image/jpeg;base64," + base64.b64encode(data).decode("ascii")
    return f'<img width="{size[0]}" height="{size[1]}" alt="{escape(alt)}" src="{source}">'


def figure(html: str, caption: str, title: str = "") -> str:
    """A figure with a caption below and, where given, a heading above."""
    head = f"<h3>{escape(title)}</h3>" if title else ""
    foot = f"<figcaption>{escape(caption)}</figcaption>" if caption else ""
    return f"<figure>{head}{html}{foot}</figure>"


def scrolled(html: str, label: str) -> str:
    """A wide chart, which scrolls sideways on a narrow screen."""
    return (
        f'<div class="scroll" tabindex="0" role="region" aria-label="{escape(label)}">{html}</div>'
    )


def key(entries: Sequence[tuple[str, str]]) -> str:
    """The key of a chart: class of the style sheet and name of each mark."""
    items = "".join(
        '<li><svg viewBox="0 0 22 12" aria-hidden="true">'
        + _MARKS.get(kind, f'<rect width="22" height="12" class="{kind}"/>')
        + f"</svg>{escape(name)}</li>"
        for kind, name in entries
    )
    return f'<ul class="key">{items}</ul>'


def table(
    caption: str, head: Sequence[str], rows: Sequence[Sequence[str]], *, number_column: int = -1,
    stacked: bool = False,
) -> str:  # fmt: skip
    """A table whose first cells name the rows.

    Args:
        caption: what it shows.
        head: names of the columns.
        rows: the cells, as words.
        number_column: the column of numbers, which is aligned to the right.
        stacked: whether cells stand below each other on a narrow screen, since they hold sentences.
    """
    classes = [' class="number"' if at == number_column else "" for at in range(len(rows[0]))]
    top = "".join(
        f'<th scope="col"{kind}>{escape(name)}</th>'
        for kind, name in zip(classes, head, strict=False)
    )
    lines = []
    for name, *cells in rows:
        line = "".join(
            f"<td{kind}>{prose(cell)}</td>" for kind, cell in zip(classes[1:], cells, strict=True)
        )
        lines.append(f'<tr><th scope="row">{escape(name)}</th>{line}</tr>')
    kind = ' class="stacked"' if stacked else ""
    return (
        f"<table{kind}><caption>{escape(caption)}</caption>"
        f"{f'<thead><tr>{top}</tr></thead>' if head else ''}<tbody>{''.join(lines)}</tbody></table>"
    )


def count(number: int, noun: str) -> str:
    """A number of things, in words."""
    return f"{number:,} {noun}{'' if number == 1 else 's'}"


def file_name(spec: str) -> str:
    """Last part of a path; addresses and `-` as they are."""
    return spec if "://" in spec or spec == "-" else PurePath(spec).name or spec
