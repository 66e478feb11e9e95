"""GPU textures, materials and meshes of the scene: uploaded once, vertices updated in place."""

from __future__ import annotations

import ctypes

import numpy as np
import pyrender
from OpenGL import GL

from nlens_video.core.layers import Float64
from nlens_video.render.base.shader_inputs import SLOTS, material_params, texture_uses
from nlens_video.scene.gltf.materials import Image, Material
from nlens_video.scene.posed import PosedMesh

_SHRINKING = {GL.GL_NEAREST, GL.GL_LINEAR}


class GpuTexture(pyrender.Texture):  # type: ignore[misc]  # untyped base
    """A texture whose colours are decoded before they are filtered."""

    def __init__(self, image: Image) -> None:
        super().__init__(source=None, source_channels="RGBA", width=1, height=1)
        self._image = image

    def _add_to_context(self) -> None:
        pixels, image = np.ascontiguousarray(self._image.pixels), self._image
        stored = GL.GL_SRGB8_ALPHA8 if image.srgb else GL.GL_RGBA8
        self._texid = GL.glGenTextures(1)
        GL.glBindTexture(GL.GL_TEXTURE_2D, self._texid)
        # Not flipped: row 0 of the picture is v = 0, as glTF has it.
        GL.glTexImage2D(
            GL.GL_TEXTURE_2D,
            0,
            stored,
            pixels.shape[1],
            pixels.shape[0],
            0,
            GL.GL_RGBA,
            GL.GL_UNSIGNED_BYTE,
            pixels,
        )
        if image.min_filter not in _SHRINKING:
            GL.glGenerateMipmap(GL.GL_TEXTURE_2D)
        for name, value in (
            (GL.GL_TEXTURE_MAG_FILTER, image.mag_filter),
            (GL.GL_TEXTURE_MIN_FILTER, image.min_filter),
            (GL.GL_TEXTURE_WRAP_S, image.wrap[0]),
            (GL.GL_TEXTURE_WRAP_T, image.wrap[1]),
        ):
            GL.glTexParameteri(GL.GL_TEXTURE_2D, name, value)
        GL.glBindTexture(GL.GL_TEXTURE_2D, 0)


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
