"""Framebuffer of the software rasteriser: the buffers of one picture and its passes."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from nlens_video.core.layers import Float32
from nlens_video.kernels.scratch import scratch
from nlens_video.render.base.drawer import ViewSetup
from nlens_video.render.software import alpha, deferred, raster, triangles
from nlens_video.render.software.scene_buffers import SceneBuffers
from nlens_video.render.software.shading_inputs import Int32, ShadingInputs, lights
from nlens_video.scene import screen_projection
from nlens_video.scene.screen_projection import pinhole_params

Rows = tuple[int, int]
_NONE = np.empty((0, 0), np.float32)


class Framebuffer:
    """Buffers of one picture, and the passes that fill them.

    Made, it holds the projected vertices and the triangles to be drawn.

    Args:
        shown: what is drawn.
        view: from where, in which light.
        behind: leave out what blends, and the inner sides of closed bodies.

    Attributes:
        rgba: premultiplied linear light (h, w, 4).
        depth: along the optical axis (h, w), +inf where nothing is [scene unit].
    """

    def __init__(self, shown: SceneBuffers, view: ViewSetup, *, behind: bool = False) -> None:
        lens = pinhole_params(view.camera, view.box, view.near)
        width, height = view.box.width, view.box.height
        count = len(shown.faces)
        points = scratch("points", (len(shown.positions), 3), np.float64)
        planes = scratch("planes", (count, triangles.PLANES))
        kept = scratch("kept", (count,), np.int32)
        lines = triangles.SAMPLES * height
        screen_projection.project(shown.positions, lens, points)
        self._shape: triangles.Shape = (points, shown.positions, shown.faces, lens)
        self._spans: Int32 = scratch("spans", (count, 2), np.int32)
        sides = shown.outer_sides if behind else shown.sides
        found = triangles.set_up(self._shape, sides, width, lines, self._spans, planes, kept)
        self._opaque, self._masked, blended = shown.by_alpha(kept[:found], lens)
        self.blended = blended[: 0 if behind else None]
        pinhole = np.delete(lens[:16], slice(9, 12)).astype(np.float32)
        self._scene: ShadingInputs = (
            shown.mesh(planes), shown.paint, pinhole, lights(view.lighting, lens[9:12])
        )  # fmt: skip
        stored = (lines, width + raster.PADDING)
        through = stored if len(self.blended) else (0, 0)
        self._disparity: Float32 = scratch("disparity", stored)
        self._ids: Int32 = scratch("ids", stored, np.int32)
        self._passed: Float32 = scratch("passed", through)
        self._front: Float32 = scratch("front", through) if len(self.blended) else self._disparity
        self._least = 1.0 / view.far
        self.rgba = np.empty((height, width, 4), np.float32)
        self.depth = np.empty((height, width), np.float32)

    @property
    def steps(self) -> tuple[Callable[[Rows], None], ...]:
        """The passes, each over all rows, in order."""
        last = (self.light, self.measure)
        return (self.see, self.blend, *last) if len(self.blended) else (self.see, *last)

    def _clear(self, rows: Rows) -> None:
        here = _lines(rows)
        self.rgba[slice(*rows)] = 0.0
        self._disparity[here] = 0.0
        self._ids[here] = raster.NOTHING

    def see(self, rows: Rows) -> None:
        """Find what the samples of rows [first, last) show, and clear the picture."""
        self._clear(rows)
        here = _lines(rows)
        raster.fill(
            self._opaque, here.start, here.stop - 1, self._shape, self._spans, self.rgba.shape[1],
            self._disparity, self._ids,
        )  # fmt: skip
        self._cut_out(rows, _NONE)

    def see_behind(self, most: Float32, rows: Rows) -> None:
        """Find what of disparities up to `most` (h, w) they show instead."""
        self._clear(rows)
        raster.fill_behind(
            self._opaque, rows, (self._shape, self._spans), most, self._scene[0][6],
            self._disparity, self._ids,
        )  # fmt: skip
        self._cut_out(rows, most)

    def _cut_out(self, rows: Rows, most: Float32) -> None:
        if len(self._masked):
            alpha.cut_out(
                self._masked, rows, self.rgba.shape[1], (self._shape, self._spans),
                *self._scene[:2], most, self._disparity, self._ids,
            )  # fmt: skip

    @property
    def shows_anything(self) -> bool:
        """Whether any sample shows an opaque triangle."""
        return bool((self._ids[:, : self.rgba.shape[1]] != raster.NOTHING).any())

    def keep_nearest(self, disparity_step: float) -> None:
        """Drop what lies farther behind its pixel's nearest sample, once all are seen.

        Where that is see-through, the opaque surface behind it is dropped too.
        """
        width = self.rgba.shape[1]
        front = self._front[:, :width].reshape(len(self.rgba), 4, -1)
        least = front.max(axis=1, keepdims=True) - np.float32(disparity_step)
        opaque = self._disparity[:, :width].reshape(front.shape)
        self._ids[:, :width][(opaque < least).reshape(-1, width)] = raster.NOTHING
        # hides what blends there
        self._disparity[:, :width][(front < least).reshape(-1, width)] = np.inf
        self.rgba[:] = 0.0

    def blend(self, rows: Rows) -> None:
        """Light and depth of see-through surfaces on rows [first, last)."""
        here = _lines(rows)
        self._passed[here] = 1.0
        self._front[here] = self._disparity[here]
        alpha.blend(
            self.blended, rows, self.rgba.shape[1], (self._shape, self._spans), self._scene,
            self._disparity, self._passed, self._front, self.rgba.reshape(-1, 4),
        )  # fmt: skip

    def light(self, rows: Rows) -> None:
        """Light of opaque surfaces on rows [first, last)."""
        deferred.shade_rows(
            *rows, self.rgba.shape[1], self._ids, self._passed, self._scene,
            self.rgba.reshape(-1, 4),
        )  # fmt: skip

    def measure(self, rows: Rows) -> None:
        """Depth of rows [first, last)."""
        deferred.resolve_depth(self._front, *rows, self._least, self.depth)


def _lines(rows: Rows) -> slice:
    return slice(triangles.SAMPLES * rows[0], triangles.SAMPLES * rows[1])
