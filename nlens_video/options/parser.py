"""argparse with one-line errors, near misses of option names and a short help."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from difflib import get_close_matches
from typing import TYPE_CHECKING, Any, NoReturn, TextIO, cast

from nlens_video.core.errors import UsageError
from nlens_video.core.stdio import print_out
from nlens_video.options.readers import word

if TYPE_CHECKING:
    from _typeshed import SupportsWrite


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
        raise UsageError(f"{message}; see {self.prog} --help")

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
            raise UsageError(f"{name} is not an option; {meant} {self.prog} --help")

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
