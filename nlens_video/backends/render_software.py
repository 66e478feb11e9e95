"""P's renderer without a graphics driver: a rasteriser of our own (`kernels`), any machine runs it.

Visibility first, then light: each sample finds the triangle that it shows, and each surface is
shaded once a pixel. Rows are shared among threads and do not depend on each other, so any number
of threads gives the same bits.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from nlens_video.backends.box_renderer import BoxRenderer, Sight, lens_of
from nlens_video.backends.lighting import Lighting
from nlens_video.backends.soft_object import SoftObject
from nlens_video.frames import Box, Float32
from nlens_video.kernels import alpha, deferred, nearest, raster, screen, triangles
from nlens_video.kernels.fragment import Int32, new_block
from nlens_video.kernels.pool import processors, share
from nlens_video.kernels.scratch import scratch
from nlens_video.scene.camera import Camera
from nlens_video.scene.gltf import Scene
from nlens_video.scene.materials import Material
from nlens_video.scene.mesh import Geometry
from nlens_video.scene.posed import PosedMesh, PosedScene
from nlens_video.scene.scene_light import SceneLight

_BANDS = 3  # for each thread: some rows take longer than others
Rows = tuple[int, int]


class SoftwareObjectRenderer(BoxRenderer):
    """Renders a scene's object on the box of the frame that it covers, on the processor.

    Args:
        scene: the object.
        light: what lights it; by default the file's lights, or a plausible light.
        threads: how many threads share the rows at most; default: one a processor. The picture
            does not depend on it.
    """

    name = "software rasteriser"

    def __init__(
        self, scene: Scene, light: SceneLight | None = None, threads: int | None = None
    ) -> None:
        super().__init__(scene, light)
        self._threads = threads
        self._object: SoftObject | None = None

    def _draw(self, posed: PosedScene, sight: Sight, lighting: Lighting) -> tuple[Float32, Float32]:
        if self._object is None:
            self._object = SoftObject(posed)
        self._object.move(posed)
        picture = _Picture.of(self._object, sight, lighting)
        count = self._threads or processors()
        height = sight.box.height
        edges = np.linspace(0, height, min(height, _BANDS * count) + 1).astype(int).tolist()
        bands = list(zip(edges[:-1], edges[1:], strict=True))
        for step in picture.steps:
            share(step, bands, count)
        return picture.rgba, picture.depth

    def close(self) -> None:
        """Free what it holds; may be called again."""
        super().close()
        self._object = None


def make_ready() -> None:
    """Compile the kernels that any object needs, or load them from numba's cache."""
    corners = np.array([[0, 0, -1], [1, 0, -1], [0, 1, -1]], np.float32)
    geometry = Geometry(
        name="", positions=corners, normals=corners, faces=np.array([[0, 1, 2]], np.int32),
        uv=np.zeros((3, 4), np.float32), colors=None, material=Material(double_sided=True),
        flat=False, joints=None, weights=None, targets=None, target_normals=None,
    )  # fmt: skip
    posed = PosedScene(0.0, (PosedMesh(geometry, corners, corners, mirrored=False),), ())
    box = Box(0, 0, 8, 8)
    camera = Camera(
        world_from_camera=np.eye(4), fx=8, fy=8, cx=0, cy=8, width=box.width, height=box.height
    )
    sight = Sight(camera=camera, box=box, near=0.5, far=2.0, nearest=False)
    shown = SoftObject(posed)
    shown.move(posed)
    picture = _Picture.of(shown, sight, Lighting((), None))
    for step in picture.steps:
        step((0, box.height))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Picture:
    """One picture being drawn: all that its steps read and write."""

    shape: triangles.Shape
    spans: Int32
    opaque: Int32
    masked: Int32
    blended: Int32
    scene: deferred.Scene
    disparity: Float32
    ids: Int32
    passed: Float32
    front: Float32
    rgba: Float32
    depth: Float32
    least: float

    @classmethod
    def of(cls, shown: SoftObject, sight: Sight, lighting: Lighting) -> _Picture:
        """Project the vertices and find the triangles to be drawn."""
        lens = lens_of(sight.camera, sight)
        numbers = lens.numbers()
        width, height = lens.width, lens.height
        count = len(shown.faces)
        points = scratch("points", (len(shown.positions), 3), np.float64)
        spans = scratch("spans", (count, 2), np.int32)
        planes = scratch("planes", (count, triangles.PLANES))
        kept = scratch("kept", (count,), np.int32)
        lines = triangles.SAMPLES * height
        screen.project(shown.positions, numbers, points)
        shape = (points, shown.positions, shown.faces, numbers)
        found = triangles.set_up(shape, shown.sides, width, lines, spans, planes, kept)
        opaque, masked, blended = shown.by_alpha(kept[:found], lens)
        ambient = lighting.ambient_rows()[: 0 if lighting.ambient is None else 9]
        lamps = lighting.lamp_rows(lens.eye), lighting.suns, ambient
        pinhole = np.array([*lens.axes.ravel(), lens.fx, lens.fy, lens.cx, lens.cy], np.float32)
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
            least=1.0 / sight.far,
        )

    @property
    def steps(self) -> tuple[Callable[[Rows], None], ...]:
        """What is done to all rows, one after the other."""
        return (self.see, self.blend, self.shade) if len(self.blended) else (self.see, self.shade)

    def see(self, rows: Rows) -> None:
        """Find what the samples of rows [first, last) show, and clear the picture."""
        first, last = (triangles.SAMPLES * row for row in rows)
        self.rgba[rows[0] : rows[1]] = 0.0
        self.disparity[first:last] = 0.0
        self.ids[first:last] = raster.NOTHING
        width = self.rgba.shape[1]
        raster.fill(
            self.opaque, first, last - 1, self.shape, self.spans, width, self.disparity, self.ids
        )
        if len(self.masked):
            alpha.cut_out(
                self.masked, rows, width, (self.shape, self.spans), *self.scene[:2],
                self.disparity, self.ids,
            )  # fmt: skip

    def blend(self, rows: Rows) -> None:
        """Light and depth of see-through surfaces on rows [first, last)."""
        here = slice(*(triangles.SAMPLES * row for row in rows))
        self.passed[here] = 1.0
        self.front[here] = self.disparity[here]
        alpha.blend(
            self.blended, rows, self.rgba.shape[1], (self.shape, self.spans), self.scene,
            self.disparity, self.passed, self.front, self.rgba.reshape(-1, 4), new_block(),
        )  # fmt: skip

    def shade(self, rows: Rows) -> None:
        """Light of opaque surfaces, and depth, on rows [first, last)."""
        deferred.shade_rows(
            *rows, self.rgba.shape[1], self.ids, self.passed, self.scene,
            self.rgba.reshape(-1, 4), new_block(),
        )  # fmt: skip
        front = self.front if len(self.blended) else self.disparity
        nearest.resolve_depth(front, *rows, self.least, self.depth)
