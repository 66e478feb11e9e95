"""Objects on the GPU: the scene's materials and meshes, and framebuffers.

The scene is uploaded once, vertices are updated in place. Framebuffers hold half-float colour and
float depth, four samples a pixel.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable

import numpy as np
import pyrender
from OpenGL import GL

from nlens_video.core.layers import Float32, Float64
from nlens_video.render.base.shader_inputs import SLOTS, material_params, texture_uses
from nlens_video.render.opengl.gpu_textures import GpuTexture
from nlens_video.scene.gltf.materials import Material
from nlens_video.scene.gltf.textures import Image
from nlens_video.scene.posed import PosedMesh

_SAMPLES = 4
_STEP = 64


class GpuMaterial(pyrender.MetallicRoughnessMaterial):  # type: ignore[misc]  # untyped base
    """A material with its textures and its numbers as the shader reads them."""

    def __init__(self, material: Material, textures: dict[Image, GpuTexture]) -> None:
        super().__init__(alphaMode=material.alpha_mode, doubleSided=material.double_sided)
        self.source = material
        self.maps: dict[str, GpuTexture] = {
            slot: textures.setdefault(use.image, GpuTexture(use.image))
            for slot, use in zip(SLOTS, texture_uses(material), strict=True)
            if use is not None
        }
        self.block = material_params(material)

    def _compute_textures(self) -> set[GpuTexture]:
        return set(self.maps.values())

    @property
    def defines(self) -> dict[str, int]:
        """Preprocessor definitions of the shader."""
        source = self.source
        found = {f"USE_{slot.upper()}_MAP": 1 for slot in self.maps}
        if source.alpha_mode != "OPAQUE":
            found[f"USE_ALPHA_{source.alpha_mode}"] = 1
        if {"specular", "specular_color"} & self.maps.keys():
            found["USE_TEXTURED_SPECULAR"] = 1
        for layer in source.layers.drawn:
            found[f"USE_{layer}"] = 1
        if source.unlit:
            found["USE_UNLIT"] = 1
        return found


class GpuPrimitive(pyrender.Primitive):  # type: ignore[misc]  # untyped base
    """Triangles whose positions and normals change from frame to frame."""

    def __init__(self, posed: PosedMesh, material: GpuMaterial) -> None:
        super().__init__(positions=posed.positions, indices=posed.faces, material=material)
        self.mirrored = posed.mirrored
        self._posed = posed
        self._order: Float64 | None = None

    @property
    def posed(self) -> PosedMesh:
        """What is on the GPU."""
        return self._posed

    def _add_to_context(self) -> None:
        geometry, count = self._posed.geometry, len(self._posed.positions)
        self._vaid = GL.glGenVertexArrays(1)
        GL.glBindVertexArray(self._vaid)
        moving, fixed, faces = (int(name) for name in GL.glGenBuffers(3))
        self._buffers = [moving, fixed, faces]
        GL.glBindBuffer(GL.GL_ARRAY_BUFFER, moving)
        GL.glBufferData(GL.GL_ARRAY_BUFFER, 24 * count, None, GL.GL_DYNAMIC_DRAW)
        _attribute(0, 3, 0)
        _attribute(1, 3, 12 * count)
        parts = [geometry.uv] if geometry.colors is None else [geometry.uv, geometry.colors]
        GL.glBindBuffer(GL.GL_ARRAY_BUFFER, fixed)
        data = np.concatenate([part.ravel() for part in parts])
        GL.glBufferData(GL.GL_ARRAY_BUFFER, data.nbytes, data, GL.GL_STATIC_DRAW)
        for number in range(len(parts)):
            _attribute(2 + number, 4, 16 * count * number)
        GL.glBindBuffer(GL.GL_ELEMENT_ARRAY_BUFFER, faces)
        indices = np.ascontiguousarray(geometry.faces, dtype=np.uint32)
        GL.glBufferData(GL.GL_ELEMENT_ARRAY_BUFFER, indices.nbytes, indices, GL.GL_DYNAMIC_DRAW)
        GL.glBindVertexArray(0)
        self._upload()

    def update(self, posed: PosedMesh) -> None:
        """Move the vertices to another moment."""
        if posed is self._posed:
            return
        self._posed, self.mirrored = posed, posed.mirrored
        if self._vaid is not None:
            self._upload()

    def _upload(self) -> None:
        positions = np.ascontiguousarray(self._posed.positions, dtype=np.float32)
        normals = np.ascontiguousarray(self._posed.normals, dtype=np.float32)
        GL.glBindBuffer(GL.GL_ARRAY_BUFFER, self._buffers[0])
        GL.glBufferSubData(GL.GL_ARRAY_BUFFER, 0, positions.nbytes, positions)
        GL.glBufferSubData(GL.GL_ARRAY_BUFFER, positions.nbytes, normals.nbytes, normals)
        GL.glBindBuffer(GL.GL_ARRAY_BUFFER, 0)

    def depth_along(self, back: Float64, eye: Float64) -> Float64:
        """Depth (F,) of the faces' centres seen from `eye` (3,), `back` (3,) pointing behind."""
        depth = (self._posed.positions - eye.astype(np.float32)) @ -back.astype(np.float32)
        return np.asarray(depth[self._posed.faces].mean(axis=1), dtype=np.float64)

    def sort(self, depth: Float64) -> None:
        """Order the triangles from far to near, given the depth (F,) of each."""
        ordered = self._posed.faces[np.argsort(-depth, kind="stable")].astype(np.uint32)
        GL.glBindVertexArray(self._vaid)
        GL.glBufferSubData(GL.GL_ELEMENT_ARRAY_BUFFER, 0, ordered.nbytes, ordered)

    def draw(self) -> None:
        """Draw with the program that is bound."""
        GL.glBindVertexArray(self._vaid)
        GL.glDrawElements(
            GL.GL_TRIANGLES, self._posed.faces.size, GL.GL_UNSIGNED_INT, ctypes.c_void_p(0)
        )


def _attribute(location: int, width: int, offset: int) -> None:
    GL.glEnableVertexAttribArray(location)
    GL.glVertexAttribPointer(
        location, width, GL.GL_FLOAT, GL.GL_FALSE, 4 * width, ctypes.c_void_p(offset)
    )


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
