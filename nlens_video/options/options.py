"""The commands' parsers, made from the option table. Imports nothing heavy: `--help` is quick."""

from __future__ import annotations

import argparse
import re
from difflib import get_close_matches
from pathlib import Path

from nlens_video.core.errors import UsageError
from nlens_video.core.version import VERSION
from nlens_video.options.parser import HelpFormatter, Parser
from nlens_video.options.table import ANALYSE, COMMANDS, JOBS, MAKE, OPTIONS, ROWS

_PROGRAM = """\
Put a rendered, animated object into real footage as if the same lens had filmed it.

  nlens-video IN ANIM.glb OUT         composite; short for `nlens-video render`
  nlens-video fit IN ANIM.glb FIT     find the lens only, and keep it as JSON
  nlens-video farm IN ANIM.glb OUT    the same, by many processes or machines
  nlens-video merge OUT CHUNK... --plate IN   join what --chunk-out has rendered
  nlens-video place IN ANIM.glb OUT.png   where an object without a camera could stand
  nlens-video check OUT --plate IN    is a result steady, its plate untouched; 1 where it is not
  nlens-video graph PRESET            the frame graph as a diagram (Mermaid, Graphviz)
  nlens-video evaluate coc|composite|scene|sequences FOLDER   against rendered ground truth
  nlens-video bench [FOLDER]          what accuracy costs in time, preset by preset
  nlens-video study make|analyse      the paper's user study: its page, and its answers
  nlens-video doctor                  what works on this machine, and what to install
  nlens-video completion bash|zsh|fish    completion of the command line by the Tab key
"""

_ABOUTS = {
    "render": _PROGRAM,
    "fit": "Find the lens of a plate and keep it as JSON.",
    "farm": "Composite in chunks on a Ray cluster, by default one on this machine.",
    JOBS: "Composite many shots on a Ray cluster.",
    "merge": "Join the chunks of a run: times checked, encoded once, the rest as in IN.",
    "place": "Draw choices of --at, --size, --yaw, --horizon, around those given, on the first "
    "frame.",
    "check": "Compare a result with its plate: frames, times, plate pixels, jumps, flicker, "
    "audio.\nExit code 0: fine; 1: something was found; 2 to 6 are errors, as everywhere.",
    "graph": "Print the frame graph of a preset, or of a pipeline file, as a Mermaid flowchart.",
    "evaluate": "Measure stages on plates with known lens: rendered ground truth, a folder a "
    "plate.",
    "bench": "Measure every preset, and other methods, against the sampled lens: what it costs.",
    "study": "The paper's user study: a web page that asks, and what its answers say.",
    "doctor": "What works on this machine, and what to install.",
    "completion": 'The shell\'s completion of nlens-video: eval "$(nlens-video completion bash)"',
}
_STUDY = {
    MAKE: "pictures and their stimuli.csv to one web page",
    ANALYSE: "failure rates and z-tests of saved answers",
}


def parse(argv: list[str]) -> argparse.Namespace:
    """Parse a command line; `command` of the result is one of COMMANDS.

    Raises:
        UsageError: unknown or malformed arguments.
    """
    named = bool(argv) and argv[0] in COMMANDS
    command = "render"
    if named:
        command, argv = argv[0], argv[1:]
    else:
        _check_command(argv)
    many = command == "farm" and any(word.partition("=")[0] == "--jobs" for word in argv)
    parser = parser_of(JOBS if many else command)
    if command == "render" and not named:
        parser.often = frozenset(
            name for option in ROWS if option.often for name in option.flags
        ) | {"--version"}
        parser.whole = "nlens-video render"
    namespace = parser.parse_args(argv)
    namespace.command = command
    return namespace


def _check_command(argv: list[str]) -> None:
    """Refuse a first word that looks like a command's name, and is neither one nor a file."""
    word = argv[0] if argv else ""
    if (
        not re.fullmatch("[a-z][a-z-]*", word)
        or any(one.startswith("--input-f") for one in argv)
        or Path(word).exists()
    ):
        return
    near = get_close_matches(word, COMMANDS, n=1)
    if not near and len(argv) > 1:
        return
    meant = f"did you mean {near[0]}? See" if near else f"commands are {', '.join(COMMANDS)}; see"
    raise UsageError(f"{word!r} is neither a command nor a file; {meant} nlens-video --help")


def parser_of(command: str) -> Parser:
    """The parser of one of COMMANDS, or of `farm --jobs`."""
    prog = "nlens-video" if command == "render" else f"nlens-video {command}"
    parser = Parser(prog=prog, description=_ABOUTS[command], formatter_class=HelpFormatter)
    parser.add_argument("--version", action="version", version=f"nlens-video {VERSION}")
    _add_options(parser, command)
    if command == "study":
        kinds = parser.add_subparsers(dest="what", required=True, metavar="make|analyse")
        for form, about in _STUDY.items():
            _add_options(kinds.add_parser(form.split()[1], help=about), form)
    return parser


def _add_options(parser: argparse.ArgumentParser, command: str) -> None:
    """Declare a command's rows of the table, in the table's groups."""
    exclusive: dict[str, argparse._MutuallyExclusiveGroup] = {}
    for title, rows in OPTIONS.items():
        own = [option for option in rows if command in option.commands]
        group = parser.add_argument_group(title) if title and own else parser
        for option in own:
            if option.one_of and option.one_of not in exclusive:
                exclusive[option.one_of] = group.add_mutually_exclusive_group()
            option.add_to(exclusive.get(option.one_of, group))
