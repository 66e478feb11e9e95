"""The object drawn with OpenGL: a context of its own, and what is in it."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from nlens_video.core.layers import Float32, Float64
from nlens_video.render.base.box_renderer import ViewSetup
from nlens_video.render.base.drawer import DrawerLostError
from nlens_video.render.base.peel_layer import BehindPicture, FrontSurfaces
from nlens_video.render.base.shader_inputs import Lighting
from nlens_video.render.opengl.egl_platform import HeadlessPlatform, open_platform
from nlens_video.render.opengl.renderer import GlView, LinearRenderer
from nlens_video.scene.posed import PosedScene


class GlDrawer:
    """A `Drawer` on OpenGL; for one thread only, the one that makes it.

    Args:
        posed: the object, at any moment.

    Raises:
        RuntimeError: OpenGL cannot start.
        NlensError: it cannot hold the object.
        DrawerLostError: its memory does not suffice.
    """

    def __init__(self, posed: PosedScene) -> None:
        self._platform: HeadlessPlatform = open_platform()
        try:
            advice = "export it with smaller textures and meshes"
            with self._platform.at_work("cannot hold the object", advice):
                self._renderer = LinearRenderer(posed)
        except BaseException:
            self._platform.delete_context()
            raise

    def draw(
        self, posed: PosedScene, sight: ViewSetup, lighting: Lighting
    ) -> tuple[Float32, Float32]:
        """The picture; see `Drawer`."""
        with self._drawing(sight):
            return self._renderer.draw(posed, _view(sight), lighting, nearest=sight.nearest)

    def draw_behind(
        self, posed: PosedScene, sight: ViewSetup, lighting: Lighting, front: FrontSurfaces
    ) -> BehindPicture | None:
        """What it hides; see `Drawer`."""
        with self._drawing(sight):
            return self._renderer.draw_behind(posed, _view(sight), lighting, front)

    @contextmanager
    def _drawing(self, sight: ViewSetup) -> Iterator[None]:
        size = f"{sight.box.width}x{sight.box.height}"
        with self._platform.at_work(
            f"cannot draw a picture of {size} pixels", "use a smaller frame"
        ):
            yield

    def close(self) -> None:
        """Free the GPU objects and the context; those of a lost one are gone already."""
        with (
            contextlib.suppress(DrawerLostError),
            self._platform.at_work("cannot free its objects", "update the graphics driver"),
        ):
            self._renderer.delete()
        self._platform.delete_context()


def _view(sight: ViewSetup) -> GlView:
    return GlView(
        camera_from_world=sight.camera.camera_from_world,
        eye=sight.camera.world_from_camera[:3, 3],
        clip_from_camera=_projection(sight),
        near=sight.near,
        far=sight.far,
        width=sight.box.width,
        height=sight.box.height,
    )


def _projection(sight: ViewSetup) -> Float64:
    """Clip space of a box of the frame (4, 4); row 0 of the box lies at clip y = -1."""
    camera, box, near, far = sight.camera, sight.box, sight.near, sight.far
    matrix = np.zeros((4, 4))
    matrix[0, 0] = 2.0 * camera.fx / box.width
    matrix[0, 2] = 1.0 - 2.0 * (camera.cx - box.x0) / box.width
    matrix[1, 1] = -2.0 * camera.fy / box.height
    matrix[1, 2] = 1.0 - 2.0 * (camera.cy - box.y0) / box.height
    matrix[2, 2] = -(far + near) / (far - near)
    matrix[2, 3] = -2.0 * far * near / (far - near)
    matrix[3, 2] = -1.0
    return matrix
