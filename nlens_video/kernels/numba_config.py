"""How the rasteriser's kernels are compiled.

Without reference counting: they allocate nothing, their callers hold the arrays, and counting the
arrays of a tuple up and down at each call took three quarters of the time.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, TypeVar, cast

import numpy as np
from numba import njit

_Function = TypeVar("_Function", bound=Callable[..., Any])
_COMMON: dict[str, Any] = {"error_model": "numpy", "_nrt": False}
_KERNEL: dict[str, Any] = {**_COMMON, "cache": True, "nogil": True}
_INLINED: dict[str, Any] = {**_COMMON, "forceinline": True}
# The ignored types below: compiled code works on NumPy's scalars, which are no `float` or `int`
# to a type checker, and its callers write them as plain numbers.
# Divisions become multiplications, and square roots may be estimated and refined: to about 1e-7.
_QUICK: dict[str, Any] = {"fastmath": {"contract", "arcp", "afn"}}


def f32(value: float) -> float:
    """A float32 constant: with a float64 one all arithmetic would be float64."""
    return np.float32(value)  # type: ignore[return-value]


def kernel(function: _Function) -> _Function:
    """Compile a function when it is first called, for the arguments that it gets."""
    return cast(_Function, njit(**_KERNEL)(function))


def fastmath_kernel(function: _Function) -> _Function:
    """Compile a function likewise, with arithmetic that is exact to about 1e-7."""
    return cast(_Function, njit(**{**_KERNEL, **_QUICK})(function))


def kernel_of(signature: str) -> Callable[[_Function], _Function]:
    """Compile a function at once, for a numba signature."""

    def compiled(function: _Function) -> _Function:
        return cast(_Function, njit(signature, **_KERNEL)(function))

    return compiled


def inlined(function: _Function) -> _Function:
    """Compile a function into its callers: handing over arrays costs more than the work."""
    return cast(_Function, njit(**_INLINED)(function))


def fastmath_inlined(function: _Function) -> _Function:
    """Compile a function into its callers, with arithmetic that is exact to about 1e-7."""
    return cast(_Function, njit(**{**_INLINED, **_QUICK})(function))


@inlined
def to_f32(value: float) -> float:
    """A number as float32."""
    return np.float32(value)  # type: ignore[return-value]


@inlined
def floor(value: float) -> float:
    """The whole number below, of the same type."""
    return np.floor(value)  # type: ignore[no-any-return]


@inlined
def truncated(value: float) -> int:
    """A number without its fraction, as an index."""
    return np.int64(np.int32(value))  # type: ignore[return-value]
