"""Rows of a block of surface points that tests fill in, as `shading_block.h` has them."""

ROWS, WIDTH = 84, 64
"""Numbers of a point, and points of a block."""

# each the first of as many as it has components
NORMAL_X, VIEW_X, DISTANCE = 3, 6, 9
BASE_R, METALLIC, ROUGHNESS, SPECULAR, F0_R = 10, 14, 15, 16, 17
RED = 21
GLOW, COAT, COAT_ROUGHNESS, COAT_NORMAL = 54, 57, 58, 59
SHEEN, SHEEN_ROUGHNESS, ANISOTROPY, ALONG, BESIDE = 62, 65, 66, 67, 70
THROUGH = 79
