"""The nodes that a pipeline file can name."""

from __future__ import annotations

import inspect
from collections.abc import Iterator
from importlib import import_module
from importlib.util import find_spec
from pkgutil import ModuleInfo, iter_modules
from types import ModuleType

from nlens_video import effects
from nlens_video.graph import nodes as node_modules
from nlens_video.graph.base.node import Node


def _node_classes() -> Iterator[type[Node]]:
    modules = [module.name for module in _submodules(node_modules)]
    for folder in _submodules(effects):  # an effect with a folder of its own brings its node
        if folder.ispkg and find_spec(f"{folder.name}.node") is not None:
            modules.append(f"{folder.name}.node")
    for module in map(import_module, modules):
        for value in vars(module).values():
            own = inspect.isclass(value) and value.__module__ == module.__name__
            if own and issubclass(value, Node):
                yield value


def _submodules(package: ModuleType) -> Iterator[ModuleInfo]:
    return iter_modules(package.__path__, f"{package.__name__}.")


NODES: dict[str, type[Node]] = {cls.name: cls for cls in _node_classes()}
"""The nodes that a pipeline file can name: subclasses of `Node` in `graph/nodes` and `effects`."""
