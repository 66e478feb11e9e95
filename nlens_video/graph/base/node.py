"""A node of the frame graph: a callable whose parameters are its input ports."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any, ClassVar, Literal, get_args

from nlens_video.graph.base.values import FrameValues

Lane = Literal["render", "composite"]
LANES: tuple[Lane, ...] = get_args(Lane)
"""The threads on which nodes run, in the order in which a frame passes them."""
_MISSING = " | None"


class Unavailable(Exception):
    """A node that this installation or this run cannot have, and why."""


@dataclass(frozen=True, slots=True)
class Port:
    """A value that a callable takes.

    Attributes:
        name: of the attribute of `FrameValues`.
        type: its annotation, without None.
        optional: whether it may be None.
    """

    name: str
    type: str
    optional: bool


@cache
def ports_of(function: Callable[..., object]) -> tuple[Port, ...]:
    """The input ports of a callable, read off its signature.

    Raises:
        TypeError: a parameter is no port, or is annotated with another type.
    """
    found = []
    for name, parameter in inspect.signature(function).parameters.items():
        if name == "self":
            continue
        found.append(_port(name, parameter.annotation, function))
    return tuple(found)


@cache
def output_type(function: Callable[..., object]) -> str:
    """What a callable returns, None left out."""
    return str(inspect.signature(function).return_annotation).removesuffix(_MISSING)


def port_type(name: str) -> str:
    """The type of a port, None left out.

    Raises:
        TypeError: there is no such port.
    """
    annotation = FrameValues.__annotations__.get(name)
    if annotation is None:
        raise TypeError(f"{name!r} is no port; there are {', '.join(FrameValues.__annotations__)}")
    return str(annotation).removesuffix(_MISSING)


def _port(name: str, annotation: object, function: Callable[..., object]) -> Port:
    written, wanted = str(annotation), port_type(name)
    if written.removesuffix(_MISSING) != wanted:
        raise TypeError(f"{function.__qualname__}: port {name!r} is a {wanted}, not a {written}")
    return Port(name=name, type=wanted, optional=written.endswith(_MISSING))


@dataclass(frozen=True, slots=True)
class Condition:
    """What a frame must meet for a node to run.

    Attributes:
        name: as pipeline files write it.
        description: in words.
        test: takes ports, as a node does; a frame that lacks one of them does not meet it.
    """

    name: str
    description: str
    test: Callable[..., bool]

    def met(self, values: FrameValues) -> bool:
        """Whether a frame meets it."""
        inputs = [getattr(values, port.name) for port in ports_of(self.test)]
        return all(value is not None for value in inputs) and self.test(*inputs)


class Node:
    """One step of the graph. Subclasses define `__call__` with annotated ports as parameters.

    A parameter that may be None is an optional input; the node does not run on a frame that lacks
    another one. A node that takes the port it writes is an operation on that value; several nodes
    that write a port without taking it are alternatives, of which the first that can run does.

    Class attributes:
        name: unique; in pipeline files and in timings.
        writes: the port that gets what `__call__` returns.
        effect: the effect that it simulates, or none; it is built where that is called for.
        lane: the thread it runs on.
        once: whether it helps to find the lens: run until that is known, not on each frame.
        when: what a frame must meet.
        skip_if: a port that a frame must not hold.
        stateful: whether its result depends on earlier frames; such a node takes `picture` alone,
            and sees the frames before a range too.

    Attributes:
        description: what runs it, in words.
    """

    name: ClassVar[str]
    writes: ClassVar[str]
    effect: ClassVar[str | None] = None
    lane: ClassVar[Lane] = "render"
    once: ClassVar[bool] = False
    when: ClassVar[Condition | None] = None
    skip_if: ClassVar[str | None] = None
    stateful: ClassVar[bool] = False
    description: str = ""

    def __init_subclass__(cls, **keywords: Any) -> None:  # noqa: ANN401  object's own signature
        super().__init_subclass__(**keywords)
        if output_type(cls.call_function()) != port_type(cls.writes):
            raise TypeError(f"{cls.__name__} does not return a {port_type(cls.writes)}")

    @classmethod
    def call_function(cls) -> Callable[..., object]:
        """`__call__`, whose signature says which ports the node takes."""
        found: Callable[..., object] = cls.__dict__["__call__"]
        return found

    @classmethod
    def inputs(cls) -> tuple[Port, ...]:
        """The ports it takes."""
        return ports_of(cls.call_function())

    @classmethod
    def is_operation(cls) -> bool:
        """Whether it changes a value rather than making it."""
        return any(port.name == cls.writes for port in cls.inputs())

    def runs_on(self, values: FrameValues) -> bool:
        """Whether a frame needs the node."""
        if any(getattr(values, port.name) is None for port in self.inputs() if not port.optional):
            return False
        if self.skip_if is not None and getattr(values, self.skip_if) is not None:
            return False
        if not self.is_operation() and getattr(values, self.writes) is not None:
            return False
        return self.when is None or self.when.met(values)

    def arguments(self, values: FrameValues) -> list[object]:
        """What it is called with."""
        return [getattr(values, port.name) for port in self.inputs()]

    def run(self, *arguments: object) -> object:
        """Call it with its ports."""
        call: Callable[..., object] = self  # type: ignore[assignment]  # subclasses are callable
        return call(*arguments)

    def warm_up(self) -> None:
        """Compile or load what the first frame would wait for; by default nothing."""
