"""The page shows every case, and nothing else."""

import re
from importlib import import_module
from pathlib import Path

from hard.catalogue import CASES, PAGE


def every_case():
    for path in sorted(Path(__file__).parent.glob("*/test_hard_*.py")):
        import_module(f"hard.{path.parent.name}.{path.stem}")
    return {(case.theme, case.title, case.picture) for case in CASES}


def test_page_lists_exactly_the_hard_cases_with_their_pictures():
    shown, theme = set(), ""
    for line in PAGE.read_text().splitlines():
        theme = line[3:] if line.startswith("## ") else theme
        if found := re.fullmatch(r"!\[(.*)\]\((.*)\)", line):
            shown.add((theme, *found.groups()))
    assert shown == every_case()
    pictures = {f"hard/{path.name}" for path in (PAGE.parent / "hard").glob("*.png")}
    assert pictures == {picture for _, _, picture in shown}
    assert sum((PAGE.parent / name).stat().st_size for name in pictures) < 2e6


def test_every_hard_case_has_a_docstring_sentence():
    every_case()
    assert all(case.claim.endswith(".") for case in CASES)
