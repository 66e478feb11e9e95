"""P's renderer: the object through pyrender, without a screen, in scene-linear light.

OpenGL is loaded when the first picture is asked for, so that a machine without it gets one clear
line, and only if something must be rendered.
"""

from __future__ import annotations

import threading
from typing import TYPE_CHECKING

import numpy as np

from nlens_video.backends.behind import BehindPicture, Front
from nlens_video.backends.box_renderer import BoxRenderer, Sight
from nlens_video.backends.lighting import Lighting
from nlens_video.errors import NlensError
from nlens_video.frames import Float32, Float64
from nlens_video.scene.gltf import Scene
from nlens_video.scene.posed import PosedScene
from nlens_video.scene.scene_light import SceneLight

if TYPE_CHECKING:
    from nlens_video.backends.gl_platform import HeadlessPlatform
    from nlens_video.backends.gl_renderer import LinearRenderer, View


class PyrenderObjectRenderer(BoxRenderer):
    """Renders a scene's object on the box of the frame that it covers, with OpenGL.

    The OpenGL context belongs to the thread that renders first; call `close` there.

    Args:
        scene: the object.
        light: what lights it; by default the file's lights, or a plausible light.
    """

    name = "pyrender, headless OpenGL"

    def __init__(self, scene: Scene, light: SceneLight | None = None) -> None:
        super().__init__(scene, light)
        self._platform: HeadlessPlatform | None = None
        self._renderer: LinearRenderer | None = None
        self._thread = 0

    def _draw(self, posed: PosedScene, sight: Sight, lighting: Lighting) -> tuple[Float32, Float32]:
        renderer = self._open(posed)
        from nlens_video.backends.gl_platform import refusals

        with refusals(*_refusal(sight)):
            return renderer.draw(posed, _view(sight), lighting, nearest=sight.nearest)

    def _draw_behind(
        self, posed: PosedScene, sight: Sight, lighting: Lighting, front: Front
    ) -> BehindPicture | None:
        renderer = self._open(posed)
        from nlens_video.backends.gl_platform import refusals

        with refusals(*_refusal(sight)):
            return renderer.draw_behind(posed, _view(sight), lighting, front)

    def _open(self, posed: PosedScene) -> LinearRenderer:
        if self._renderer is None or self._platform is None:
            self._thread = threading.get_ident()
            self._platform, self._renderer = _start(posed)
        self._platform.make_current()
        return self._renderer

    def _check(self) -> None:
        super()._check()
        if self._renderer is not None and self._thread != threading.get_ident():
            raise NlensError("the renderer belongs to the thread that rendered first; use it there")

    def close(self) -> None:
        """Free the GPU objects and the context; may be called again."""
        super().close()
        renderer, platform = self._renderer, self._platform
        self._renderer = self._platform = None
        if renderer is not None and platform is not None:
            platform.make_current()
            renderer.delete()
            platform.delete_context()


def _start(posed: PosedScene) -> tuple[HeadlessPlatform, LinearRenderer]:
    try:
        from nlens_video.backends.gl_platform import open_platform, refusals
        from nlens_video.backends.gl_renderer import LinearRenderer

        platform = open_platform()
    except (ImportError, AttributeError, OSError, RuntimeError) as error:
        # PyOpenGL and pyglet report a missing library as an attribute of None.
        raise NlensError(
            f"OpenGL cannot start without a screen ({error}); "
            "install it: apt-get install libegl1 libgl1"
        ) from error
    try:
        with refusals("cannot hold the object", "export it with smaller textures and meshes"):
            return platform, LinearRenderer(posed)
    except BaseException:
        platform.delete_context()
        raise


def _refusal(sight: Sight) -> tuple[str, str]:
    """What to say where OpenGL refuses a picture."""
    size = f"{sight.box.width}x{sight.box.height}"
    return f"cannot draw a picture of {size} pixels", "use a smaller frame"


def _view(sight: Sight) -> View:
    from nlens_video.backends.gl_renderer import View

    return View(
        camera_from_world=sight.camera.camera_from_world,
        eye=sight.camera.world_from_camera[:3, 3],
        clip_from_camera=_projection(sight),
        near=sight.near,
        far=sight.far,
        width=sight.box.width,
        height=sight.box.height,
    )


def _projection(sight: Sight) -> Float64:
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
