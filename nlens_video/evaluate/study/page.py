"""The study as one web page that needs nothing but itself."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict
from html import escape
from importlib.resources import files
from pathlib import Path
from string import Template

from nlens_video.evaluate.study.stimuli import Stimulus, picture_address

QUESTION = "Do you believe there are virtual {things} in the image?"


def study_page(
    folder: Path, stimuli: Sequence[Stimulus], choices: Sequence[str], things: str
) -> str:
    """The page as text; everything that came from outside is escaped.

    Args:
        folder: of the pictures.
        stimuli: what is shown, each once, in an order of each participant's own.
        choices: answers beside "No".
        things: what is looked for, in the plural.

    Raises:
        InputError: a picture cannot be read.
    """
    home = files("nlens_video.evaluate.study")
    template = Template(home.joinpath("page.html").read_text(encoding="utf-8"))
    trials = [asdict(one) | {"src": picture_address(folder, one)} for one in stimuli]
    boxes = "".join(
        f'<label><input type="checkbox" name="choice" value="{escape(choice)}"> '
        f"<kbd>{number}</kbd> {escape(choice)}</label>"
        for number, choice in enumerate(choices, 1)
    )
    return template.substitute(
        style=home.joinpath("page.css").read_text(encoding="utf-8"),
        script=home.joinpath("page.js").read_text(encoding="utf-8"),
        question=escape(QUESTION.format(things=things)),
        things=escape(things),
        count=len(trials),
        choices=boxes,
        trials=json.dumps(trials).replace("<", "\\u003c"),
    )
