"""The table of what commands read and write knows every option that may name a file."""

import argparse
from pathlib import Path

import pytest

from nlens_video.cli.command_paths import PATH_WORDS
from nlens_video.options import options as arguments
from nlens_video.options.farm_options import jobs_parser
from nlens_video.options.parser import path, word

NO_PATHS = {
    "camera", "scene", "footprint", "animation", "input_format", "input_rate", "codec", "pix_fmt",
    "effects", "address", "things", "choices", "reference", "input_transfer",
}  # fmt: skip
"""Options that take a word which is no path: names of nodes, codecs, effects, answers."""


def options(parser):
    """The options of a parser that take any text, or a path; those of its subcommands not."""
    for action in parser._actions:
        takes_value = action.nargs != 0 and action.choices is None
        if takes_value and action.type in (None, str, Path, path, word):
            yield action.dest


def forms():
    """Each form of a command with the rows of the table that hold for it, and its parser."""
    for command in arguments.COMMANDS:
        parser = arguments.parser_of(command)
        below = [a for a in parser._actions if isinstance(a, argparse._SubParsersAction)]
        if below:
            for name, subparser in below[0].choices.items():
                yield f"{command} {name}", subparser
        else:
            yield command, parser
    yield "farm --jobs", jobs_parser()


@pytest.mark.parametrize(("form", "parser"), list(forms()), ids=lambda value: str(value)[:20])
def test_every_option_that_may_name_a_file_is_in_the_table(form, parser):
    listed = {word.dest for word in PATH_WORDS[form]}
    given = set(options(parser))
    missing = given - listed - NO_PATHS - ({"jobs"} if form == "farm" else set())
    assert not missing, (
        f"{form}: list {sorted(missing)} in command_paths.PATH_WORDS, or in NO_PATHS"
    )


@pytest.mark.parametrize(("form", "parser"), list(forms()), ids=lambda value: str(value)[:20])
def test_the_table_lists_no_option_that_is_gone(form, parser):
    known = {action.dest for action in parser._actions}
    assert {word.dest for word in PATH_WORDS[form]} <= known
