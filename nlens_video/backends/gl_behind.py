"""What a second look behind the nearest surfaces needs on the GPU."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from OpenGL import GL

from nlens_video.backends.gl_target import FloatTarget
from nlens_video.frames import Float32

_ALL = 2.0  # window depth beyond everything


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Front:
    """The nearest surfaces that a picture shows, as far as another picture shows them too.

    Attributes:
        depth: of them (height, width), +inf where nothing is [scene unit].
        disparity_step: how much less disparity what lies behind them has, > 0 [1 / scene unit].
        corner: column and row of the other picture's first pixel in this one [px].
    """

    depth: Float32
    disparity_step: float
    corner: tuple[int, int]

    def step(self, near: float, far: float) -> float:
        """The step as window depth, which is affine in disparity."""
        return self.disparity_step * near * far / (far - near)

    def limit(self, near: float, far: float) -> Float32:
        """Window depth (height, width) from which a surface lies behind; beyond all where none."""
        there = np.isfinite(self.depth)
        disparity = np.divide(1.0, self.depth, where=there, out=np.zeros(there.shape))
        window = (1.0 - near * disparity) * (far / (far - near)) + self.step(near, far)
        return np.where(there, window, _ALL).astype(np.float32)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BehindPicture:
    """What a picture's nearest surface hides.

    Attributes:
        rgba: premultiplied linear colour and alpha (height, width, 4).
        depth: along the optical axis (height, width), +inf where nothing is [scene unit].
        front_rgba: what the nearest surface alone gives to each pixel (height, width, 4).
    """

    rgba: Float32
    depth: Float32
    front_rgba: Float32


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
