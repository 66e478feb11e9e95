"""What the software rasteriser shades with, as its kernels read it."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from nlens_video.core.layers import Float32
from nlens_video.native import kernels
from nlens_video.render.base.light_depth import NO_MAPS, DepthMaps
from nlens_video.render.base.mipmaps import Texels
from nlens_video.render.base.shader_inputs import Lighting
from nlens_video.render.software.textures import Table

Int32 = npt.NDArray[np.int32]
MeshBuffers = tuple[Float32, Float32, Float32, Float32, Int32, Int32, Float32]
"""Positions (V, 3), normals (V, 4), the last number of any content, texture coordinates (V, 4),
colours (V, 4) or (0, 4), faces (F, 3), each one's material (F,), planes (F, 16)."""
MaterialBuffers = tuple[Float32, Int32, Int32, tuple[Texels, Table, Table]]
"""Numbers of the materials (M, `MATERIAL_FLOATS`), their textures (M, slots), -1 for none, flags
(M,), the atlas."""
Lights = tuple[Float32, int, Float32, Float32, DepthMaps]
"""Numbers of the lamps (L, 16), how many of them, the first ones, have no place, ambient light
(9, 4) or (0, 4), `Surround.levels`, (0, 0, 0, 4) where nothing mirrors them, and depth maps."""
ShadingInputs = tuple[MeshBuffers, MaterialBuffers, Float32, Lights]
"""The third is the camera: its axes (right, up, back), fx, fy, cx, cy (13,)."""

UNLIT, OPAQUE, LAYERED, CUT = kernels.UNLIT, kernels.OPAQUE, kernels.LAYERED, kernels.CUT
"""Flags of a material."""


def lights(lighting: Lighting, eye: npt.NDArray[np.float64]) -> Lights:
    """The light of a picture that is seen from `eye` (3,)."""
    ambient = lighting.ambient_rows()[: 0 if lighting.ambient is None else 9]
    around = np.zeros((0, 0, 0, 4), np.float32) if lighting.surround is None else lighting.surround
    maps = NO_MAPS if lighting.depth is None else lighting.depth.maps(eye)
    return lighting.lamp_rows(eye), lighting.suns, ambient, around, maps
