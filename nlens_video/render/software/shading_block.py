"""Block of surface points shaded together, as a structure of arrays.

All fields lie in one flat array, `WIDTH` points each: their offsets are compile-time constants, so
loops over points vectorise.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from nlens_video.core.layers import Float32

Int32 = npt.NDArray[np.int32]
Block = tuple[Float32, Int32]

WIDTH = 64
"""Points of a block."""

# Where in the picture: column and row [px], and the share of the pixel that the point stands for.
X, Y, WEIGHT = 0 * WIDTH, 1 * WIDTH, 2 * WIDTH
# Unit vectors in the world: of the surface, facing the eye, and towards the eye.
NORMAL_X, NORMAL_Y, NORMAL_Z = 3 * WIDTH, 4 * WIDTH, 5 * WIDTH
VIEW_X, VIEW_Y, VIEW_Z = 6 * WIDTH, 7 * WIDTH, 8 * WIDTH
DISTANCE = 9 * WIDTH  # from the eye [scene unit]
# The material there; linear light.
BASE_R, BASE_G, BASE_B, ALPHA = 10 * WIDTH, 11 * WIDTH, 12 * WIDTH, 13 * WIDTH
METALLIC, ROUGHNESS, SPECULAR = 14 * WIDTH, 15 * WIDTH, 16 * WIDTH
F0_R, F0_G, F0_B = 17 * WIDTH, 18 * WIDTH, 19 * WIDTH
OCCLUSION = 20 * WIDTH
# Radiance towards the eye: emission at first, then all of it.
RED, GREEN, BLUE = 21 * WIDTH, 22 * WIDTH, 23 * WIDTH
DEPTH = 24 * WIDTH  # along the optical axis [scene unit]
# The mesh's texture coordinates: two pairs, then their change by a column and by a row.
COORDINATES = 25 * WIDTH
# What samples a texture: coordinates in its picture and their change by a column and by a row,
U, V = 37 * WIDTH, 38 * WIDTH
U_ACROSS, V_ACROSS, U_DOWN, V_DOWN = 39 * WIDTH, 40 * WIDTH, 41 * WIDTH, 42 * WIDTH
# level, share of the next level, whether texels are mixed; shares of the column and the row beside,
# on both levels; what was found.
LEVEL, NEXT, SMOOTH = 43 * WIDTH, 44 * WIDTH, 45 * WIDTH
ACROSS, DOWN = 46 * WIDTH, 48 * WIDTH
TEXEL_R, TEXEL_G, TEXEL_B, TEXEL_A = 50 * WIDTH, 51 * WIDTH, 52 * WIDTH, 53 * WIDTH
# Layers of materials that have some: emission; weight, roughness and normal (of any length) of the
# clear coat; colour and roughness of the sheen; anisotropy, its direction on the
# surface and the one across it (of any length); light of sheen and of the coat.
GLOW = 54 * WIDTH
COAT, COAT_ROUGHNESS, COAT_NORMAL = 57 * WIDTH, 58 * WIDTH, 59 * WIDTH
SHEEN, SHEEN_ROUGHNESS = 62 * WIDTH, 65 * WIDTH
ANISOTROPY, ALONG, BESIDE = 66 * WIDTH, 67 * WIDTH, 70 * WIDTH
FUZZ, SHINE = 73 * WIDTH, 76 * WIDTH
# Share of light that goes through, optical depth of the volume; what hides the things behind.
THROUGH, VOLUME, HIDDEN = 79 * WIDTH, 80 * WIDTH, 83 * WIDTH
FLOATS = 84 * WIDTH
# Whole numbers: triangle, pixel (row * columns + column), samples (a bit each), material; texel
# within its level and distance to the one below, on both levels.
TRIANGLE, PIXEL, MASK, MATERIAL = 0 * WIDTH, 1 * WIDTH, 2 * WIDTH, 3 * WIDTH
TEXEL, STRIDE = 4 * WIDTH, 6 * WIDTH
INTS = 8 * WIDTH


def new_block() -> Block:
    """A block without points: what no point has written must be harmless numbers."""
    return np.zeros(FLOATS, np.float32), np.zeros(INTS, np.int32)
