"""What the check has found, in words and numbers."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import asdict, dataclass
from typing import Any, Literal

Kind = Literal["frames", "time", "freeze", "plate", "pop", "flicker", "sound"]
KINDS: dict[Kind, str] = {
    "frames": "dropped, added or repeated frames",
    "time": "times of the frames",
    "freeze": "object standing still for a moment",
    "plate": "plate pixels away from the object",
    "pop": "jumps of a single frame",
    "flicker": "flicker of sharpness or coverage",
    "sound": "audio against the pictures",
}


@dataclass(frozen=True, slots=True, kw_only=True)
class Finding:
    """One thing that is not as it should be.

    Attributes:
        kind: what is measured.
        frame: index of the first frame of the result that shows it, None for the whole.
        last: index of the last one.
        value: the measure, in the unit that the words name.
        text: the finding in words.
    """

    kind: Kind
    frame: int | None
    last: int | None
    value: float
    text: str


def at(kind: Kind, frames: tuple[int, int] | None, value: float, text: str) -> Finding:
    """A finding on some frames, said first in the words."""
    if frames is None:
        return Finding(kind=kind, frame=None, last=None, value=value, text=text)
    first, last = frames
    where = f"frame {first}" if first == last else f"frames {first} to {last}"
    return Finding(kind=kind, frame=first, last=last, value=value, text=f"{where}: {text}")


@dataclass(frozen=True, slots=True, kw_only=True)
class Verdict:
    """A result compared with its plate.

    Attributes:
        result: the result's name.
        plate: the plate's name.
        frames: of the result and of the plate [1].
        object_frames: frames of the result that show an object [1].
        measures: the figures behind the findings; name to value, the unit in the name.
        findings: what is wrong, empty where nothing is.
        notes: what could not be judged, and why.
    """

    result: str
    plate: str
    frames: tuple[int, int]
    object_frames: int
    measures: dict[str, float]
    findings: tuple[Finding, ...]
    notes: tuple[str, ...]

    @property
    def fine(self) -> bool:
        """Whether nothing was found."""
        return not self.findings

    def of(self, kind: Kind) -> list[Finding]:
        """The findings of a kind."""
        return [one for one in self.findings if one.kind == kind]

    def as_json(self) -> dict[str, Any]:
        """For scripts."""
        return {"fine": self.fine, **asdict(self)}


def runs(indices: Iterable[int]) -> list[tuple[int, int]]:
    """First and last of each stretch of neighbouring numbers, which must rise."""
    stretches: list[tuple[int, int]] = []
    for index in indices:
        if stretches and index == stretches[-1][1] + 1:
            stretches[-1] = (stretches[-1][0], index)
        else:
            stretches.append((index, index))
    return stretches
