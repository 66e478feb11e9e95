"""The grammar of `--effects`: a base, and effects added to it or taken from it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from typing import Literal, cast, get_args

from nlens_video.core.errors import UsageError

Base = Literal["auto", "all", "none"]


@dataclass(frozen=True, slots=True, kw_only=True)
class EffectRequest:
    """Which effects a user asks for.

    Attributes:
        base: what is simulated before names count: what the shot calls for, everything that the
            pipeline can, or nothing.
        added: effects asked for by name.
        removed: effects left out by name.
    """

    base: Base
    added: frozenset[str] = frozenset()
    removed: frozenset[str] = frozenset()

    @classmethod
    def parse(cls, text: str, known: Sequence[str]) -> EffectRequest:
        """Read what `--effects` says.

        Args:
            text: `auto`, `all` or `none`, with `+NAME` or `NAME` to add and `-NAME` to leave out,
                separated by commas; signed names alone change `auto`, plain names alone are a list.
            known: names of all effects.

        Raises:
            UsageError: an unknown name, two bases, or an effect both added and left out.
        """
        words = [word.strip() for word in text.split(",")]
        bases = [word for word in words if word in get_args(Base)]
        names = [word for word in words if word not in get_args(Base)]
        for name in names:
            _check_name(name, known)
        if len(set(bases)) > 1:
            raise UsageError(f"--effects {text}: begin with one of {' and '.join(bases)}, not both")
        plain = {name for name in names if name[0] not in "+-"}
        signed = {name for name in names if name[0] in "+-"}
        if not bases and plain and signed:
            raise UsageError(
                f"--effects {text}: a list of names and changes by + or - do not go together; "
                f"write auto,{text} to change what the shot calls for"
            )
        added = frozenset(plain | {name[1:] for name in signed if name[0] == "+"})
        removed = frozenset(name[1:] for name in signed if name[0] == "-")
        if added & removed:
            raise UsageError(
                f"--effects {text}: {', '.join(sorted(added & removed))} is both added and left "
                "out; leave one of them away"
            )
        base = bases[0] if bases else "none" if plain else "auto"
        return cls(base=cast("Base", base), added=added, removed=removed)

    def possible(self, known: Sequence[str]) -> tuple[str, ...]:
        """The effects of `known` that it asks for or leaves to the shot."""
        if self.base == "none":
            return tuple(name for name in known if name in self.added)
        return tuple(name for name in known if name not in self.removed)

    def asks_for(self, effect: str) -> bool:
        """Whether an effect is wanted whatever the shot calls for."""
        return effect in self.added or (self.base == "all" and effect not in self.removed)


def _check_name(word: str, known: Sequence[str]) -> None:
    name = word[1:] if word[:1] in ("+", "-") else word
    if name in known:
        return
    near = get_close_matches(name, [*get_args(Base), *known], n=1)
    meant = f"did you mean {near[0]}? There are" if near else "there are"
    raise UsageError(
        f"--effects: {word!r} is not an effect; {meant}: auto, all, none, and names to list, to "
        f"add (+NAME) or to leave out (-NAME): {', '.join(known)}"
    )
