"""What a chunk of a longer result says about itself, so that chunks are never mixed up."""

from __future__ import annotations

import json
from dataclasses import asdict, dataclass


@dataclass(frozen=True, slots=True, kw_only=True)
class ChunkMark:
    """Where a chunk belongs.

    Attributes:
        key: hash of everything that its pictures depend on; chunks of one result share it.
        plate: hash of the plate alone.
        first: number of its first frame in the plate [1].
        end: the one past its last frame, unless the plate ends before; None for the plate's end.
    """

    key: str
    plate: str
    first: int
    end: int | None

    @property
    def file_name(self) -> str:
        """The name that its file has by rights."""
        end = "end" if self.end is None else f"{self.end:08d}"
        return f"{self.key}-{self.first:08d}-{end}.nut"

    def to_json(self) -> str:
        """As it is written into the chunk's file."""
        return json.dumps(asdict(self))

    @classmethod
    def from_json(cls, text: str) -> ChunkMark:
        """Read it back.

        Raises:
            ValueError: this is not what `to_json` writes.
        """
        try:
            raw = json.loads(text)
            mark = cls(
                key=str(raw["key"]), plate=str(raw["plate"]), first=int(raw["first"]),
                end=None if raw["end"] is None else int(raw["end"]),
            )  # fmt: skip
        except (KeyError, TypeError) as error:
            raise ValueError(f"no chunk's mark: {text[:80]}") from error
        if mark.first < 0 or (mark.end is not None and mark.end <= mark.first):
            raise ValueError(f"frames {mark.first} to {mark.end}")
        return mark
