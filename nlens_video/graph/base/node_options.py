"""Options that a pipeline file gives a node."""

from __future__ import annotations

import inspect
import math
from pathlib import Path

from nlens_video.core.errors import UsageError
from nlens_video.graph.base.node import Node


def check_options(node: type[Node], options: dict[str, object], path: Path) -> None:
    """See that a node has options of these names, types, ranges and choices.

    Args:
        node: its class.
        options: name to value, as a pipeline file has them.
        path: of the file.

    Raises:
        UsageError: it has none of a name, or one does not take its value.
    """
    parameters = inspect.signature(node.__init__).parameters
    known = {name: one for name, one in parameters.items() if one.kind is one.KEYWORD_ONLY}
    ranges = {name: (least, most) for name, least, most in node.ranges}
    choices = dict(node.choices)
    for name, value in options.items():
        if name not in known:
            raise UsageError(
                f"{path}: node {node.name!r} has no option {name!r}; it has "
                f"{', '.join(known) or 'none'}"
            )
        wanted = type(known[name].default)
        fits = isinstance(value, wanted) and (wanted is bool or not isinstance(value, bool))
        if not fits and not (wanted is float and type(value) is int):
            raise UsageError(
                f"{path}: option {name!r} of node {node.name!r} is {value!r}, expected "
                f"{wanted.__name__}"
            )
        if name in choices and value not in choices[name]:
            raise UsageError(
                f"{path}: option {name!r} of node {node.name!r} is {value!r}, expected "
                f"{' or '.join(map(repr, choices[name]))}"
            )
        least, most = ranges.get(name, (-math.inf, math.inf))
        if isinstance(value, int | float) and not (math.isfinite(value) and least <= value <= most):
            expected = f"{least:g} to {most:g}" if name in ranges else "a finite number"
            raise UsageError(
                f"{path}: option {name!r} of node {node.name!r} is {value!r}, expected {expected}"
            )
