"""Headless OpenGL context (EGL), why none can be created, and the drawing back end on it.

Imported before pyrender and PyOpenGL, which read these variables once, on import.
"""

from __future__ import annotations

import ctypes
import os
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, suppress

from nlens_video.core.errors import NlensError
from nlens_video.core.layers import Float32
from nlens_video.render.base.drawer import BehindPicture, DrawerLostError, FrontSurfaces, ViewSetup
from nlens_video.scene.posed import PosedScene

os.environ.setdefault("PYOPENGL_PLATFORM", "egl")
os.environ.setdefault("PYGLET_HEADLESS", "1")

from OpenGL import EGL, GL, arrays
from OpenGL.error import Error as GlError
from pyrender.platforms import egl

from nlens_video.render.opengl.renderer import LinearRenderer

_CODES = {
    int(code): code.name
    for code in (
        GL.GL_INVALID_ENUM,
        GL.GL_INVALID_VALUE,
        GL.GL_INVALID_OPERATION,
        GL.GL_OUT_OF_MEMORY,
        GL.GL_CONTEXT_LOST,
        GL.GL_GUILTY_CONTEXT_RESET,
        GL.GL_INNOCENT_CONTEXT_RESET,
        GL.GL_UNKNOWN_CONTEXT_RESET,
        EGL.EGL_NOT_INITIALIZED,
        EGL.EGL_BAD_CONTEXT,
        EGL.EGL_BAD_DISPLAY,
        EGL.EGL_CONTEXT_LOST,
    )
}
_WITH_RESET_NOTIFICATION = (
    *(EGL.EGL_CONTEXT_MAJOR_VERSION, 4, EGL.EGL_CONTEXT_MINOR_VERSION, 1),
    *(EGL.EGL_CONTEXT_OPENGL_PROFILE_MASK, EGL.EGL_CONTEXT_OPENGL_CORE_PROFILE_BIT),
    *(EGL.EGL_CONTEXT_OPENGL_RESET_NOTIFICATION_STRATEGY, EGL.EGL_LOSE_CONTEXT_ON_RESET),
    EGL.EGL_NONE,
)
"""Attributes of a context that reports device resets (EGL 1.5, section 3.7.1).

Without the last pair drivers report none, and pixels read after a reset are undefined.
"""


class HeadlessPlatform(egl.EGLPlatform):  # type: ignore[misc]  # untyped base
    """pyrender's EGL platform, which several renderers of one process can use side by side."""

    _egl_display: object
    _egl_context: object

    def init_context(self) -> None:
        """Create a context, with reset notification if the driver can, and make it current."""
        super().init_context()
        try:
            notifying = EGL.eglCreateContext(
                self._egl_display, self._config(), EGL.EGL_NO_CONTEXT,
                arrays.GLintArray.asArray(_WITH_RESET_NOTIFICATION),
            )  # fmt: skip
        except GlError:
            return  # a driver that knows no resets: the plain one stays
        self.delete_context()
        self._egl_context = notifying
        self.make_current()

    def _config(self) -> object:
        """The frame buffer configuration of the context."""
        number, found = ctypes.c_int(), ctypes.c_long()
        EGL.eglQueryContext(
            self._egl_display, self._egl_context, EGL.EGL_CONFIG_ID, ctypes.byref(number)
        )
        configs = (EGL.EGLConfig * 1)()
        this_one = arrays.GLintArray.asArray([EGL.EGL_CONFIG_ID, number.value, EGL.EGL_NONE])
        EGL.eglChooseConfig(self._egl_display, this_one, configs, 1, found)
        return configs[0]

    def make_uncurrent(self) -> None:
        """Release the context from this thread."""
        EGL.eglMakeCurrent(
            self._egl_display, EGL.EGL_NO_SURFACE, EGL.EGL_NO_SURFACE, EGL.EGL_NO_CONTEXT
        )

    def delete_context(self) -> None:
        """Destroy the context, not the display: all renderers of a process share that."""
        if self._egl_context is not None:
            context, self._egl_context = self._egl_context, None
            with suppress(GlError):  # a lost one may not be there any more
                self.make_uncurrent()
                EGL.eglDestroyContext(self._egl_display, context)

    @contextmanager
    def at_work(self, what: str, advice: str) -> Iterator[None]:
        """The context current; what OpenGL refuses becomes one line: `what`, why, `advice`.

        Raises:
            NlensError: OpenGL refused; too large a texture or picture, a failed shader.
            DrawerLostError: the context is lost, or its memory does not suffice; what was drawn
                within is not to be used.
        """
        try:
            self.make_current()
        except (AssertionError, GlError) as error:
            raise DrawerLostError(_reason(error), again=True) from error
        try:
            yield
        except (GlError, RuntimeError) as error:
            if getattr(error, "err", None) == GL.GL_OUT_OF_MEMORY:
                raise DrawerLostError("its memory does not suffice", again=False) from error
            self._check_context()
            raise NlensError(f"OpenGL {what} ({_reason(error)}); {advice}") from error
        self._check_context()

    def _check_context(self) -> None:
        """Check the context: calls into a lost one silently do nothing.

        Raises:
            DrawerLostError: it is lost.
        """
        if _address(EGL.eglGetCurrentContext()) != _address(self._egl_context):
            raise DrawerLostError("the context is no longer current", again=True)
        status = GL.glGetGraphicsResetStatus() if GL.glGetGraphicsResetStatus else GL.GL_NO_ERROR
        if status != GL.GL_NO_ERROR:
            raise DrawerLostError(_CODES.get(int(status), f"{int(status):#x}"), again=True)


def _address(context: object) -> int | None:
    return ctypes.cast(context, ctypes.c_void_p).value  # type: ignore[arg-type]  # PyOpenGL's own pointer


def open_platform() -> HeadlessPlatform:
    """A new context, current on this thread; `EGL_DEVICE_ID` picks the device.

    Raises:
        RuntimeError: there is no EGL device that can render with OpenGL 4.1.
    """
    try:
        device = egl.get_device_by_index(int(os.environ.get("EGL_DEVICE_ID", "0")))
        platform = HeadlessPlatform(1, 1, device=device)
        platform.init_context()
    except (AssertionError, AttributeError, GlError, IndexError, ValueError) as error:
        raise RuntimeError(_reason(error)) from error
    return platform


def _reason(error: Exception) -> str:
    """An error on one line: PyOpenGL's own text is a page with all arguments."""
    code = getattr(error, "err", None)
    text = _CODES.get(code, f"{code:#x}") if isinstance(code, int) else str(error)
    return f"{type(error).__name__}: {' '.join(text.split())}"


def describe() -> str:
    """The renderer and version of the current context."""
    renderer, version = (GL.glGetString(name).decode() for name in (GL.GL_RENDERER, GL.GL_VERSION))
    return f"EGL, {renderer}, OpenGL {version}"


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
        self._platform = open_platform()
        try:
            advice = "export it with smaller textures and meshes"
            with self._platform.at_work("cannot hold the object", advice):
                self._renderer = LinearRenderer(posed)
        except BaseException:
            self._platform.delete_context()
            raise

    def draw(self, view: ViewSetup) -> tuple[Float32, Float32]:
        """See `Drawer`."""
        with self._drawing(view):
            return self._renderer.draw(view)

    def draw_behind(self, view: ViewSetup, front: FrontSurfaces) -> BehindPicture | None:
        """See `Drawer`."""
        with self._drawing(view):
            return self._renderer.draw_behind(view, front)

    def _drawing(self, view: ViewSetup) -> AbstractContextManager[None]:
        size = f"{view.box.width}x{view.box.height}"
        return self._platform.at_work(
            f"cannot draw a picture of {size} pixels", "use a smaller frame"
        )

    def close(self) -> None:
        """Free the GPU objects and the context; those of a lost one are gone already."""
        with (
            suppress(DrawerLostError),
            self._platform.at_work("cannot free its objects", "update the graphics driver"),
        ):
            self._renderer.delete()
        self._platform.delete_context()
