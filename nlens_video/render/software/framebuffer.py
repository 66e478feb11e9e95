"""Framebuffer of the software rasteriser: the buffers of one picture and its passes."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from nlens_video.core.layers import Float32
from nlens_video.kernels.thread_pool import scratch
from nlens_video.render.base.drawer import ViewSetup
from nlens_video.render.base.shader_inputs import Lighting
from nlens_video.render.software import (
    alpha,
    deferred,
    raster,
    triangles,
)
from nlens_video.render.software.scene_buffers import SceneBuffers
from nlens_video.render.software.shading_block import Int32, new_block
from nlens_video.scene import screen_projection
from nlens_video.scene.screen_projection import pinhole_params

Rows = tuple[int, int]
_NONE = np.empty((0, 0), np.float32)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Framebuffer:
    """Buffers of one picture, and the passes that fill them."""

    shape: triangles.Shape
    spans: Int32
    opaque: Int32
    masked: Int32
    blended: Int32
    scene: deferred.ShadingInputs
    disparity: Float32
    ids: Int32
    passed: Float32
    front: Float32
    rgba: Float32
    depth: Float32
    least: float

    @classmethod
    def of(
        cls, shown: SceneBuffers, setup: ViewSetup, lighting: Lighting, *, behind: bool = False
    ) -> Framebuffer:
        """Project the vertices and find the triangles to be drawn.

        Args:
            shown: what is drawn.
            setup: from where.
            lighting: what lights it.
            behind: leave out what blends, and the inner sides of closed bodies.
        """
        lens = pinhole_params(setup.camera, setup.box, setup.near)
        width, height = setup.box.width, setup.box.height
        count = len(shown.faces)
        points = scratch("points", (len(shown.positions), 3), np.float64)
        spans = scratch("spans", (count, 2), np.int32)
        planes = scratch("planes", (count, triangles.PLANES))
        kept = scratch("kept", (count,), np.int32)
        lines = triangles.SAMPLES * height
        screen_projection.project(shown.positions, lens, points)
        shape = (points, shown.positions, shown.faces, lens)
        found = triangles.set_up(
            shape, shown.outer_sides if behind else shown.sides, width, lines, spans, planes, kept
        )
        opaque, masked, blended = shown.by_alpha(kept[:found], lens)
        blended = blended[: 0 if behind else None]
        ambient = lighting.ambient_rows()[: 0 if lighting.ambient is None else 9]
        lamps = lighting.lamp_rows(lens[9:12]), lighting.suns, ambient
        pinhole = np.delete(lens[:16], slice(9, 12)).astype(np.float32)
        stored = (lines, width + raster.PADDING)
        through = stored if len(blended) else (0, 0)
        return cls(
            shape=shape,
            spans=spans,
            opaque=opaque,
            masked=masked,
            blended=blended,
            scene=(shown.mesh(planes), shown.paint, pinhole, lamps),
            disparity=scratch("disparity", stored),
            ids=scratch("ids", stored, np.int32),
            passed=scratch("passed", through),
            front=scratch("front", through),
            rgba=np.empty((height, width, 4), np.float32),
            depth=np.empty((height, width), np.float32),
            least=1.0 / setup.far,
        )

    @property
    def steps(self) -> tuple[Callable[[Rows], None], ...]:
        """The passes, each over all rows, in order."""
        last = (self.light, self.measure)
        return (self.see, self.blend, *last) if len(self.blended) else (self.see, *last)

    def clear(self, rows: Rows) -> None:
        """Reset the samples of rows [first, last)."""
        here = _lines(rows)
        self.rgba[slice(*rows)] = 0.0
        self.disparity[here] = 0.0
        self.ids[here] = raster.NOTHING

    def see(self, rows: Rows) -> None:
        """Find what the samples of rows [first, last) show, and clear the picture."""
        self.clear(rows)
        here = _lines(rows)
        raster.fill(
            self.opaque, here.start, here.stop - 1, self.shape, self.spans, self.rgba.shape[1],
            self.disparity, self.ids,
        )  # fmt: skip
        self._cut_out(rows, _NONE)

    def see_behind(self, most: Float32, rows: Rows) -> None:
        """Find what of disparities up to `most` (h, w) they show instead."""
        self.clear(rows)
        raster.fill_behind(
            self.opaque, rows, (self.shape, self.spans), most, self.scene[0][6],
            self.disparity, self.ids,
        )  # fmt: skip
        self._cut_out(rows, most)

    def _cut_out(self, rows: Rows, most: Float32) -> None:
        if len(self.masked):
            alpha.cut_out(
                self.masked, rows, self.rgba.shape[1], (self.shape, self.spans), *self.scene[:2],
                most, self.disparity, self.ids, new_block(),
            )  # fmt: skip

    @property
    def shows_anything(self) -> bool:
        """Whether any sample shows an opaque triangle."""
        return bool((self.ids[:, : self.rgba.shape[1]] != raster.NOTHING).any())

    def keep_nearest(self, disparity_step: float) -> None:
        """Drop samples that lie farther behind their pixel's nearest one, once all are seen."""
        front = self._front()[:, : self.rgba.shape[1]].reshape(len(self.rgba), 4, -1)
        dropped = front < front.max(axis=1, keepdims=True) - np.float32(disparity_step)
        dropped = dropped.reshape(-1, self.rgba.shape[1])
        self.ids[:, : self.rgba.shape[1]][dropped] = raster.NOTHING
        self.disparity[:, : self.rgba.shape[1]][dropped] = np.inf  # hides what blends there
        self.rgba[:] = 0.0

    def blend(self, rows: Rows) -> None:
        """Light and depth of see-through surfaces on rows [first, last)."""
        here = _lines(rows)
        self.passed[here] = 1.0
        self.front[here] = self.disparity[here]
        alpha.blend(
            self.blended, rows, self.rgba.shape[1], (self.shape, self.spans), self.scene,
            self.disparity, self.passed, self.front, self.rgba.reshape(-1, 4), new_block(),
        )  # fmt: skip

    def light(self, rows: Rows) -> None:
        """Light of opaque surfaces on rows [first, last)."""
        deferred.shade_rows(
            *rows, self.rgba.shape[1], self.ids, self.passed, self.scene,
            self.rgba.reshape(-1, 4), new_block(),
        )  # fmt: skip

    def measure(self, rows: Rows) -> None:
        """Depth of rows [first, last)."""
        deferred.resolve_depth(self._front(), *rows, self.least, self.depth)

    def _front(self) -> Float32:
        return self.front if len(self.blended) else self.disparity


def _lines(rows: Rows) -> slice:
    return slice(triangles.SAMPLES * rows[0], triangles.SAMPLES * rows[1])
