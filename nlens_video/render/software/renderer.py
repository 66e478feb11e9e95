"""P's renderer without a graphics driver: a rasteriser of our own (`kernels`), any machine runs it.

Visibility first, then light: each sample finds the triangle that it shows, and each surface is
shaded once a pixel. Rows are shared among threads and do not depend on each other, so any number
of threads gives the same bits.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from nlens_video.core.layers import Box, Float32, ObjectLayer
from nlens_video.kernels.thread_pool import parallel_for, processors
from nlens_video.render.base.box_renderer import BoxRenderer, ViewSetup, view_setup
from nlens_video.render.base.peel_layer import BehindPicture, FrontSurfaces
from nlens_video.render.base.shader_inputs import Lighting
from nlens_video.render.software.framebuffer import Framebuffer, Rows
from nlens_video.render.software.scene_buffers import SceneBuffers
from nlens_video.scene.camera import Camera
from nlens_video.scene.gltf.materials import Material
from nlens_video.scene.gltf.meshes import Geometry
from nlens_video.scene.illumination import Illumination, SceneLight
from nlens_video.scene.posed import PosedMesh, PosedScene
from nlens_video.scene.scene import Scene

_BANDS = 3  # for each thread: some rows take longer than others


class Rasteriser:
    """A `Drawer` on the processor.

    Args:
        threads: how many threads share the rows at most; default: one a processor. The picture
            does not depend on it.
    """

    def __init__(self, threads: int | None = None) -> None:
        self._threads = threads
        self._object: SceneBuffers | None = None

    def draw(
        self, posed: PosedScene, sight: ViewSetup, lighting: Lighting
    ) -> tuple[Float32, Float32]:
        """The picture; see `Drawer`."""
        picture = Framebuffer.of(self.moved(posed), sight, lighting)
        self._run(picture, *picture.steps)
        return picture.rgba, picture.depth

    def draw_behind(
        self, posed: PosedScene, sight: ViewSetup, lighting: Lighting, front: FrontSurfaces
    ) -> BehindPicture | None:
        """What it hides; see `Drawer`."""
        hidden = Framebuffer.of(self.moved(posed), sight, lighting, behind=True)
        self._run(hidden, partial(hidden.see_behind, front.most_disparity()))
        if not hidden.shows_anything:
            return None
        self._run(hidden, hidden.light, hidden.measure)
        # The picture before is drawn once more: samples take more memory than they take time.
        before = Framebuffer.of(self.moved(posed), sight, lighting)
        blend = (before.blend,) if len(before.blended) else ()
        self._run(before, before.see, *blend)
        before.keep_nearest(front.disparity_step)
        self._run(before, *blend, before.light)
        return BehindPicture(rgba=hidden.rgba, depth=hidden.depth, front_rgba=before.rgba)

    def moved(self, posed: PosedScene) -> SceneBuffers:
        """The object as it is drawn, at another moment."""
        if self._object is None:
            self._object = SceneBuffers(posed)
        self._object.move(posed)
        return self._object

    def _run(self, picture: Framebuffer, *steps: Callable[[Rows], None]) -> None:
        count = self._threads or processors()
        height = len(picture.rgba)
        edges = np.linspace(0, height, min(height, _BANDS * count) + 1).astype(int).tolist()
        bands = list(zip(edges[:-1], edges[1:], strict=True))
        for step in steps:
            parallel_for(step, bands, count)

    def close(self) -> None:
        """Free what it holds; may be called again."""
        self._object = None


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
        self._drawer = Rasteriser(threads)

    def render_views(
        self,
        time_s: float,
        cameras: Sequence[Camera],
        margin: int,
        use: Callable[[int, ObjectLayer | None], None],
        *,
        nearest: bool = False,
        plate_light: Illumination | None = None,
    ) -> None:
        """Draw the object from several points, each view on one thread, and wait for all.

        Threads that share a view's rows would wait for each other at each step of it.

        Args:
            time_s: time of the animation [s].
            cameras: as for `render`.
            margin: likewise.
            use: gets each camera's number and layer, on the thread that has drawn it; views are
                begun in order.
            nearest: as for `render`.
            plate_light: likewise.

        Raises:
            As `render`, and what `use` raises.
        """
        posed, lighting = self._moment(time_s, plate_light)
        shown = self._drawer.moved(posed)

        def draw(at: int) -> None:
            sight = view_setup(posed, cameras[at], margin, nearest=nearest)
            if sight is None:
                use(at, None)
                return
            picture = Framebuffer.of(shown, sight, lighting)
            for step in picture.steps:
                step((0, sight.box.height))
            use(at, ObjectLayer(box=sight.box, rgba=picture.rgba, depth=picture.depth))

        parallel_for(draw, range(len(cameras)), self._threads)

    def _draw(
        self, posed: PosedScene, sight: ViewSetup, lighting: Lighting
    ) -> tuple[Float32, Float32]:
        return self._drawer.draw(posed, sight, lighting)

    def _draw_behind(
        self, posed: PosedScene, sight: ViewSetup, lighting: Lighting, front: FrontSurfaces
    ) -> BehindPicture | None:
        return self._drawer.draw_behind(posed, sight, lighting, front)

    def warm_up(self) -> None:
        """Compile the kernels that any object needs, or load them from numba's cache."""
        _compile_kernels()

    def close(self) -> None:
        """Free what it holds; may be called again."""
        super().close()
        self._drawer.close()


def _compile_kernels() -> None:
    """Draw one triangle."""
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
    sight = ViewSetup(camera=camera, box=box, near=0.5, far=2.0, nearest=False)
    shown = SceneBuffers(posed)
    shown.move(posed)
    picture = Framebuffer.of(shown, sight, Lighting((), None))
    for step in picture.steps:
        step((0, box.height))
