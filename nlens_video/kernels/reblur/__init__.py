"""Compiled kernels of the reblur beside the scatter."""
