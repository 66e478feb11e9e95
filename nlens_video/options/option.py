"""A row of the option table, and how argparse takes it."""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from typing import Any

from msgspec import Struct

from nlens_video.options.files import Files


class Option(Struct, frozen=True):
    """An option or a positional argument.

    Attributes:
        names: of an option, today's first, then others that work as well, separated by spaces; of a
            positional the attribute of the parsed arguments.
        commands: those that have it.
        metavar: how the help names the value; an option with neither it nor choices takes
            no value.
        type: reader of the value, see `readers`; None: any text but an empty one.
        help: a line.
        default: the value where it is not given.
        choices: the values that it may have.
        nargs: as argparse has it.
        const: the value of `nargs="?"` where the option is given alone.
        required: whether it must be given.
        repeats: whether it may be given more than once: its value is then a list.
        dest: the attribute of the parsed arguments, where it is not the first name.
        feeds: the setting that it becomes, such as `source.input_rate`; see `to_settings`.
        parameter: whether a `Compositor` takes it.
        often: whether the short help shows it.
        one_of: name of a set of options of which one may be given.
        files: what its value names, if files.
    """

    names: str
    commands: Sequence[str]
    metavar: str | None = None
    type: Callable[[str], Any] | None = None
    help: str = ""
    default: object = None
    choices: tuple[str, ...] | None = None
    nargs: str | None = None
    const: object = None
    required: bool = False
    repeats: bool = False
    dest: str = ""
    feeds: str = ""
    parameter: bool = False
    often: bool = False
    one_of: str = ""
    files: tuple[Files, ...] = ()

    @property
    def flags(self) -> list[str]:
        """Its names with their dashes; none for a positional."""
        return [name for name in self.names.split() if name.startswith("-")]

    @property
    def attribute(self) -> str:
        """The attribute of the parsed arguments."""
        long = next(name for name in self.names.split() if name[:1] != "-" or name[:2] == "--")
        return self.dest or long.lstrip("-").replace("-", "_")

    @property
    def takes_value(self) -> bool:
        """Whether a value follows, or it is a positional."""
        return not self.flags or self.metavar is not None or self.choices is not None

    @property
    def initial(self) -> object:
        """The value where it is not given."""
        return self.default if self.takes_value or self.default is not None else False

    def add_to(self, group: argparse._ActionsContainer) -> None:
        """Declare it to argparse."""
        keywords: dict[str, Any] = {"help": self.help, "default": self.initial}
        if self.takes_value:
            for name in ("metavar", "type", "choices", "nargs", "const"):
                keywords[name] = getattr(self, name)
        else:
            keywords["action"] = "store_true"
        if self.repeats:
            del keywords["nargs"], keywords["const"]
            keywords["action"] = "append"
        if self.flags:
            keywords |= {"dest": self.attribute, "required": self.required}
        group.add_argument(*(self.flags or [self.attribute]), **keywords)
