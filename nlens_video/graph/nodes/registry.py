"""The nodes that a pipeline file can name: all subclasses of `Node` in this folder's modules.

An effect in a folder of its own (`effects/NAME/`) brings its node in a module `node` there.
"""

from __future__ import annotations

import inspect
import pkgutil
from collections.abc import Iterator
from importlib import import_module
from importlib.util import find_spec

from nlens_video import effects
from nlens_video.graph import nodes
from nlens_video.graph.base.node import Node


def _modules() -> Iterator[str]:
    for module in pkgutil.iter_modules(nodes.__path__, f"{nodes.__name__}."):
        if module.name != __name__:
            yield module.name
    for folder in pkgutil.iter_modules(effects.__path__, f"{effects.__name__}."):
        if folder.ispkg and find_spec(f"{folder.name}.node") is not None:
            yield f"{folder.name}.node"


def _classes(module: str) -> Iterator[type[Node]]:
    for value in vars(import_module(module)).values():
        if inspect.isclass(value) and issubclass(value, Node) and value.__module__ == module:
            yield value


NODES: dict[str, type[Node]] = {cls.name: cls for module in _modules() for cls in _classes(module)}
"""Name to class."""

FORMER_NAMES = {
    "locate": "object-bounds",
    "project": "ground-footprint",
    "light": "estimate-light",
    "follow": "match-exposure",
    "motion": "measure-motion",
    "moments": "select-samples",
    "expose": "render-motion",
    "smear": "motion-blur",
    "sharp": "crop-sharp",
    "scatter": "reblur",
    "lens": "lens-sampling",
    "views": "aperture-views",
    "lay-views": "blend-views",
    "peel": "depth-peel",
    "past-edges": "edge-parallax",
    "repair": "depth-order",
    "matte": "occlusion-cue",
    "hold-out": "foreground",
    "darken": "composite-shadow",
    "lay-reflection": "composite-reflection",
    "widen": "add-overscan",
    "narrow": "remove-overscan",
    "bend": "distort",
    "bend-shadow": "distort-shadow",
    "bend-reflection": "distort-reflection",
    "fringe": "chromatic-aberration",
}
"""Names of nodes before 1.0, as older pipeline files have them, to today's."""
