"""How far an object moves from one frame to the next.

A frame of the result is predicted: what the frame before shows of the object, moved, over the plate
of this frame. The motion is that of least squares (Lucas & Kanade), so that neither the plate
behind the outline nor the frame's edge counts for the object's own.
"""

from __future__ import annotations

import math

import cv2
import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from nlens_video.check.frames import BLOCK_PX, FrameFeatures
from nlens_video.core.layers import Bool, Box, Float32, Float64

NOT_KNOWN: Float64 = np.full(2, np.nan)
"""The step of what could not be registered."""
_SIDE_PX = 192  # of the picture that is registered, at most
_COARSE_PX = 48  # of that in which the first guess is searched
_FARTHEST = 0.75  # that it is searched for, in sizes of the object
_PAD_PX = 12  # of the plate around the object that is registered with it
_OPAQUE = np.float32(24.0)  # difference from the plate where the object covers it wholly [level]
_HOLE_PX = 9  # of places as light as the plate, which are the object all the same
_SOFT_PX = (3.0, 1.0)  # standard deviations of the low-pass, in turn
_ROUNDS = 12
_SETTLED_PX, _UNSETTLED_PX = 0.01, 0.1
_LEAST_GRADIENT = 0.3  # root mean square along the weaker axis [level/px]


class Look(Struct, frozen=True, eq=False):
    """A frame of the result, as it is registered.

    Attributes:
        index: of the frame.
        plate: luma of the plate, (H, W) [level].
        added: what the result adds to it, (H, W) [level].
    """

    index: int
    plate: Float32
    added: Float32

    @classmethod
    def of(cls, plate: FrameFeatures, result: FrameFeatures) -> Look:
        """The look of a pair of frames."""
        return cls(result.index, plate.luma, result.luma - plate.luma)

    def without(self, blocks: Bool) -> Look:
        """The look where the plate is shown in some blocks (h, w)."""
        if not blocks.any():
            return self
        added = self.added.copy()
        rows, columns = added.shape
        cells = _cells(blocks)[:rows, :columns]
        added[: cells.shape[0], : cells.shape[1]][cells] = 0.0
        return replace(self, added=added)

    def cut(self, box: Box, scale: float) -> list[Float32]:
        """Plate, what is added, and 1 within the frame, (h, w) each: a box of it, reduced."""
        frame = Box(0, 0, self.plate.shape[1], self.plate.shape[0])
        common = box.intersection(frame)
        parts = []
        for one in (self.plate, self.added, np.ones((1, 1), np.float32)):
            part = np.zeros(box.shape, np.float32)
            within = one if one.size == 1 else one[common.slices_in(frame)]
            part[common.slices_in(box)] = within
            parts.append(_resized(part, 1.0 / scale))
        return parts


class Template(Struct, frozen=True, eq=False):
    """An object on one frame, to be found on the next.

    Attributes:
        box: where it lies, in the pixels of the frame; it may reach beyond.
        colour: its premultiplied luma at the registered size, (h, w) [level].
        alpha: its coverage, about, (h, w) [1].
        known: 1 within the frame, (h, w) [1].
        scale: pixels of the frame to one of the registered picture [1].
    """

    box: Box
    colour: Float32
    alpha: Float32
    known: Float32
    scale: float

    @classmethod
    def of(cls, look: Look, blocks: Bool) -> Template:
        """The object in some blocks (h, w) and those next to them."""
        blocks = cv2.dilate(blocks.astype(np.uint8), np.ones((3, 3), np.uint8)).astype(bool)
        at = Box.of(blocks)
        bare = Box(*(BLOCK_PX * edge for edge in (at.x0, at.y0, at.x1, at.y1)))
        scale = max(1.0, max(bare.width, bare.height) / _SIDE_PX)
        box = bare.expanded(math.ceil(_PAD_PX * scale))
        within = np.zeros(box.shape, np.float32)
        within[bare.slices_in(box)] = _cells(blocks[at.y0 : at.y1, at.x0 : at.x1])
        inside = _resized(within, 1.0 / scale)
        plate, added, known = look.cut(box, scale)
        differs = np.abs(cv2.GaussianBlur(added, (0, 0), _SOFT_PX[-1]))
        covered = np.asarray(inside * np.clip(differs / _OPAQUE, 0.0, 1.0), np.float32)
        hole = np.ones((_HOLE_PX, _HOLE_PX), np.uint8)
        alpha = np.asarray(cv2.morphologyEx(covered, cv2.MORPH_CLOSE, hole), np.float32)
        return cls(box, inside * added + alpha * plate, alpha, known, scale)

    def step(self, look: Look) -> Float64:
        """How far right and down the object has moved on the next frame, (2,) [px].

        `NOT_KNOWN` where its picture does not tell.
        """
        reach = math.ceil(_FARTHEST * max(self.box.width, self.box.height))
        picture = np.dstack(look.cut(self.box.expanded(reach), self.scale))
        place = self._guess(picture)
        for soft in _SOFT_PX:
            place = self._refined(picture, place, soft)
        return (place - reach / self.scale) * self.scale

    def _guess(self, picture: Float32) -> Float64:
        """The best of all whole places, at a coarse size, (2,)."""
        ratio = min(1.0, _COARSE_PX / max(self.colour.shape))
        colour, alpha, picture = (
            _resized(one, ratio) for one in (self.colour, self.alpha, picture)
        )
        plate, shown, known = cv2.split(picture)
        misfit = sum(
            factor * cv2.matchTemplate(there * known, here, cv2.TM_CCORR)
            for factor, here, there in (  # the terms of (colour - alpha * plate - shown)^2
                (1.0, colour * colour, known),
                (1.0, alpha * alpha, plate * plate),
                (-2.0, colour * alpha, plate),
                (-2.0, colour, shown),
                (2.0, alpha, plate * shown),
            )
        )
        row, column = np.unravel_index(int(np.argmin(misfit)), np.shape(misfit))
        taller, wider = np.divide(self.colour.shape, colour.shape)
        return np.array([column * wider, row * taller])

    def _refined(self, picture: Float32, place: Float64, soft: float) -> Float64:
        """The place of least squares, (2,); `NOT_KNOWN` where the rounds do not settle."""
        width, height = self.colour.shape[::-1]
        rim = np.ones((2 * math.ceil(2.0 * soft) + 1,) * 2, np.uint8)
        move = np.full(2, np.inf)
        for _ in range(_ROUNDS):
            if not np.abs(move).max() > _SETTLED_PX or not np.isfinite(place).all():
                break
            matrix = np.array([[1.0, 0.0, place[0]], [0.0, 1.0, place[1]]])
            there = cv2.warpAffine(
                picture, matrix, (width, height), flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
            )
            plate, shown, known = (np.asarray(one, np.float32) for one in cv2.split(there))
            within = np.asarray(np.minimum(known, self.known) > 0.99, np.float32)
            valid = cv2.erode(within, rim)
            off = self.colour - self.alpha * plate - shown
            slopes = [
                across + self.alpha * below
                for across, below in zip(_gradients(shown), _gradients(plate), strict=True)
            ]
            off, *slopes = (cv2.GaussianBlur(valid * one, (0, 0), soft) for one in (off, *slopes))
            total = max(float((valid * self.alpha).sum()), 1.0)
            steep = np.stack(slopes).reshape(2, -1).astype(np.float64)
            normal = steep @ steep.T / total
            if np.linalg.eigvalsh(normal)[0] < _LEAST_GRADIENT**2:
                return NOT_KNOWN
            move = np.linalg.solve(normal, steep @ off.ravel() / total)
            place = place + move
        return place if np.abs(move).max() < _UNSETTLED_PX else NOT_KNOWN


def _gradients(values: Float32) -> tuple[Float32, Float32]:
    """Slope (h, w) to the right and down: that of both neighbours, at a border of one."""
    found = np.empty_like(values), np.empty_like(values)
    for slope, line in ((found[0].T, values.T), (found[1], values)):
        np.subtract(line[2:], line[:-2], out=slope[1:-1])
        slope[1:-1] *= np.float32(0.5)
        slope[0], slope[-1] = line[1] - line[0], line[-1] - line[-2]
    return found


def _cells(blocks: Bool) -> Bool:
    """The pixels of some blocks."""
    return np.asarray(blocks.repeat(BLOCK_PX, 0).repeat(BLOCK_PX, 1), bool)


def _resized(values: Float32, ratio: float) -> Float32:
    if ratio >= 1.0:
        return np.asarray(values, np.float32)
    size = [max(1, round(ratio * edge)) for edge in values.shape[1::-1]]
    return np.asarray(cv2.resize(values, size, interpolation=cv2.INTER_AREA), np.float32)
