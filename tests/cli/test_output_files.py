"""The option table states of every path option whether the file is read or written."""

import argparse
from pathlib import Path

import pytest

from nlens_video.cli.output_files import file_options
from nlens_video.options.commands import COMMANDS, JOBS
from nlens_video.options.parser import parser_of
from nlens_video.options.readers import path, word

NO_PATHS = {
    "camera", "scene", "footprint", "animation", "input_format", "input_rate", "codec", "pix_fmt",
    "effects", "address", "host", "things", "choices", "reference", "input_transfer",
}  # fmt: skip
"""Options that take a word which is no path: names of nodes, codecs, effects, answers."""


def text_options(parser):
    """The options of a parser that take any text, or a path; those of its subcommands not."""
    for action in parser._actions:
        takes_value = action.nargs != 0 and action.choices is None
        if takes_value and action.type in (None, str, Path, path, word):
            yield action.dest


def forms():
    """Each form of a command that has options of its own, and its parser."""
    for command in (*COMMANDS, JOBS):
        parser = parser_of(command)
        below = [a for a in parser._actions if isinstance(a, argparse._SubParsersAction)]
        if below:
            for name, subparser in below[0].choices.items():
                yield f"{command} {name}", subparser
        else:
            yield command, parser


@pytest.mark.parametrize(("form", "parser"), list(forms()), ids=lambda value: str(value)[:20])
def test_every_path_option_states_whether_it_is_read_or_written(form, parser):
    listed = {option.attribute for option, _ in file_options(form)}
    missing = (
        set(text_options(parser)) - listed - NO_PATHS - ({"jobs"} if form == "farm" else set())
    )
    assert not missing, f"{form}: give {sorted(missing)} a column `files`, or list it in NO_PATHS"
