"""Make docs/hard.md and its pictures: every case of tests/hard, run, with its figures.

python docs/make_hard.py [THEME ...]   only these themes are run anew
"""

from __future__ import annotations

import sys
from importlib import import_module
from pathlib import Path

import numpy as np
from hypothesis import settings
from PIL import Image

ROOT = Path(__file__).parents[1]
sys.path.insert(0, str(ROOT / "tests"))

from hard.catalogue import CASES, PAGE, Case, Outcome  # noqa: E402  found by the line above

THEMES = {
    "coc": "Circles of confusion",
    "disparity": "Depths",
    "scale": "Scene units",
    "footprint": "Footprints",
    "plate": "Plates",
    "alpha": "Coverage",
    "fit": "The fit",
    "size": "Sizes of frames",
    "properties": "Properties",
    "precision": "Float32 against float64",
    "determinism": "The same bits",
    "networks": "The networks",
    "endurance": "Long streams",
}
INTRODUCTION = """\
# Hard cases

Extreme lenses, scenes and plates, and their results. `make hard` runs every case of `tests/hard`
and writes this page. The same functions are tests of the suite, and another test checks
that this page lists exactly these cases. Light is scene-linear, a CoC a signed
diameter in pixels, positive nearer than the focus. `draft`, `realtime`, `standard` and `lens` (the
preset `reference`) are the quality levels.

`make hard` does not run the long streams again: `python tests/hard/endurance/stream.py 100000
docs/hard/endurance.json` runs and records them, in a quarter of an hour of processor time.
"""


def section(entry: Case, outcome: Outcome) -> str:
    """A case's part of the page."""
    rows = [f"| {one.what} | {one.measured} | {one.bound} |" for one in outcome.figures]
    return "\n".join(
        [f"### {entry.title}", "", entry.claim, "", f"![{entry.title}]({entry.picture})", ""]
        + ["| figure | measured | must be |", "| --- | --- | --- |", *rows, ""]
    )


def draw(outcome: Outcome, path: Path) -> None:
    """A picture of few colours, which is small."""
    path.parent.mkdir(exist_ok=True)
    picture = outcome.draw().convert("RGB")
    few = picture.quantize(200, method=Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE)
    few.save(path, optimize=True)


def run(themes: list[str]) -> dict[str, dict[str, str]]:
    """Run the cases of some themes, and draw them; their sections by theme and name."""
    made: dict[str, dict[str, str]] = {theme: {} for theme in themes}
    for theme in themes:
        import_module(f"hard.{theme}.test_hard_{theme}")
    for entry in CASES:
        outcome = entry.run()
        for figure in outcome.figures:
            if not figure.kept:
                print(f"{entry.theme}/{entry.name}: {figure}", file=sys.stderr)
        draw(outcome, PAGE.parent / entry.picture)
        made[entry.theme][entry.title] = section(entry, outcome)
    return made


def kept(theme: str) -> list[str]:
    """A theme's part of the page as it stands."""
    text = PAGE.read_text() if PAGE.exists() else ""
    parts = [part for part in text.split("\n## ")[1:] if part.splitlines()[0] == theme]
    return ["\n## " + parts[0].rstrip()] if parts else []


def main() -> None:
    """Write the page, and the pictures of the themes that are named, else of all."""
    settings.register_profile("page", derandomize=True, database=None)
    settings.load_profile("page")
    asked = sys.argv[1:] or list(THEMES)
    with np.errstate(all="ignore"):
        made = run(asked)
    parts = [INTRODUCTION.rstrip()]
    for theme, title in THEMES.items():
        if theme in made:
            sections = "\n".join(made[theme].values())
            parts.append(f"\n## {theme}\n\n{title}.\n\n{sections}".rstrip())
        else:
            parts += kept(theme)
    PAGE.write_text("\n".join(parts) + "\n")
    wanted = {PAGE.parent / entry.picture for entry in CASES}
    for picture in (PAGE.parent / "hard").glob("*.png"):
        if picture.name.split("_")[0] in asked and picture not in wanted:
            picture.unlink()


if __name__ == "__main__":
    main()
