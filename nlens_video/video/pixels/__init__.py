"""Pixel formats: planes to scene-linear light and back, the blend into them."""
