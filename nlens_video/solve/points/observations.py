"""Where points were seen: kept on disk beyond a few megabytes, however long the shot is."""

from __future__ import annotations

import tempfile
import weakref

import numpy as np
import numpy.typing as npt
from msgspec import Struct

from nlens_video.core.layers import Float32, Float64

Ints = npt.NDArray[np.int64]

_IN_MEMORY = 1 << 24  # bytes
_TRACK_FRAMES = 60
_ROW = np.dtype([("number", "<i4"), ("pixel", "<f4", 2)])


class Table(Struct, frozen=True, eq=False):
    """Observations in a few frames.

    Attributes:
        numbers: point of each observation (N,), 0 to P - 1.
        places: frame of each observation, by its place among the frames (N,).
        pixels: position of each observation (N, 2), pixel centres at +0.5 [px].
        names: number of each point in the whole shot (P,).
    """

    numbers: Ints
    places: Ints
    pixels: Float64
    names: Ints

    def at(self, place: int) -> tuple[Ints, Float64]:
        """Points (K,) and positions (K, 2) of one frame, the points in rising order."""
        here = np.flatnonzero(self.places == place)
        here = here[np.argsort(self.numbers[here], kind="stable")]
        return self.numbers[here], self.pixels[here]


class Observations:
    """Observations by frame."""

    def __init__(self) -> None:
        self._file = tempfile.SpooledTemporaryFile(_IN_MEMORY)
        weakref.finalize(self, self._file.close)
        self._ends = [0]

    def __len__(self) -> int:
        return len(self._ends) - 1

    def add(self, numbers: Ints, pixels: Float32) -> None:
        """Take the next frame's points (K,) and their positions (K, 2) [px]."""
        rows = np.empty(len(numbers), _ROW)
        rows["number"], rows["pixel"] = numbers, pixels
        self._file.seek(self._ends[-1])
        self._file.write(rows.tobytes())
        self._ends.append(self._ends[-1] + rows.nbytes)

    def frame(self, index: int) -> tuple[Ints, Float64]:
        """Points (K,) and positions (K, 2) of one frame [px]."""
        start, end = self._ends[index], self._ends[index + 1]
        self._file.seek(start)
        rows = np.frombuffer(self._file.read(end - start), _ROW)
        return rows["number"].astype(np.int64), rows["pixel"].astype(np.float64)

    def table(self, frames: list[int], fewest: int = 2) -> Table:
        """Points that some frames show at least a few times."""
        found = [self.frame(frame) for frame in frames]
        names = np.concatenate([numbers for numbers, _ in found])
        pixels = np.concatenate([pixels for _, pixels in found])
        places = np.repeat(np.arange(len(frames)), [len(numbers) for numbers, _ in found])
        kept, numbers, counts = np.unique(names, return_inverse=True, return_counts=True)
        often = counts[numbers] >= fewest
        place = np.cumsum(counts >= fewest) - 1
        return Table(
            numbers=place[numbers[often]], places=places[often], pixels=pixels[often],
            names=kept[counts >= fewest],
        )  # fmt: skip

    def tracks(self) -> list[dict[int, Float64]]:
        """Points by frames that show them, of frames all over the shot: positions (2,) [px]."""
        frames = list(range(0, len(self), 1 + (len(self) - 1) // _TRACK_FRAMES))
        table = self.table(frames)
        found: list[dict[int, Float64]] = [{} for _ in table.names]
        for number, place, pixel in zip(table.numbers, table.places, table.pixels, strict=True):
            found[number][frames[place]] = pixel
        return found
