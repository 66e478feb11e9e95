"""The spreading of `kernels.scatter` in torch, for `--device cuda`; the same sums, on any device.

Laying out, extending past the silhouette, splitting in levels and renormalising are the kernels':
only the spreading, which takes most of the time, runs here. Each row of all pixels' discs is one
step: ends of spans go into a difference buffer, stamps are added shifted, running sums make light.
On CUDA, sums of many ends come in no fixed order, so results may differ in their last bits.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
import torch

from nlens_video.core.layers import Box, Float32, Float64
from nlens_video.kernels.scatter.disc import Discs
from nlens_video.kernels.scatter.levels import (
    ALONG,
    AXIS,
    BARREL_X,
    BARREL_Y,
    DOWN,
    RADIUS,
    SPAN,
    STAMP,
    STAMP_RADIUS,
    Level,
    on_level,
)
from nlens_video.kernels.scatter.scatter import spread_levels

Tensor = torch.Tensor


@dataclass(frozen=True, slots=True)
class TorchSpread:
    """Spreads levels as `kernels.scatter.spread_levels` does.

    Attributes:
        device: torch's name of where, `cpu` or `cuda`.
        notes: takes a word when its memory does not suffice; such pictures go to the CPU's kernel.
    """

    device: str
    notes: list[str] = field(default_factory=list, compare=False)

    def __call__(
        self,
        levels: list[Level],
        target: Box,
        discs: Discs,
        columns: tuple[Float64, Float64],
        rim: float,
        threads: int | None,
    ) -> Float32:
        """Sums (h, w, 5) of `target`; arguments as there, `columns` and `threads` not needed."""
        try:
            tables = _Tables(discs, rim, self.device)
            sums = torch.zeros((0, 0, 5), device=self.device)
            start = (0, 0)
            for level, n in zip(levels, range(len(levels) - 1, -1, -1), strict=True):
                here = target if n == 0 else on_level(target, n).expanded(2)
                inner = here.intersection(level.box)
                made = torch.zeros((here.height, here.width, 5), device=self.device)
                rows, across = inner.slices_in(here)
                part = _spread(level, inner, tables)
                if sums.numel():
                    part = part + _enlarged(sums, inner, start)
                made[rows, across] = part
                sums, start = made, (here.y0, here.x0)
            return np.asarray(sums.cpu().numpy(), dtype=np.float32)
        except torch.OutOfMemoryError:
            if not self.notes:
                self.notes.append("the GPU's memory does not suffice: the CPU blurs what it cannot")
            return spread_levels(levels, target, discs, columns, rim, threads)


class _Tables:
    """An aperture's tables on the device, and how to read them."""

    def __init__(self, discs: Discs, rim: float, device: str) -> None:
        stamps, spans, steps, turned, self.aspect, self.outer = discs
        self.device, self.rim = device, rim
        self._stamps = torch.as_tensor(stamps, device=device)
        self._spans = torch.as_tensor(spans, device=device)
        self._steps, self._turned = steps, turned
        self.span_rows = spans.shape[0] // 2
        self.stamp_rows, self.stamp_columns = stamps.shape[0] // 2, stamps.shape[1] // 2

    def stamp(self, radius: Tensor, dy: int, dx: int) -> Tensor:
        """Weights of stamps of signed radii, `dy` rows and `dx` columns off their middles."""
        table = self._stamps[dy + self.stamp_rows, dx + self.stamp_columns]
        return _look_up(table, radius, self._steps[0], self._turned[0])

    def span(self, radius: Tensor, dy: int) -> tuple[Tensor, Tensor]:
        """Middles and halves of spans of signed radii, `dy` rows off [half axis]."""
        table = self._spans[dy + self.span_rows]
        middle, half = (_look_up(one, radius, self._steps[1], self._turned[1]) for one in table)
        return middle, half


def _look_up(table: Tensor, radius: Tensor, steps: int, behind: int) -> Tensor:
    place = radius.abs() * steps
    entry = place.floor()
    part = place - entry
    index = (entry.long() + behind * (radius > 0.0)).clamp(0, table.shape[0] - 2)
    low = table[index]
    return low + part * (table[index + 1] - low)


def _spread(level: Level, inner: Box, tables: _Tables) -> Tensor:
    """Sums (h, w, 5) of a box within a level, of what the level's own pixels spread."""
    light = torch.as_tensor(level.light[0], device=tables.device)
    light = torch.cat([light, torch.ones_like(light[..., :1])], dim=2)
    numbers = torch.as_tensor(level.light[1], device=tables.device).movedim(1, 0).contiguous()
    off = (inner.y0 - level.box.y0, inner.x0 - level.box.x0)
    sums = _spans(light, numbers, inner, off, tables)
    reach = int(level.rows[3].max())
    wide = min(int(level.rows[4].max()), tables.stamp_columns)
    for dy in range(-min(reach, tables.stamp_rows), min(reach, tables.stamp_rows) + 1):
        source, rows = _rows(light.shape[0], inner.height, dy - off[0])
        of_row = numbers[:, source]
        for dx in range(-wide, wide + 1):
            weight = tables.stamp(of_row[STAMP_RADIUS], dy, dx) * of_row[STAMP]
            weight = weight * (1.0 + dx * of_row[ALONG] + dy * of_row[DOWN])
            given, columns = _rows(light.shape[1], inner.width, dx - off[1])
            weight = weight[:, given].clamp(min=0.0)
            sums[rows, columns] += weight[..., None] * light[source, given]
    return sums


def _rows(sources: int, targets: int, by: int) -> tuple[slice, slice]:
    """Which of the sources land within the targets when moved, and where."""
    first, last = max(0, -by), min(sources, targets - by)
    last = max(first, last)
    return slice(first, last), slice(first + by, last + by)


def _spans(
    light: Tensor, numbers: Tensor, inner: Box, off: tuple[int, int], tables: _Tables
) -> Tensor:
    """What spans give to a box, from both of their ends by running sums."""
    edge = math.ceil(float(numbers[AXIS].max()) * tables.outer * 1.2 + tables.stamp_columns) + 4
    width = light.shape[1] + 2 * edge
    buffer = torch.zeros((inner.height * width, 5), device=tables.device, dtype=torch.float64)
    columns = torch.arange(light.shape[1], device=tables.device)
    for dy in range(-tables.span_rows, tables.span_rows + 1):
        source, rows = _rows(light.shape[0], inner.height, dy - off[0])
        start, stop, weight = _ends(numbers[:, source], dy, tables)
        drawn = weight != 0.0
        if not bool(drawn.any()):
            continue
        line = torch.arange(rows.start, rows.stop, device=tables.device)[:, None] * width
        place = (line + columns[None, :] + edge)[drawn]
        given, weight = light[source][drawn], weight[drawn]
        for end, sign in ((start[drawn], 1.0), (stop[drawn], -1.0)):
            first = end.floor()
            further = weight * (end - first)
            at = place + first.long()
            buffer.index_add_(0, at, (sign * (weight - further))[:, None].double() * given)
            buffer.index_add_(0, at + 1, (sign * further)[:, None].double() * given)
    run = buffer.view(inner.height, width, 5).cumsum(dim=1)
    return run[:, edge + off[1] : edge + off[1] + inner.width].float()


def _ends(numbers: Tensor, dy: int, tables: _Tables) -> tuple[Tensor, Tensor, Tensor]:
    """Start, stop and weight of spans `dy` rows off their pixels, as `scatter.cpp` does."""
    middle, half = tables.span(numbers[RADIUS], dy)
    axis = numbers[AXIS]
    if tables.rim > 0.0:
        safe = axis.clamp(min=1e-6)
        off = (dy - numbers[BARREL_Y]) / (safe * tables.aspect)
        rim = (tables.rim**2 - off * off).clamp(min=0.0).sqrt()
        across = numbers[BARREL_X] / safe
        low, high = (
            torch.maximum(middle - half, across - rim),
            torch.minimum(middle + half, across + rim),
        )
        middle, half = 0.5 * (low + high), (0.5 * (high - low)).clamp(min=0.0)
    middle, half = axis * middle, axis * half
    along = numbers[ALONG]
    even = 1.0 + dy * numbers[DOWN] + along * middle
    start = 0.5 + middle + along * half * half / 3.0 - half
    weight = torch.where(half > 0.0, numbers[SPAN] * even, torch.zeros_like(half))
    return start, start + 2.0 * half, weight


def _enlarged(coarse: Tensor, inner: Box, start: tuple[int, int]) -> Tensor:
    """A box of a level from the next coarser one, interpolated between its pixels."""
    rows = torch.arange(inner.y0, inner.y1, device=coarse.device) - 2 * start[0]
    columns = torch.arange(inner.x0, inner.x1, device=coarse.device) - 2 * start[1]
    near, far = rows >> 1, (rows >> 1) + torch.where(rows % 2 == 1, 1, -1)
    line = 0.25 * (0.75 * coarse[near] + 0.25 * coarse[far])
    here, beside = columns >> 1, (columns >> 1) + torch.where(columns % 2 == 1, 1, -1)
    return 0.75 * line[:, here] + 0.25 * line[:, beside]
