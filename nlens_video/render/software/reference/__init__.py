"""Definitions in numpy of the rasteriser's kernels; the tests compare both."""
