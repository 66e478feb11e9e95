"""Pieces of HTML that the page is made of; arguments named `html` are not escaped, words are."""

from __future__ import annotations

import re
from collections.abc import Sequence
from html import escape

from nlens_video.report.pictures import Image, data_uri, jpeg

_MARKS = {
    "fit": '<path d="M0 6h22" class="fit"/>',
    "slowest": '<path d="M0 6h22" class="slowest"/>',
    "plane w3": '<path d="M6 6h0M16 6h0" class="plane w3"/>',
    "anchor w3": '<path d="M6 6h0M16 6h0" class="anchor w3"/>',
}


def section(name: str, title: str, html: str) -> str:
    """A part of the page under its heading."""
    return (
        f'<section aria-labelledby="{name}-title">'
        f'<h2 id="{name}-title">{escape(title)}</h2>{html}</section>'
    )


def prose(words: str) -> str:
    """Words with the program's options set off, so that no line breaks inside one."""
    return re.sub(r"(?<![\w-])--[a-z][a-z-]*", r"<code>\g<0></code>", escape(words))


def missing(reason: str) -> str:
    """What stands where a part of the page could not be made."""
    return f'<p class="missing">{prose(reason)}</p>'


def image(picture: Image, alt: str, quality: int = 90) -> str:
    """A picture that travels in the page's own text."""
    return jpeg_image(jpeg(picture, quality), (picture.shape[1], picture.shape[0]), alt)


def jpeg_image(data: bytes, size: tuple[int, int], alt: str) -> str:
    """A JPEG file in the page's own text; `size` (width, height) reserves its place [px]."""
    return f'<img width="{size[0]}" height="{size[1]}" alt="{escape(alt)}" src="{data_uri(data)}">'


def figure(html: str, caption: str, title: str = "") -> str:
    """A figure with words below and, where given, a heading above."""
    head = f"<h3>{escape(title)}</h3>" if title else ""
    foot = f"<figcaption>{escape(caption)}</figcaption>" if caption else ""
    return f"<figure>{head}{html}{foot}</figure>"


def key(entries: Sequence[tuple[str, str]]) -> str:
    """The key of a chart: class of the style sheet and name of each mark."""
    items = "".join(
        f'<li><svg viewBox="0 0 22 12" aria-hidden="true">{_mark(kind)}</svg>{escape(name)}</li>'
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


def _mark(kind: str) -> str:
    return _MARKS.get(kind, f'<rect width="22" height="12" class="{kind}"/>')
