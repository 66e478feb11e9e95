"""The commands' parsers, made from the option table. Imports nothing heavy: `--help` is quick."""

from __future__ import annotations

import argparse
import re
import sys
from collections.abc import Sequence
from difflib import get_close_matches
from itertools import takewhile
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn, TextIO, cast

from nlens_video.core.errors import UsageError
from nlens_video.core.stdio import print_out
from nlens_video.core.version import VERSION
from nlens_video.options.commands import ANALYSE, COMMANDS, JOBS, MAKE, SHOT
from nlens_video.options.readers import word
from nlens_video.options.shot_file import is_shot_file, sets, words_of
from nlens_video.options.table import OPTIONS, ROWS
from nlens_video.video.named_files import exists

if TYPE_CHECKING:
    from _typeshed import SupportsWrite


_PROGRAM = """\
Put a rendered, animated object into real footage as if the same lens had filmed it.

  nlens-video IN ANIM.glb OUT         composite; short for `nlens-video render`; or SHOT.toml [OUT]
  nlens-video fit IN ANIM.glb FIT     fit the lens only, and save it as JSON
  nlens-video farm IN ANIM.glb OUT    the same, on many processes or machines
  nlens-video merge OUT CHUNK... --plate IN   join the chunks of --chunk-out
  nlens-video solve IN CAMERA.json    solve the plate's camera, for --camera-from
  nlens-video place IN ANIM.glb OUT.png   draw possible placements of an object
  nlens-video studio IN ANIM.glb      edit a shot in the browser
  nlens-video check OUT --plate IN    compare a result with its plate; exit code 1: faults found
  nlens-video graph PRESET            print the frame graph (Mermaid, Graphviz)
  nlens-video evaluate WHAT FOLDER    measure against ground truth
  nlens-video bench [FOLDER]          accuracy and time of each preset
  nlens-video study make|analyse      make and analyse the paper's user study
  nlens-video doctor                  check what works on this machine, and what to install
  nlens-video completion bash|zsh|fish    print the shell completion
"""

_ABOUTS = {
    "render": _PROGRAM,
    "fit": "Fit the lens of a plate and save it as JSON.",
    "farm": "Composite in chunks on a Ray cluster, by default one on this machine.",
    JOBS: "Composite many shots on a Ray cluster.",
    "merge": "Join the chunks of a run: check their times, encode once, copy the rest from IN.",
    "place": "Draw possible values of --at, --size and --yaw, around those given, on the first "
    "frame: on\nthe ground of the solved camera, or of --horizon.",
    "studio": "Place and light an object on a plate in the browser, and save that as a shot file.",
    "solve": "Solve the plate's camera: field of view, horizon and path, each measured, from "
    "metadata or\nassumed, with its standard error.",
    "check": "Compare a result with its plate: frames, times, plate pixels, jumps, flicker, "
    "audio.\nExit code 0: no faults; 1: faults found; 2 to 6: errors, as in every command.",
    "graph": "Print the frame graph of a preset, or of a pipeline file, as a Mermaid flowchart.",
    "evaluate": "Measure accuracy against rendered ground truth, a folder for each plate.",
    "bench": "Measure accuracy and time of every preset and of other methods, against the "
    "sampled lens.",
    "study": "Make the web page of the paper's user study, and analyse its answers.",
    "doctor": "Check what works on this machine, and what to install.",
    "completion": 'Print the shell completion; use it by: eval "$(nlens-video completion bash)"',
}
_GENERAL = frozenset({"-v", "--verbose", "-q", "--quiet", "--json", "-y", "--overwrite"})
"""Options without a value that may stand before a command."""
_STUDY = {
    MAKE: "make one web page from pictures and their stimuli.csv",
    ANALYSE: "print failure rates and z-tests of saved answers",
}


class HelpFormatter(argparse.RawDescriptionHelpFormatter):
    """Descriptions keep their lines; the value of an option with several names stands once."""

    def _format_action_invocation(self, action: argparse.Action) -> str:
        text = super()._format_action_invocation(action)
        if len(action.option_strings) < 2 or action.nargs == 0:
            return text
        value = text.rpartition(action.option_strings[-1])[2]
        return ", ".join(action.option_strings) + value


class Parser(argparse.ArgumentParser):
    """Raises a `UsageError` of one line where argparse prints its usage and exits.

    Attributes:
        often: options that the short help shows; empty: the help shows all.
        whole: the command whose help shows all.
    """

    often: frozenset[str] = frozenset()
    whole: str = ""

    def __init__(self, *words: Any, **named: Any) -> None:  # noqa: ANN401  argparse's own
        super().__init__(*words, **named)
        self.register("type", None, word)

    def error(self, message: str) -> NoReturn:
        """Raise a UsageError."""
        raise UsageError(f"{message}; see {self.whole or self.prog} --help")

    def parse_known_args(  # type: ignore[override]  # argparse declares it by overloads
        self,
        args: Sequence[str] | None = None,
        namespace: Any = None,  # noqa: ANN401  as argparse declares it
    ) -> tuple[Any, list[str]]:
        """Report unknown options, with the nearest one that exists, before any other error."""
        words = list(sys.argv[1:] if args is None else args)
        if self._subparsers is None:
            self._check_options(words)
        return super().parse_known_args(self._joined(words), namespace)

    def _check_options(self, words: list[str]) -> None:
        for given in words:
            if given == "--":
                return
            name = given.partition("=")[0]
            if not name.startswith("--") or any(k.startswith(name) for k in self._names()):
                continue
            near = get_close_matches(name, self._names(), n=1, cutoff=0.7)
            meant = f"did you mean {near[0]}? See" if near else "see"
            raise UsageError(f"{name} is not an option; {meant} {self.whole or self.prog} --help")

    def _get_option_tuples(
        self, option_string: str
    ) -> list[tuple[argparse.Action, str, str | None]]:
        """The options that a name may abbreviate; two names of one option are no ambiguity."""
        found = super()._get_option_tuples(option_string)
        return list({id(match[0]): match for match in found}.values())

    def _names(self) -> list[str]:
        return [name for name in self._option_string_actions if name.startswith("--")]

    def _joined(self, words: list[str]) -> list[str]:
        """Join a value that begins with a minus to its option: `--at=-0.1,0.5`.

        argparse takes such a value for an option unless it is a plain number.
        """
        joined: list[str] = []
        for at, given in enumerate(words):
            before = words[at - 1] if at else ""
            action = self._option_string_actions.get(before)
            value = given.startswith("-") and not given.startswith("--") and given != "-"
            if (
                action is not None and action.nargs is None and before.startswith("--")
                and value and given not in self._option_string_actions
                and "--" not in words[:at]
            ):  # fmt: skip
                joined[-1] = f"{before}={given}"
            else:
                joined.append(given)
        return joined

    def _print_message(self, message: str, file: SupportsWrite[str] | None = None) -> None:
        """Print help or version; a closed pipe is no error (early 3.11 versions raise)."""
        print_out(message, cast("TextIO | None", file))

    def format_help(self) -> str:
        """All options, or the short help."""
        if not self.often:
            return super().format_help()
        formatter = HelpFormatter(self.prog)
        formatter.add_text(self.description)
        formatter.start_section("often used")
        formatter.add_arguments(
            action for action in self._actions if self.often & set(action.option_strings)
        )
        formatter.end_section()
        formatter.add_text(f"All options: {self.whole} --help")
        return formatter.format_help()


def parse(argv: list[str]) -> argparse.Namespace:
    """Parse a command line.

    Returns:
        Its values; `command`, one of COMMANDS; `shot_file`, the file that it was read from, if any;
        `part_of_shot`, whether the words after it choose frames but no other result than its own;
        with `--save-shot` also `given`, the words as texts.

    Raises:
        UsageError: unknown or malformed arguments.
    """
    argv = _command_first(argv)
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
    shot_file, part = None, False
    if command in SHOT and argv and is_shot_file(argv[0]):
        shot_file, words = Path(argv[0]), argv[1:]
        files = _files(parser, words)
        argv = _with_shot_file(shot_file, words, files, command)
        part = not files and sets("range", words)
    namespace = parser.parse_args(argv)
    namespace.command, namespace.shot_file, namespace.part_of_shot = command, shot_file, part
    if getattr(namespace, "save_shot", None) is not None:
        namespace.given = _given(parser, argv)
    return namespace


def _command_first(argv: list[str]) -> list[str]:
    """A command line with the general options before its command, if any, at its end."""
    before = list(takewhile(_GENERAL.__contains__, argv))
    after = argv[len(before) :]
    return [*after, *before] if after and after[0] in COMMANDS else argv


def _files(parser: Parser, words: list[str]) -> list[str]:
    """Those of the words after a shot file that are neither options nor values of options."""
    _, beyond = parser.parse_known_args(["IN", "GLB", "OUT", *words])
    return [word for word in beyond if word == "-" or not word.startswith("-")]


def _with_shot_file(path: Path, words: list[str], files: list[str], command: str) -> list[str]:
    """The command line that a shot file and the words after it, among them files, make."""
    alone = words_of(path, files[:1], command, own_output=not files)
    try:
        parser_of(command).parse_args(alone)
    except UsageError as error:
        raise UsageError(f"{path}: {error}") from error
    return words_of(path, words, command, own_output=not files)


def _given(parser: Parser, argv: list[str]) -> argparse.Namespace:
    """What a command line gives, as texts or lists of them; True for an option without a value."""
    for action in parser._actions:
        action.default = argparse.SUPPRESS
        action.type = str
    given = vars(parser.parse_args(argv))
    return argparse.Namespace(
        **{name: one if isinstance(one, str | list) else True for name, one in given.items()}
    )


def _check_command(argv: list[str]) -> None:
    """Refuse a first word that looks like a command's name, and is neither one nor a file."""
    word = argv[0] if argv else ""
    if (
        not re.fullmatch("[a-z][a-z-]*", word)
        or any(one.startswith("--input-f") for one in argv)
        or exists(Path(word))
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
