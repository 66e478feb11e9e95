"""Software renderer: a deferred rasteriser in compiled kernels, without a graphics driver.

Visibility first, then shading: each sample stores its nearest triangle, and each surface is shaded
once per pixel. Rows are independent, so any number of threads gives the same bits.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial

import numpy as np

from nlens_video.core.layers import Float32, ObjectLayer
from nlens_video.kernels.thread_pool import parallel_for, processors
from nlens_video.render.base.box_renderer import BoxRenderer
from nlens_video.render.base.drawer import BehindPicture, FrontSurfaces, ViewSetup, view_setup
from nlens_video.render.software.framebuffer import Framebuffer, Rows
from nlens_video.render.software.scene_buffers import SceneBuffers
from nlens_video.scene.camera import Camera
from nlens_video.scene.illumination import Illumination
from nlens_video.scene.posed import PosedScene
from nlens_video.scene.scene import Scene
from nlens_video.scene.scene_light import SceneLight

_BANDS = 3  # for each thread: some rows take longer than others


class Rasteriser:
    """A `Drawer` on the processor.

    Args:
        threads: maximum number of threads; default: one per processor. The picture does not
            depend on it.
    """

    def __init__(self, threads: int | None = None) -> None:
        self._threads = threads
        self._object: SceneBuffers | None = None

    def draw(self, view: ViewSetup) -> tuple[Float32, Float32]:
        """See `Drawer`."""
        picture = Framebuffer(self.moved(view.posed), view)
        self._run(picture, *picture.steps)
        return picture.rgba, picture.depth

    def draw_behind(self, view: ViewSetup, front: FrontSurfaces) -> BehindPicture | None:
        """See `Drawer`."""
        hidden = Framebuffer(self.moved(view.posed), view, behind=True)
        self._run(hidden, partial(hidden.see_behind, front.most_disparity()))
        if not hidden.shows_anything:
            return None
        self._run(hidden, hidden.light, hidden.measure)
        # The front picture is drawn again: keeping its samples would cost more memory than time.
        before = Framebuffer(self.moved(view.posed), view)
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
        threads: maximum number of threads; default: one per processor. The picture does not
            depend on it.
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
        """As `BoxRenderer.render_views`, each view on one thread, which also calls `use`.

        Threads that share the rows of one view would wait for each other after each pass.
        """
        if not cameras:
            return
        posed, lighting, origin = self._moment(time_s, plate_light, cameras[0])
        shown = self._drawer.moved(posed)

        def draw(at: int) -> None:
            view = view_setup(posed, lighting, cameras[at].about(origin), margin, nearest=nearest)
            if view is None:
                use(at, None)
                return
            picture = Framebuffer(shown, view)
            for step in picture.steps:
                step((0, view.box.height))
            use(at, ObjectLayer(box=view.box, rgba=picture.rgba, depth=picture.depth))

        parallel_for(draw, range(len(cameras)), self._threads)

    def _draw(self, view: ViewSetup) -> tuple[Float32, Float32]:
        return self._drawer.draw(view)

    def _draw_behind(self, view: ViewSetup, front: FrontSurfaces) -> BehindPicture | None:
        return self._drawer.draw_behind(view, front)

    def close(self) -> None:
        """Free what it holds; may be called again."""
        super().close()
        self._drawer.close()
