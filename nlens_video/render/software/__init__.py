"""The rasteriser in compiled kernels: no OpenGL, the same shading."""
