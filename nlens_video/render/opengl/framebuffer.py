"""Framebuffers on the GPU: half-float colour, float depth, four samples a pixel; depth peeling."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from OpenGL import GL

from nlens_video.core.layers import Float32

_SAMPLES = 4
_STEP = 64


class FloatTarget:
    """A multisampled framebuffer and what it is resolved into; it grows and never shrinks."""

    def __init__(self) -> None:
        self._size = (0, 0)
        self._framebuffers: list[int] = []
        self._textures: list[int] = []

    def bind(self, width: int, height: int) -> None:
        """Draw into the lower left `width` by `height` pixels, cleared [px]."""
        if width > self._size[0] or height > self._size[1]:
            self._create(max(width, self._size[0]), max(height, self._size[1]))
        GL.glBindFramebuffer(GL.GL_FRAMEBUFFER, self._framebuffers[0])
        GL.glViewport(0, 0, width, height)
        # llvmpipe clears a whole target by its bins; a part of one it draws, three times slower
        part = 2 * width * height < self._size[0] * self._size[1]
        GL.glScissor(0, 0, width, height)
        (GL.glEnable if part else GL.glDisable)(GL.GL_SCISSOR_TEST)
        GL.glClearColor(0.0, 0.0, 0.0, 0.0)
        GL.glClear(GL.GL_COLOR_BUFFER_BIT | GL.GL_DEPTH_BUFFER_BIT)
        GL.glEnable(GL.GL_SCISSOR_TEST)

    def bind_resolved(self, samples: FloatTarget | None = None) -> None:
        """Draw into the resolved picture, with samples on texture units 0 and 1.

        Args:
            samples: whose samples they are; its own by default.
        """
        held = (samples or self)._textures
        GL.glBindFramebuffer(GL.GL_FRAMEBUFFER, self._framebuffers[1])
        for unit in range(2):
            GL.glActiveTexture(GL.GL_TEXTURE0 + unit)
            GL.glBindTexture(GL.GL_TEXTURE_2D_MULTISAMPLE, held[unit])

    def read(self, width: int, height: int) -> tuple[Float32, Float32]:
        """The resolved colour (height, width, 4) and depth (height, width)."""
        GL.glBindFramebuffer(GL.GL_READ_FRAMEBUFFER, self._framebuffers[1])
        rgba = np.empty((height, width, 4), np.float32)
        depth = np.empty((height, width), np.float32)
        GL.glReadBuffer(GL.GL_COLOR_ATTACHMENT0)
        GL.glReadPixels(0, 0, width, height, GL.GL_RGBA, GL.GL_FLOAT, rgba)
        GL.glReadBuffer(GL.GL_COLOR_ATTACHMENT1)
        GL.glReadPixels(0, 0, width, height, GL.GL_RED, GL.GL_FLOAT, depth)
        return rgba, depth

    def delete(self) -> None:
        """Free all of it."""
        if self._framebuffers:
            GL.glDeleteFramebuffers(len(self._framebuffers), self._framebuffers)
            GL.glDeleteTextures(self._textures)
        self._framebuffers, self._textures, self._size = [], [], (0, 0)

    def _create(self, width: int, height: int) -> None:
        self.delete()
        width, height = -(-width // _STEP) * _STEP, -(-height // _STEP) * _STEP
        self._framebuffers = [int(name) for name in GL.glGenFramebuffers(2)]
        self._textures = [int(name) for name in GL.glGenTextures(4)]
        samples, resolved = self._framebuffers
        GL.glBindFramebuffer(GL.GL_FRAMEBUFFER, samples)
        for texture, stored, attachment in (
            (self._textures[0], GL.GL_RGBA16F, GL.GL_COLOR_ATTACHMENT0),
            (self._textures[1], GL.GL_DEPTH_COMPONENT32F, GL.GL_DEPTH_ATTACHMENT),
        ):
            kind = GL.GL_TEXTURE_2D_MULTISAMPLE
            GL.glBindTexture(kind, texture)
            GL.glTexImage2DMultisample(kind, _SAMPLES, stored, width, height, GL.GL_TRUE)
            GL.glFramebufferTexture2D(GL.GL_FRAMEBUFFER, attachment, kind, texture, 0)
        _check()
        GL.glBindFramebuffer(GL.GL_FRAMEBUFFER, resolved)
        for texture, stored, attachment in (
            (self._textures[2], GL.GL_RGBA32F, GL.GL_COLOR_ATTACHMENT0),
            (self._textures[3], GL.GL_R32F, GL.GL_COLOR_ATTACHMENT1),
        ):
            GL.glBindTexture(GL.GL_TEXTURE_2D, texture)
            GL.glTexStorage2D(GL.GL_TEXTURE_2D, 1, stored, width, height)
            GL.glFramebufferTexture2D(GL.GL_FRAMEBUFFER, attachment, GL.GL_TEXTURE_2D, texture, 0)
        GL.glDrawBuffers(2, [GL.GL_COLOR_ATTACHMENT0, GL.GL_COLOR_ATTACHMENT1])
        _check()
        self._size = (width, height)


def _check() -> None:
    status = GL.glCheckFramebufferStatus(GL.GL_FRAMEBUFFER)
    if status != GL.GL_FRAMEBUFFER_COMPLETE:
        raise RuntimeError(f"OpenGL refuses a float framebuffer with four samples ({status:#x})")


class BehindTarget:
    """Depth-peeling target: a framebuffer, a texture of depth limits, and an occlusion query."""

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
        """Draw; whether any sample passed (occlusion query)."""
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
