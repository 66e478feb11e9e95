"""Kernels in C++, compiled for several levels of processors; `kernels` is the best one for this.

All levels give the same bits. `kernels.pyi` lists the functions; what they compute stands in
`source/`. The slow definition of each kernel (`*_ref.py`) stands beside its caller.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

try:
    from nlens_video.native import _baseline
except ImportError as problem:
    raise ImportError(
        f"the compiled kernels of nlens-video do not load ({problem}); "
        "in a checkout, compile them: pip install -e ."
    ) from problem

if TYPE_CHECKING:
    from nlens_video.native import kernels as kernels
else:
    kernels = importlib.import_module(f"{__name__}.{_baseline.best_module()}")
