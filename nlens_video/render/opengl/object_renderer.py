"""OpenGL renderer: the object through pyrender, headless, in scene-linear light.

OpenGL is loaded with the first picture, so that a machine without it gets a clear error, and only
if something must be rendered. A driver may take the context away during a run: the picture is then
drawn again in a new context, or, if that fails too, by the software rasteriser from then on.
"""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import TypeVar

from nlens_video.core.errors import NlensError
from nlens_video.core.layers import Float32
from nlens_video.render.base.box_renderer import BoxRenderer
from nlens_video.render.base.drawer import (
    BehindPicture,
    Drawer,
    DrawerLostError,
    FrontSurfaces,
    ViewSetup,
)
from nlens_video.scene.posed import PosedScene
from nlens_video.scene.scene import Scene
from nlens_video.scene.scene_light import SceneLight

Drawn = TypeVar("Drawn")


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
        self._drawer: Drawer | None = None
        self._drew_front: Drawer | None = None  # the last picture that was not one from behind
        self._lost = False
        self._thread = 0

    def _draw(self, view: ViewSetup) -> tuple[Float32, Float32]:
        def picture(drawer: Drawer) -> tuple[Float32, Float32]:
            drawn = drawer.draw(view)
            self._drew_front = drawer
            return drawn

        return self._with_recovery(view.posed, picture)

    def _draw_behind(self, view: ViewSetup, front: FrontSurfaces) -> BehindPicture | None:
        def picture(drawer: Drawer) -> BehindPicture | None:
            if self._drew_front is not drawer and self._on_target is not None:
                drawer.draw(self._on_target)  # went with the context it was in
                self._drew_front = drawer
            return drawer.draw_behind(view, front)

        return self._with_recovery(view.posed, picture)

    def _with_recovery(self, posed: PosedScene, picture: Callable[[Drawer], Drawn]) -> Drawn:
        while True:
            try:
                if self._drawer is None:
                    self._thread = threading.get_ident()
                    self._drawer = _start(posed)
                return picture(self._drawer)
            except DrawerLostError as lost:
                self._replace(posed, lost)

    def _replace(self, posed: PosedScene, lost: DrawerLostError) -> None:
        """Replace a lost back end: by OpenGL again, once, then by the software rasteriser."""
        when = f"at {posed.time_s:.2f} s OpenGL was lost ({lost})"
        broken, self._drawer = self._drawer, None
        if broken is not None:
            broken.close()
        if lost.again and not self._lost:
            self._lost = True
            try:
                self._drawer = _start(posed)
            except (NlensError, DrawerLostError):
                pass
            else:
                self.notes.append(f"{when}; a new context draws on from that picture")
                return
        from nlens_video.render.software.renderer import Rasteriser

        self._drawer = Rasteriser()
        self.notes.append(f"{when}; the software rasteriser draws on from that picture")

    def _check(self) -> None:
        super()._check()
        if self._drawer is not None and self._thread != threading.get_ident():
            raise NlensError("the renderer belongs to the thread that rendered first; use it there")

    def close(self) -> None:
        """Free the GPU objects and the context; may be called again."""
        super().close()
        drawer, self._drawer = self._drawer, None
        self._drew_front = None
        if drawer is not None:
            drawer.close()


def _start(posed: PosedScene) -> Drawer:
    try:
        from nlens_video.render.opengl.egl_platform import GlDrawer

        return GlDrawer(posed)
    except (ImportError, AttributeError, OSError, RuntimeError) as error:
        # PyOpenGL and pyglet report a missing library as an attribute of None.
        raise NlensError(
            f"OpenGL cannot start without a screen ({error}); "
            "install it: apt-get install libegl1 libgl1"
        ) from error
