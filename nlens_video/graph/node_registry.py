"""The nodes that a pipeline file can name, imported as far as pipelines name them."""

from __future__ import annotations

import inspect
from collections.abc import Iterator, Mapping
from importlib import import_module
from importlib.util import find_spec
from pkgutil import ModuleInfo, iter_modules
from threading import Lock
from types import ModuleType

from nlens_video import effects
from nlens_video.graph import nodes as node_modules
from nlens_video.graph.base.node import Node

_LAST = ("camera", "ground")
"""Modules of nodes that only the presets of finished shots need, and that import most."""


class _Nodes(Mapping[str, type[Node]]):
    """The nodes by name; a module is imported when a name is in none before it."""

    def __init__(self) -> None:
        own = [module.name for module in _submodules(node_modules)]
        self._modules = sorted(own, key=lambda name: name.rpartition(".")[2] in _LAST)
        for folder in _submodules(effects):  # an effect with a folder of its own brings its node
            if folder.ispkg and find_spec(f"{folder.name}.node") is not None:
                self._modules.append(f"{folder.name}.node")
        self._known: dict[str, type[Node]] = {}
        self._lock = Lock()

    def __getitem__(self, name: str) -> type[Node]:
        with self._lock:
            while name not in self._known and self._modules:
                self._import_next()
        return self._known[name]

    def __iter__(self) -> Iterator[str]:
        with self._lock:
            while self._modules:
                self._import_next()
        return iter(self._known)

    def __len__(self) -> int:
        return sum(1 for _ in self)

    def _import_next(self) -> None:
        module = import_module(self._modules[0])
        for value in vars(module).values():
            own = inspect.isclass(value) and value.__module__ == module.__name__
            if own and issubclass(value, Node):
                self._known[value.name] = value
        del self._modules[0]


def _submodules(package: ModuleType) -> Iterator[ModuleInfo]:
    return iter_modules(package.__path__, f"{package.__name__}.")


NODES: Mapping[str, type[Node]] = _Nodes()
"""The nodes that a pipeline file can name: subclasses of `Node` in `graph/nodes` and `effects`."""
