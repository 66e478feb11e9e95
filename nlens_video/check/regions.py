"""Regions in which the result differs from the plate, tracked from frame to frame."""

from __future__ import annotations

from array import array
from dataclasses import dataclass, field

import cv2
import numpy as np
import numpy.typing as npt

from nlens_video.check.frames import BLOCK_PX
from nlens_video.check.motion import Template
from nlens_video.core.layers import Box, Float32

Mask = npt.NDArray[np.bool_]
_LEAST_BLOCKS = 3  # connected ones; a single block may be an artefact of the encoder
SECTORS = 8
_GAP_SHARE = 0.02  # parts nearer to each other than that are one region [frame width]
_PATIENCE = 3  # frames without its region after which a track ends
_MOST_TRACKS = 64
_KEPT = 0.9  # share of its blocks that a region keeps, unless something passes before it
_PASSES = 50  # frames that what passes may take


@dataclass(slots=True)
class Track:
    """One region over time; its arrays have an element for each frame on which it was found.

    Attributes:
        first: index of the first of these frames in the result.
        mask: its blocks on the last of these frames, (h, w).
        frames: index of the frame.
        times: of the plate's frame since its first one [s].
        area: coverage, in blocks of strong difference, with that of the blocks beside it [block].
        strong: its blocks that differ by more than twice the tolerance [block].
        boxes: first column and row, end column and row of it without its shadow, four numbers a
            frame [block].
        sharpness: log of its detail over the plate's gain of detail [1].
        sectors: the same of each sector round its middle, `SECTORS` numbers a frame, NaN where a
            sector is too small [1].
        motion: mean change of its luma since the frame before, NaN on its first [level].
        light: its mean red, green and blue, and the same without its shadow, six numbers a frame
            [level].
        plate_light: red, green and blue of the whole plate, three numbers a frame [level].
        steps: how far right and down it has moved since the frame before, and the same without its
            shadow, four numbers a frame, NaN where that is not known [px].
        plate_steps: that of the plate, as most of its points moved, two numbers a frame [px].
        templates: its picture on the last of these frames, and that without its shadow.
        shadowed: whether it is the plate with less light.
        worst: largest difference of a block [level].
        box: first column and row, end column and row of all its blocks [block].
        former: its blocks before something passed before it, else the last ones, (h, w).
        former_at: index of the frame of these.
        disturbed: indices of frames on which something moves in the plate at its place.
    """

    first: int
    mask: Mask
    former: Mask
    former_at: int
    frames: array[int] = field(default_factory=lambda: array("q"))
    times: array[float] = field(default_factory=lambda: array("d"))
    area: array[float] = field(default_factory=lambda: array("d"))
    strong: array[int] = field(default_factory=lambda: array("q"))
    boxes: array[int] = field(default_factory=lambda: array("q"))
    sharpness: array[float] = field(default_factory=lambda: array("d"))
    sectors: array[float] = field(default_factory=lambda: array("d"))
    motion: array[float] = field(default_factory=lambda: array("d"))
    light: array[float] = field(default_factory=lambda: array("d"))
    plate_light: array[float] = field(default_factory=lambda: array("d"))
    steps: array[float] = field(default_factory=lambda: array("d"))
    plate_steps: array[float] = field(default_factory=lambda: array("d"))
    templates: tuple[Template, ...] = ()
    shadowed: array[int] = field(default_factory=lambda: array("b"))
    worst: float = 0.0
    box: tuple[int, int, int, int] = (1 << 30, 1 << 30, 0, 0)
    disturbed: set[int] = field(default_factory=set)

    @property
    def last(self) -> int:
        """Index of the last frame on which it was found."""
        return self.frames[-1] if self.frames else self.first

    @property
    def box_px(self) -> tuple[int, int, int, int]:
        """Left, top, width and height of all its blocks [px]."""
        x0, y0, x1, y1 = (BLOCK_PX * edge for edge in self.box)
        return x0, y0, x1 - x0, y1 - y0

    def box_at(self, place: int) -> tuple[int, int, int, int]:
        """The box without its shadow on the frame at a place of the arrays [block]."""
        x0, y0, x1, y1 = self.boxes[4 * place : 4 * place + 4]
        return x0, y0, x1, y1

    @property
    def whole(self) -> npt.NDArray[np.bool_]:
        """Whether it stays clear of the frame's edge, for each of its frames (n,)."""
        rows, columns = self.mask.shape
        x0, y0, x1, y1 = np.array(self.boxes, np.int64).reshape(-1, 4).T
        return np.asarray((x0 > 0) & (y0 > 0) & (x1 < columns) & (y1 < rows), bool)

    def add(self, index: int, mask: Mask, worst: float) -> None:
        """Add the region on one more frame."""
        box = Box.of(mask)
        x0, y0, x1, y1 = self.box
        self.box = min(x0, box.x0), min(y0, box.y0), max(x1, box.x1), max(y1, box.y1)
        self.mask = mask
        whole = index not in self.disturbed and mask.sum() >= _KEPT * self.former.sum()
        if whole or index - self.former_at > _PASSES:
            self.former, self.former_at = mask, index
        self.worst = max(self.worst, worst)
        self.frames.append(index)


class Tracks:
    """Links the regions of neighbouring frames that lie on or next to each other.

    Somebody who crosses before an object splits its region: all parts where it was are of it.
    """

    def __init__(self) -> None:
        self.ended: list[Track] = []
        self.alive: list[Track] = []
        self.crowded = False

    def follow(
        self, index: int, difference: Float32, tolerance: float, passing: Mask | None = None
    ) -> list[Track]:
        """Add the regions of a frame; returns their tracks.

        Args:
            index: of the result's frame.
            difference: of each block from the plate's, (h, w) [level].
            tolerance: difference of a block that encoding alone may make [level].
            passing: blocks (h, w) in which something moves in the plate; None where none is known.
        """
        oldest = index - _PATIENCE
        self.ended += [one for one in self.alive if one.last < oldest]
        self.alive = [one for one in self.alive if one.last >= oldest]
        found: dict[int, tuple[Track, Mask]] = {}
        for mask in regions(difference > tolerance):
            track = self._nearest(mask) or self._begin(index, mask)
            if track is None:
                continue
            own = found.get(id(track))
            found[id(track)] = (track, mask if own is None else own[1] | mask)
        if passing is not None:
            for track in self.alive:
                place = _dilated(track.former | track.mask)
                if np.count_nonzero(place & passing) >= _LEAST_BLOCKS:
                    track.disturbed.add(index)
        for track, mask in found.values():
            track.add(index, mask, float(difference[mask].max()))
        return [track for track, _ in found.values()]

    def all(self) -> list[Track]:
        """All tracks, the largest first."""
        return sorted((*self.ended, *self.alive), key=lambda one: -sum(one.area))

    def _begin(self, index: int, mask: Mask) -> Track | None:
        if len(self.alive) + len(self.ended) >= _MOST_TRACKS:
            self.crowded = True
            return None
        track = Track(first=index, mask=mask, former=mask, former_at=index)
        self.alive.append(track)
        return track

    def _nearest(self, mask: Mask) -> Track | None:
        """The largest track that the region continues."""
        wide = _dilated(mask)
        near = [one for one in self.alive if ((one.mask | one.former) & wide).any()]
        return max(near, key=lambda one: sum(one.area), default=None)


def beside(disturbed: set[int], first: int, last: int) -> bool:
    """Whether something passes on some frames or on their neighbours."""
    return not disturbed.isdisjoint(range(first - 1, last + 2))


def regions(changed: Mask) -> list[Mask]:
    """Connected regions of changed blocks, gaps closed; largest first."""
    _, labels = cv2.connectedComponents(_dilated(changed).astype(np.uint8), connectivity=8)
    parts = []
    for label in np.unique(labels[changed]):
        part = changed & (labels == label)
        connected = cv2.connectedComponentsWithStats(part.astype(np.uint8), connectivity=8)[2]
        if int(connected[1:, cv2.CC_STAT_AREA].max()) >= _LEAST_BLOCKS:
            parts.append(part)
    return sorted(parts, key=lambda part: -int(part.sum()))


def _dilated(mask: Mask) -> Mask:
    """The mask, dilated."""
    reach = max(1, round(_GAP_SHARE * mask.shape[1]))
    kernel = np.ones((2 * reach + 1, 2 * reach + 1), np.uint8)
    return cv2.dilate(mask.astype(np.uint8), kernel).astype(bool)
