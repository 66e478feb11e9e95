"""Completion of the command line by the shell's Tab key."""

from __future__ import annotations

import argparse
import os
from collections.abc import Iterable

from nlens_video.options import options

ASKED = "_ARGCOMPLETE"
"""Variable of the environment by which the shell asks."""


def answer() -> None:
    """Tell the shell what the word under the cursor can become, and end the process."""
    import argcomplete
    from argcomplete.completers import FilesCompleter

    line = os.environ.get("COMP_LINE", "")
    words = line.split()
    complete = len(words) > 2 or (len(words) == 2 and line.endswith(" "))
    command = words[1] if complete else ""
    if command not in options.COMMANDS:
        parser: argparse.ArgumentParser = options.parser_of("render")
        first = next(action for action in parser._actions if not action.option_strings)
        files = FilesCompleter()

        def plate_or_command(**about: str) -> Iterable[str]:
            return [*options.COMMANDS, *files(**about)]

        # argcomplete looks for this attribute, which argparse's actions do not declare
        first.completer = plate_or_command  # type: ignore[attr-defined]
    else:
        parser = argparse.ArgumentParser("nlens-video")
        below = parser.add_subparsers()
        below.add_parser(command, parents=[options.parser_of(command)], add_help=False)
    argcomplete.autocomplete(parser)


def script(shell: str) -> str:
    """What the shell must run for that.

    Args:
        shell: `bash`, `zsh` or `fish`.
    """
    from argcomplete.shell_integration import shellcode

    return shellcode(["nlens-video"], shell=shell)
