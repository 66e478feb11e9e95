"""The block: surface points that are shaded together.

Its numbers lie by field, `WIDTH` points each, in one flat array. So the offsets between fields are
known when the kernels are compiled, and loops over points become vector instructions.
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from nlens_video.frames import Float32

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
FLOATS = 24 * WIDTH
# Whole numbers: triangle, pixel (row * columns + column), samples (a bit each).
TRIANGLE, PIXEL, MASK = 0 * WIDTH, 1 * WIDTH, 2 * WIDTH
INTS = 3 * WIDTH


def new_block() -> Block:
    """A block without points: what no point has written must be harmless numbers."""
    return np.zeros(FLOATS, np.float32), np.zeros(INTS, np.int32)
