"""Completion of the command line by the shell: the words, and the shell's own script."""

from __future__ import annotations

import os
from argparse import ArgumentParser, Namespace
from collections.abc import Iterable

from nlens_video.core.stdio import print_out
from nlens_video.options.commands import COMMANDS
from nlens_video.options.parser import parser_of


def print_completion(args: Namespace) -> int:
    """The command `completion`."""
    from argcomplete.shell_integration import shellcode

    print_out(shellcode(["nlens-video"], shell=args.shell))
    return 0


def complete() -> None:
    """Print the completions of the word under the cursor for the shell, and end the process."""
    import argcomplete
    from argcomplete.completers import FilesCompleter

    line = os.environ.get("COMP_LINE", "")
    typed = line.split()
    named = len(typed) > 2 or (len(typed) == 2 and line.endswith(" "))
    command = typed[1] if named else ""
    if command not in COMMANDS:
        parser: ArgumentParser = parser_of("render")
        first = next(action for action in parser._actions if not action.option_strings)
        files = FilesCompleter()

        def plate_or_command(**about: str) -> Iterable[str]:
            return [*COMMANDS, *files(**about)]

        # argcomplete looks for this attribute, which argparse's actions do not declare
        first.completer = plate_or_command  # type: ignore[attr-defined]
    else:
        parser = ArgumentParser("nlens-video")
        below = parser.add_subparsers()
        below.add_parser(command, parents=[parser_of(command)], add_help=False)
    argcomplete.autocomplete(parser)
