"""OpenGL back end: one context and the object's GPU resources."""

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
        self, posed: PosedScene, setup: ViewSetup, lighting: Lighting
    ) -> tuple[Float32, Float32]:
        """See `Drawer`."""
        with self._drawing(setup):
            return self._renderer.draw(posed, _view(setup), lighting, nearest=setup.nearest)

    def draw_behind(
        self, posed: PosedScene, setup: ViewSetup, lighting: Lighting, front: FrontSurfaces
    ) -> BehindPicture | None:
        """See `Drawer`."""
        with self._drawing(setup):
            return self._renderer.draw_behind(posed, _view(setup), lighting, front)

    @contextmanager
    def _drawing(self, setup: ViewSetup) -> Iterator[None]:
        size = f"{setup.box.width}x{setup.box.height}"
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


def _view(setup: ViewSetup) -> GlView:
    return GlView(
        camera_from_world=setup.camera.camera_from_world,
        eye=setup.camera.world_from_camera[:3, 3],
        clip_from_camera=_projection(setup),
        near=setup.near,
        far=setup.far,
        width=setup.box.width,
        height=setup.box.height,
    )


def _projection(setup: ViewSetup) -> Float64:
    """Clip space of a box of the frame (4, 4); row 0 of the box lies at clip y = -1."""
    camera, box, near, far = setup.camera, setup.box, setup.near, setup.far
    matrix = np.zeros((4, 4))
    matrix[0, 0] = 2.0 * camera.fx / box.width
    matrix[0, 2] = 1.0 - 2.0 * (camera.cx - box.x0) / box.width
    matrix[1, 1] = -2.0 * camera.fy / box.height
    matrix[1, 2] = 1.0 - 2.0 * (camera.cy - box.y0) / box.height
    matrix[2, 2] = -(far + near) / (far - near)
    matrix[2, 3] = -2.0 * far * near / (far - near)
    matrix[3, 2] = -1.0
    return matrix
