"""The compiled modules that this processor runs."""

import importlib

import numpy as np

from nlens_video import native

LEVELS = ("_baseline", "_x86_64_v3", "_x86_64_v4")


def modules():
    """Of all levels up to the best one here."""
    best = native.kernels.best_module()
    names = LEVELS[: LEVELS.index(best) + 1]
    return [importlib.import_module(f"nlens_video.native.{name}") for name in names]


def assert_same_bits(run):
    """`run(module)`, an array or several, is the same to the bit at every level."""
    first, *others = ([np.asarray(part) for part in run(module)] for module in modules())
    for other in others:
        for one, two in zip(first, other, strict=True):
            assert one.dtype == two.dtype and one.tobytes() == two.tobytes()
