"""The light from around as smooth surfaces mirror it, as a texture."""

from __future__ import annotations

import numpy as np
from OpenGL import GL

from nlens_video.core.layers import Float32


class SurroundTexture:
    """`Surround.levels` below each other in one texture; uploaded when they change."""

    def __init__(self) -> None:
        self._texture = 0
        self._levels: Float32 | None = None

    def bind(self, levels: Float32, unit: int) -> None:
        """Put maps (levels, side, side, 4) on a texture unit."""
        GL.glActiveTexture(GL.GL_TEXTURE0 + unit)
        if not self._texture:
            self._texture = int(GL.glGenTextures(1))
        GL.glBindTexture(GL.GL_TEXTURE_2D, self._texture)
        if self._levels is not levels:
            self._upload(levels)
        GL.glActiveTexture(GL.GL_TEXTURE0)  # what else is bound must not take its place

    def _upload(self, levels: Float32) -> None:
        self._levels = levels
        count, side = levels.shape[:2]
        pixels = np.ascontiguousarray(levels, dtype=np.float32)
        GL.glTexImage2D(
            GL.GL_TEXTURE_2D, 0, GL.GL_RGBA32F, side, count * side, 0, GL.GL_RGBA, GL.GL_FLOAT,
            pixels,
        )  # fmt: skip
        for name in (GL.GL_TEXTURE_MIN_FILTER, GL.GL_TEXTURE_MAG_FILTER):
            GL.glTexParameteri(GL.GL_TEXTURE_2D, name, GL.GL_LINEAR)
        for name in (GL.GL_TEXTURE_WRAP_S, GL.GL_TEXTURE_WRAP_T):
            GL.glTexParameteri(GL.GL_TEXTURE_2D, name, GL.GL_CLAMP_TO_EDGE)

    def delete(self) -> None:
        """Free it."""
        if self._texture:
            GL.glDeleteTextures([self._texture])
        self._texture, self._levels = 0, None
