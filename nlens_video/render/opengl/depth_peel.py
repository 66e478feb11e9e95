"""What a second look behind the nearest surfaces needs on the GPU."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from OpenGL import GL

from nlens_video.core.layers import Float32
from nlens_video.render.opengl.framebuffer import FloatTarget


class BehindTarget:
    """A picture of its own, a texture of limits, and the question whether anything was drawn."""

    def __init__(self) -> None:
        self.target = FloatTarget()
        self._texture = 0
        self._query = 0

    def bind_limit(self, limit: Float32, unit: int) -> None:
        """Put the limits (height, width) on a texture unit."""
        if not self._texture:
            self._texture = int(GL.glGenTextures(1))
            self._query = int(np.ravel(GL.glGenQueries(1))[0])
        height, width = limit.shape
        GL.glActiveTexture(GL.GL_TEXTURE0 + unit)
        GL.glBindTexture(GL.GL_TEXTURE_2D, self._texture)
        GL.glTexImage2D(
            GL.GL_TEXTURE_2D, 0, GL.GL_R32F, width, height, 0, GL.GL_RED, GL.GL_FLOAT, limit
        )
        for name in (GL.GL_TEXTURE_MIN_FILTER, GL.GL_TEXTURE_MAG_FILTER):
            GL.glTexParameteri(GL.GL_TEXTURE_2D, name, GL.GL_NEAREST)

    def shows(self, draw: Callable[[], None]) -> bool:
        """Draw, and tell whether any sample was."""
        GL.glBeginQuery(GL.GL_ANY_SAMPLES_PASSED, self._query)
        draw()
        GL.glEndQuery(GL.GL_ANY_SAMPLES_PASSED)
        return bool(GL.glGetQueryObjectuiv(self._query, GL.GL_QUERY_RESULT))

    def delete(self) -> None:
        """Free all of it."""
        self.target.delete()
        if self._texture:
            GL.glDeleteTextures([self._texture])
            GL.glDeleteQueries(1, [self._query])
            self._texture = self._query = 0
