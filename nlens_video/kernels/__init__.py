"""Compiled kernels; the slow definition of each (`*_ref.py`) stands beside it.

An object is blurred by scattering its sharp layer: every pixel spreads over its disc of confusion
(`scatter`), with exact areas as weights (`disc`). Pixels around the object take part as a
transparent background with the object's own CoC (`extend`).
"""

from nlens_video.kernels import cache_stamp, numba_config

cache_stamp.stamp_kernels_by_what_they_import()
numba_config.settle_cache()
