"""Kernels of the blur, compiled in C++; the slow definition of each (`*_ref.py`) stands beside it.

An object is blurred by scattering its sharp layer: every pixel spreads over its disc of confusion
(`scatter`), with exact areas as weights (`disc`). Pixels around the object take part as a
transparent background with the object's own CoC (`extend`).
"""
