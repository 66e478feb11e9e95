"""The scene's textures on the GPU."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
import pyrender
from OpenGL import GL

from nlens_video.core.color import transfer
from nlens_video.render.base.mipmaps import Texels, mipmaps
from nlens_video.scene.gltf.textures import Image


class GpuTexture(pyrender.Texture):  # type: ignore[misc]  # untyped base
    """A texture whose colours are decoded before they are filtered."""

    def __init__(self, image: Image) -> None:
        super().__init__(source=None, source_channels="RGBA", width=1, height=1)
        self._image = image

    def _add_to_context(self) -> None:
        image = self._image
        stored = GL.GL_SRGB8_ALPHA8 if image.srgb else GL.GL_RGBA8
        self._texid = GL.glGenTextures(1)
        GL.glBindTexture(GL.GL_TEXTURE_2D, self._texid)
        # Not flipped: row 0 of the picture is v = 0, as glTF has it.
        for number, level in enumerate(mipmaps(image)):
            height, width = level.shape[:2]
            GL.glTexImage2D(
                GL.GL_TEXTURE_2D, number, stored, width, height, 0, GL.GL_RGBA, GL.GL_UNSIGNED_BYTE,
                _coded(level, srgb=image.srgb),
            )  # fmt: skip
        for name, value in (
            (GL.GL_TEXTURE_MAG_FILTER, image.mag_filter),
            (GL.GL_TEXTURE_MIN_FILTER, image.min_filter),
            (GL.GL_TEXTURE_WRAP_S, image.wrap[0]),
            (GL.GL_TEXTURE_WRAP_T, image.wrap[1]),
        ):
            GL.glTexParameteri(GL.GL_TEXTURE_2D, name, value)
        GL.glBindTexture(GL.GL_TEXTURE_2D, 0)


def _coded(level: Texels, *, srgb: bool) -> npt.NDArray[np.uint8]:
    """A level (h, w, 4) in 8-bit codes; those of the file's own picture are the file's."""
    light = np.arange(65536) / 65535.0
    straight = np.round(light * 255.0).astype(np.uint8)
    coded = transfer("iec61966-2-1").to_coded(light) if srgb else light
    out = np.empty(level.shape, np.uint8)
    out[..., :3] = np.round(coded * 255.0).astype(np.uint8)[level[..., :3]]
    out[..., 3] = straight[level[..., 3]]
    return out
