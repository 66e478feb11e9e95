"""Square maps below each other in one texture."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from OpenGL import GL

from nlens_video.core.layers import Float32


@dataclass(slots=True)
class StackedTexture:
    """Square maps below each other in one texture, and smaller ones below them.

    They are uploaded when they change.

    Attributes:
        stored: OpenGL's name of the texels' format in the texture.
        given: and of their format in the maps.
        sampled: name of the filter between texels.
    """

    stored: int
    given: int
    sampled: int
    _texture: int = 0
    _maps: Float32 | None = None

    def bind(self, unit: int, maps: Float32, below: Float32 | None = None) -> None:
        """Put maps on a texture unit.

        Args:
            unit: its number.
            maps: (K, side, side) or (K, side, side, C).
            below: the maps below them, as many and not as wide; they change when `maps` do.
        """
        GL.glActiveTexture(GL.GL_TEXTURE0 + unit)
        if not self._texture:
            self._texture = int(GL.glGenTextures(1))
        GL.glBindTexture(GL.GL_TEXTURE_2D, self._texture)
        if self._maps is not maps:
            self._upload(maps, below)
        GL.glActiveTexture(GL.GL_TEXTURE0)  # what else is bound must not take its place

    def _upload(self, maps: Float32, below: Float32 | None) -> None:
        self._maps = maps
        parts = [maps] if below is None else [maps, below]
        rows = [len(one) * one.shape[1] for one in parts]
        size = maps.shape[2], sum(rows)
        GL.glTexImage2D(GL.GL_TEXTURE_2D, 0, self.stored, *size, 0, self.given, GL.GL_FLOAT, None)
        for one, first, count in zip(parts, (0, rows[0]), rows, strict=False):
            texels = np.ascontiguousarray(one, dtype=np.float32)
            place = 0, first, one.shape[2], count
            GL.glTexSubImage2D(GL.GL_TEXTURE_2D, 0, *place, self.given, GL.GL_FLOAT, texels)
        for name in (GL.GL_TEXTURE_MIN_FILTER, GL.GL_TEXTURE_MAG_FILTER):
            GL.glTexParameteri(GL.GL_TEXTURE_2D, name, self.sampled)
        for name in (GL.GL_TEXTURE_WRAP_S, GL.GL_TEXTURE_WRAP_T):
            GL.glTexParameteri(GL.GL_TEXTURE_2D, name, GL.GL_CLAMP_TO_EDGE)

    def delete(self) -> None:
        """Free it."""
        if self._texture:
            GL.glDeleteTextures([self._texture])
        self._texture, self._maps = 0, None
