"""When a cached kernel is out of date: its module, or one that it imports, has changed.

numba looks at the kernel's own file alone. What other modules give it, constants and functions that
are compiled into it, would stay as they were when the package is updated.
"""

from __future__ import annotations

import hashlib
import re
from functools import cache
from pathlib import Path
from typing import Any

from numba.core import caching

_PACKAGE = Path(__file__).parent.parent
_IMPORT = re.compile(
    rb"^\s*(?:from|import)\s+nlens_video\.([\w.]+)(?:\s+import\s+(\([^)]*\)|.+))?", re.M
)


def stamp_kernels_by_what_they_import() -> None:
    """Let numba compare all sources of this package's kernels; those of others stay as they are."""
    locator: Any = caching._SourceFileBackedLocatorMixin  # numba has no switch for this
    own = locator.get_source_stamp

    def stamp(self: Any) -> object:  # noqa: ANN401  numba's own class is private
        path = Path(self._py_file)
        return source_stamp(path) if _PACKAGE in path.parents else own(self)

    locator.get_source_stamp = stamp


def source_stamp(path: Path) -> str:
    """Hash of a module of this package and of all that it imports of it, at any remove.

    Args:
        path: of the module's source.
    """
    found: dict[Path, None] = {path: None}
    waiting = [path]
    while waiting:
        for other in _imported(waiting.pop()):
            if other not in found:
                found[other] = None
                waiting.append(other)
    return hashlib.sha256(b"".join(_hash(other) for other in sorted(found))).hexdigest()


@cache
def _source(path: Path) -> bytes:
    return path.read_bytes()


@cache
def _hash(path: Path) -> bytes:
    return hashlib.sha256(_source(path)).digest()


@cache
def _imported(path: Path) -> tuple[Path, ...]:
    """The modules of this package that a module names in its imports."""
    names: list[str] = []
    for module, members in _IMPORT.findall(_source(path)):
        name = module.decode()
        names += [name, *(f"{name}.{member}" for member in re.findall(r"\w+", members.decode()))]
    places = (_PACKAGE.joinpath(*name.split(".")) for name in names)
    modules = (place.with_suffix(".py") for place in places)
    return tuple(module for module in dict.fromkeys(modules) if module.is_file())
