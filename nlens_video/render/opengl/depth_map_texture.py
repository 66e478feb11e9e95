"""Depth of the object as its lights see it, as a texture."""

from __future__ import annotations

from OpenGL import GL

from nlens_video.core.layers import Float32


class DepthMapTexture:
    """`LightDepth.nearness` below each other in one texture; uploaded when it changes."""

    def __init__(self) -> None:
        self._texture = 0
        self._nearness: Float32 | None = None

    def bind(self, nearness: Float32, unit: int) -> None:
        """Put maps (K, side, side) on a texture unit."""
        GL.glActiveTexture(GL.GL_TEXTURE0 + unit)
        if not self._texture:
            self._texture = int(GL.glGenTextures(1))
        GL.glBindTexture(GL.GL_TEXTURE_2D, self._texture)
        if self._nearness is not nearness:
            self._upload(nearness)
        GL.glActiveTexture(GL.GL_TEXTURE0)  # what else is bound must not take its place

    def _upload(self, nearness: Float32) -> None:
        self._nearness = nearness
        count, side = nearness.shape[:2]
        GL.glTexImage2D(
            GL.GL_TEXTURE_2D, 0, GL.GL_R32F, side, count * side, 0, GL.GL_RED, GL.GL_FLOAT, nearness
        )
        for name in (GL.GL_TEXTURE_MIN_FILTER, GL.GL_TEXTURE_MAG_FILTER):
            GL.glTexParameteri(GL.GL_TEXTURE_2D, name, GL.GL_NEAREST)

    def delete(self) -> None:
        """Free it."""
        if self._texture:
            GL.glDeleteTextures([self._texture])
        self._texture, self._nearness = 0, None
