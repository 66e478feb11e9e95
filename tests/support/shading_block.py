"""Rows of a block of surface points that tests fill in, as `shading_block.h` has them."""

ROWS, WIDTH = 76, 64
"""Numbers of a point, and points of a block."""

# each the first of as many as it has components
NORMAL_X, VIEW_X, DISTANCE = 3, 6, 9
BASE_R, METALLIC, ROUGHNESS, SPECULAR, F0_R = 10, 14, 15, 16, 17
RED = 21
GLOW, COAT, COAT_ROUGHNESS, COAT_NORMAL = 47, 50, 51, 52
SHEEN, SHEEN_ROUGHNESS, ANISOTROPY, ALONG, BESIDE = 55, 58, 59, 60, 63
THROUGH, WIDENING, VISIBLE = 66, 71, 72
