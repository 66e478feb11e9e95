"""docs/carried.md: one column of its table is checked against real runs."""

import sys

import pytest
from support.folders import ROOT

DOCS = ROOT / "docs"


@pytest.mark.needs_programs("ffmpeg", "ffprobe")
def test_streams_page_states_what_happens_to_streams_written_to_mp4(monkeypatch):
    monkeypatch.syspath_prepend(str(DOCS))
    make_carried = __import__("make_carried")
    page = (DOCS / "carried.md").read_text()
    table = [line.strip("| ").split(" | ") for line in page.splitlines() if line.startswith("|")]
    column = table[0].index("`.mp4`")
    tried = [line.strip("| ").split(" | ") for line in make_carried.lines(["mp4"])]
    assert [(row[0], row[column]) for row in table[2:]] == [tuple(row) for row in tried[2:]]
    sys.modules.pop("make_carried")
