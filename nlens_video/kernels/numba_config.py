"""Numba options of the compiled kernels, and the folder of numba's cache.

Kernels of `kernel` and `inlined` are compiled without reference counting: they allocate nothing,
their callers hold the arrays, and counting the arrays of a tuple at each call took three quarters
of the time.

Compiled kernels are cached beside their module or in the user's cache folder (`~/.cache/numba`). In
a container, a service or a shared installation neither may be writable, and numba then refuses to
compile. `settle_cache` falls back to a private folder for temporary files: numba loads its cache as
a pickle, that is as code, so no other user may write there.
"""

from __future__ import annotations

import os
import shutil
import stat
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, TypeVar, cast

import numba
import numpy as np
from numba import njit
from numba.core.dispatcher import Dispatcher

_Function = TypeVar("_Function", bound=Callable[..., Any])
_COMMON: dict[str, Any] = {"error_model": "numpy", "_nrt": False}
_KERNEL: dict[str, Any] = {**_COMMON, "cache": True, "nogil": True}
_INLINED: dict[str, Any] = {**_COMMON, "forceinline": True}
# Divisions become multiplications, and square roots may be estimated and refined: to about 1e-7.
_QUICK: dict[str, Any] = {"fastmath": {"contract", "arcp", "afn"}}
# Compiled code works on NumPy's scalars, which are no `float` or `int` to a type checker. Callers
# write them as plain numbers, so their constructors are said here to make some.
_float32 = cast(Callable[[object], float], np.float32)
_int64 = cast(Callable[[object], int], np.int64)
_floor = cast(Callable[[object], float], np.floor)


def f32(value: float) -> float:
    """A float32 constant: with a float64 one all arithmetic would be float64."""
    return _float32(value)


def kernel(function: _Function) -> _Function:
    """Compile a function when it is first called, for the arguments that it gets."""
    return cast(_Function, njit(**_KERNEL)(function))


def fastmath_kernel(function: _Function) -> _Function:
    """Compile a function likewise, with arithmetic that is exact to about 1e-7."""
    return cast(_Function, njit(**{**_KERNEL, **_QUICK})(function))


def kernel_of(*signatures: str) -> Callable[[_Function], _Function]:
    """Compile a function at once, for numba signatures."""

    def compiled(function: _Function) -> _Function:
        return cast(_Function, njit(list(signatures), **_KERNEL)(function))

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
    return _float32(value)


@inlined
def floor(value: float) -> float:
    """The whole number below, of the same type."""
    return _floor(value)


@inlined
def truncated(value: float) -> int:
    """A number without its fraction, as an index."""
    return _int64(np.int32(value))


@inlined
def exponent(value: float) -> float:
    """`np.floor(np.log2(value))` of a positive, normal float32."""
    bits = np.float32(value).view(np.int32)
    return _float32((bits >> np.int32(23)) - np.int32(127))


@inlined
def significand(value: float) -> float:
    """`value / 2**exponent(value)` of a positive, normal float32, in [1, 2)."""
    bits = np.float32(value).view(np.int32) & np.int32(0x7FFFFF)
    return _float32(np.int32(bits | np.int32(127 << 23)).view(np.float32))


@inlined
def half_power(power: float) -> float:
    """`0.5 ** power` of a whole number from 0 to 126, float32."""
    bits = (np.int32(127) - np.int32(power)) << np.int32(23)
    return _float32(np.int32(bits).view(np.float32))


ENOUGH = 64 << 20
"""Free space that a folder must have; the kernels take about 10 MB [bytes]."""

_notes: list[str] = []


def settle_cache() -> None:
    """Choose a writable cache folder; call before any cached kernel is declared."""
    if _numba_finds_a_place():
        return
    folder = next(_private_folders(), None)
    if folder is None:
        # numba has no switch for this
        Dispatcher.enable_caching = _keep_nothing  # type: ignore[method-assign, assignment]
        _notes.append(
            "compiled kernels are not cached, so each run compiles them again: neither the "
            "package, the home folder nor the temporary folder can be written; give NUMBA_CACHE_DIR"
        )
        return
    numba.config.CACHE_DIR = str(folder)  # type: ignore[attr-defined]  # made when it is imported
    _notes.append(
        f"compiled kernels are cached in {folder}, as neither the package nor the home folder can "
        "be written; NUMBA_CACHE_DIR names another folder"
    )


def _numba_finds_a_place() -> bool:
    named = os.environ.get("NUMBA_CACHE_DIR") or os.environ.get("XDG_CACHE_HOME")
    if not named and not os.path.isabs(os.path.expanduser("~")):  # noqa: PTH111, PTH117
        return False  # a user without a home: numba would make a folder named ~ where it is
    try:
        numba.njit(cache=True)(_no_kernel)
    except RuntimeError:
        return False
    return True


def _keep_nothing(dispatcher: Dispatcher) -> None:
    """Replaces `Dispatcher.enable_caching`."""


def cache_notes() -> tuple[str, ...]:
    """Notes for the user: an unusual cache folder, or none."""
    return tuple(_notes)


def _no_kernel() -> None:
    """A function beside the kernels, to probe their cache folder."""


def _private_folders() -> Iterator[Path]:
    """Private folders of this user with enough free space, created where missing."""
    for parent in dict.fromkeys([_temporary_folder(), "/var/tmp", "/dev/shm"]):
        if parent is None:
            continue
        folder = Path(parent) / f"nlens-video-{os.geteuid()}"
        if _made_private(folder) and shutil.disk_usage(folder).free >= ENOUGH:
            yield folder


def _temporary_folder() -> str | None:
    try:
        return tempfile.gettempdir()
    except FileNotFoundError:
        return None


def _made_private(folder: Path) -> bool:
    """Whether the folder exists, is no link, and belongs to and admits this user alone."""
    try:
        folder.mkdir(mode=0o700, exist_ok=True)
        found = folder.lstat()
        tempfile.TemporaryFile(dir=folder).close()
    except OSError:
        return False
    return (
        stat.S_ISDIR(found.st_mode)
        and found.st_uid == os.geteuid()
        and not stat.S_IMODE(found.st_mode) & 0o077
    )
