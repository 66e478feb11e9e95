"""The OpenGL context without a screen (EGL), and why there is none.

Imported before pyrender and PyOpenGL, which read these variables once, on import.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager

from nlens_video.errors import NlensError

os.environ.setdefault("PYOPENGL_PLATFORM", "egl")
os.environ.setdefault("PYGLET_HEADLESS", "1")

from OpenGL import EGL, GL
from OpenGL.error import Error as GlError
from pyrender.platforms import egl

_CODES = {
    int(code): code.name
    for code in (
        GL.GL_INVALID_ENUM,
        GL.GL_INVALID_VALUE,
        GL.GL_INVALID_OPERATION,
        GL.GL_OUT_OF_MEMORY,
    )
}


class HeadlessPlatform(egl.EGLPlatform):  # type: ignore[misc]  # untyped base
    """pyrender's EGL platform, which several renderers of one process can use side by side."""

    _egl_display: object
    _egl_context: object

    def make_uncurrent(self) -> None:
        """Release the context from this thread."""
        EGL.eglMakeCurrent(
            self._egl_display, EGL.EGL_NO_SURFACE, EGL.EGL_NO_SURFACE, EGL.EGL_NO_CONTEXT
        )

    def delete_context(self) -> None:
        """Destroy the context, not the display: all renderers of a process share that."""
        if self._egl_context is not None:
            self.make_uncurrent()
            EGL.eglDestroyContext(self._egl_display, self._egl_context)
            self._egl_context = None


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


@contextmanager
def refusals(what: str, advice: str) -> Iterator[None]:
    """Turn what OpenGL refuses into one line: `what`, the reason, `advice`.

    Raises:
        NlensError: OpenGL refused; too large a texture or picture, no memory, a failed shader.
    """
    try:
        yield
    except (GlError, RuntimeError) as error:
        raise NlensError(f"OpenGL {what} ({_reason(error)}); {advice}") from error


def _reason(error: Exception) -> str:
    """An error on one line: PyOpenGL's own text is a page with all arguments."""
    code = getattr(error, "err", None)
    text = _CODES.get(code, f"{code:#x}") if isinstance(code, int) else str(error)
    return f"{type(error).__name__}: {' '.join(text.split())}"


def describe() -> str:
    """The renderer and version of the current context."""
    renderer, version = (GL.glGetString(name).decode() for name in (GL.GL_RENDERER, GL.GL_VERSION))
    return f"EGL, {renderer}, OpenGL {version}"
