"""Write the frame graph of `standard` into docs/architecture.md: `python docs/make_graph.py`."""

from __future__ import annotations

import re
from pathlib import Path

from nlens_video.graph.diagram import mermaid
from nlens_video.graph.pipeline_file import load_pipeline

PAGE = Path(__file__).with_name("architecture.md")
_DIAGRAM = re.compile(r"(?<=^```mermaid\n).*?(?=^```$)", re.M | re.S)


def with_diagram(page: str) -> str:
    """The page with today's diagram in its Mermaid block."""
    diagram = mermaid(load_pipeline("standard"))
    return _DIAGRAM.sub(lambda _: diagram, page)


if __name__ == "__main__":
    PAGE.write_text(with_diagram(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
