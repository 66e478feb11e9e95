"""Tells of a cut in the plate: the object stays in the camera of the first shot.

A cut changes the picture all over, once. Flashes, lamps and things that pass leave some of its
texture where it was; a jolt or a fast pan moves it, or changes it in several frames.
"""

from __future__ import annotations

from collections import deque
from threading import Lock

import cv2
import numpy as np
from msgspec import Struct

from nlens_video.core.errors import Note, NoteKind
from nlens_video.core.layers import Bool, Box, Float32, Picture
from nlens_video.graph.base.profiler import FrameTiming
from nlens_video.graph.executor import FrameState, Observer

_CELLS = (6, 8)  # rows and columns of cells that are compared each for itself
_CELL_PX = 10  # side of a cell in the small picture
_TEXTURE = 0.02  # deviation of a cell with texture, of root of light [1]
_ALIKE = 0.5  # correlation of a cell that shows the same [1]
_LEAST_JUDGED = 0.25  # of the cells that must have texture
_OTHER, _SAME = 0.15, 0.5  # share of like cells up to which pictures differ, from which they do not
_BESIDE = 2  # frames before and after a cut that are like their neighbours
_RETURN_S = 0.6  # for how long the view from before may come back, as after a flash
_MOVED = 0.7  # correlation of the middle of a picture with a place in the one before [1]
_JUMP_SHARE, _JUMP_RATIO = 0.1, 1.3  # of the object: shift [frame width], and change of its height


class CutCheck(Observer):
    """An `Observer` that compares neighbouring frames at a small size.

    Where the object itself jumps with the picture, its camera knows of the cut.

    Args:
        frame_s: frame interval, 0 for a still [s].
        live: whether the plate is a stream, which has no ranges.
    """

    def __init__(self, frame_s: float, *, live: bool = False) -> None:
        super().__init__()
        self._live = live
        self._watch = CutWatch(max(_BESIDE, round(_RETURN_S / frame_s)) if frame_s else _BESIDE)
        self._first = 0
        self._lock = Lock()
        self._box: tuple[int, Box | None] | None = None
        self._jumps: set[int] = set()

    @property
    def notes(self) -> tuple[str, ...]:
        """A warning with the first cut; empty without one."""
        with self._lock:
            cut = self._watch.cut
        if cut is None or cut in self._jumps:
            return ()
        ranges = f", with --range {self._first}:{cut} and --range {cut}:"
        text = (
            f"frame {cut}: another shot begins, and the object stays in the camera of the first; "
            f"render each shot by itself{'' if self._live else ranges}"
        )
        return (Note(text, NoteKind.UNCERTAIN),)

    def on_frame_start(self, state: FrameState) -> None:
        """Compare the plate with the frame before."""
        with self._lock:
            if not self._watch.frames:
                self._first = state.frame.index
            self._watch.see(state.frame.index, state.frame.picture)

    def frame(self, state: FrameState, timing: FrameTiming) -> None:
        """Look whether the object jumps."""
        index, bounds = state.frame.index, state.values.bounds
        box = None if bounds is None else bounds.box
        if self._box is not None and self._box[0] == index - 1:
            if _jumps(self._box[1], box, state.frame.picture.width):
                self._jumps.add(index)
        self._box = index, box


def _jumps(before: Box | None, now: Box | None, width: int) -> bool:
    """Whether the object is elsewhere, or of another size."""
    if before is None or now is None:
        return before is not now
    shift = max(abs(now.x0 + now.x1 - before.x0 - before.x1),
                abs(now.y0 + now.y1 - before.y0 - before.y1)) / 2  # fmt: skip
    low, high = sorted((max(1, before.height), max(1, now.height)))
    return shift > _JUMP_SHARE * width or high > _JUMP_RATIO * low


class _Small(Struct, frozen=True):
    """A small picture.

    Attributes:
        root: of its light (h, w).
        cells: the same by cell, of mean 0 (N, pixels).
        deviation: of each cell (N,).
    """

    root: Float32
    cells: Float32
    deviation: Float32

    @classmethod
    def of(cls, picture: Picture) -> _Small:
        rows, columns = _CELLS
        size = columns * _CELL_PX, rows * _CELL_PX
        root = np.sqrt(np.maximum(picture.downsample(*size)[..., 1], 0.0))
        tiles = root.reshape(rows, _CELL_PX, columns, _CELL_PX).swapaxes(1, 2)
        flat = np.asarray(tiles.reshape(rows * columns, -1), np.float32)
        return cls(root, flat - flat.mean(axis=1, keepdims=True), flat.std(axis=1))

    @property
    def textured(self) -> Bool:
        """Cells that have texture (N,)."""
        return np.asarray(self.deviation > _TEXTURE)

    def like(self, other: _Small) -> float | None:
        """Share of the cells that show the same, whatever the light; None with too few to tell."""
        judged = self.textured | other.textured
        if min(self.textured.mean(), other.textured.mean()) < _LEAST_JUDGED:
            return None
        both = np.maximum(self.deviation * other.deviation, 1e-9)
        alike = (self.cells * other.cells).mean(axis=1) > _ALIKE * both
        return float(alike[judged].mean())

    def moved_into(self, other: _Small) -> bool:
        """Whether the middle of another picture is somewhere in this one."""
        height, width = self.root.shape
        middle = other.root[height // 4 : -height // 4, width // 4 : -width // 4]
        found = cv2.matchTemplate(self.root, middle, cv2.TM_CCOEFF_NORMED)
        return bool(found.max() > _MOVED)


class CutWatch:
    """Finds the first cut of neighbouring frames.

    Args:
        returns: frames after a change within which the view from before may come back.

    Attributes:
        frames: seen so far.
    """

    def __init__(self, returns: int) -> None:
        self.frames = 0
        self._returns = returns
        self._index = -1
        self._recent: deque[_Small] = deque(maxlen=_BESIDE + 1)
        self._likes: deque[float] = deque(maxlen=_BESIDE)  # of the frames before, to theirs
        self._before: _Small | None = None  # the frame before a change
        self._changed = self._since = 0
        self._told: int | None = None

    @property
    def cut(self) -> int | None:
        """Index of the first frame of another shot; None where all are of one."""
        settled = self._before is not None and self._since >= _BESIDE
        return self._changed if self._told is None and settled else self._told

    def see(self, index: int, picture: Picture) -> None:
        """Look at the next frame; nothing is told of frames that do not follow each other."""
        self.frames += 1
        if self._told is not None:
            return
        small = _Small.of(picture)
        if index != self._index + 1:
            self._recent.clear()
            self._likes.clear()
            self._before = None
        self._index = index
        if self._recent:
            self._compare(self._recent[-1], small)
        self._recent.append(small)

    def _compare(self, previous: _Small, small: _Small) -> None:
        like = previous.like(small)
        like = 1.0 if like is None else like
        if self._before is not None:
            self._since += 1
            back = self._before.like(small)
            if (self._since <= _BESIDE and like < _SAME) or (back is not None and back > _OTHER):
                self._before = None
            elif self._since >= self._returns:
                self._told = self._changed
        elif like < _OTHER and min(self._likes, default=1.0) > _SAME:
            if not previous.moved_into(small):
                self._before, self._changed, self._since = previous, self._index, 0
        self._likes.append(like)
