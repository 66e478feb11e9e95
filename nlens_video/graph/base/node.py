"""Nodes of the frame graph: typed callables whose parameters are their input ports."""

from __future__ import annotations

import inspect
from collections.abc import Callable
from functools import cache
from typing import TYPE_CHECKING, Any, ClassVar, Literal, get_args

from msgspec import Struct

from nlens_video.graph.base.values import FrameValues
from nlens_video.kernels.coc_discontinuities import STEP_PX
from nlens_video.stages.l_reblur import NEGLIGIBLE_COC_PX

if TYPE_CHECKING:
    from nlens_video.core.layers import Box, DefocusedLayer
    from nlens_video.core.lens_fit import LensFit
    from nlens_video.graph.base.context import NodeContext
    from nlens_video.graph.base.view import ScreenBounds

Lane = Literal["render", "composite"]
LANES: tuple[Lane, ...] = get_args(Lane)
"""Pipeline stages of the scheduler, one thread each, in the order in which a frame passes them."""
_MISSING = " | None"


class Unavailable(Exception):
    """A node cannot be built in this installation or run; the message says why."""


class Port(Struct, frozen=True):
    """An input of a callable.

    Attributes:
        name: attribute of `FrameValues`.
        type: its annotation, without None.
        optional: whether the callable accepts None.
    """

    name: str
    type: str
    optional: bool


@cache
def ports_of(function: Callable[..., object]) -> tuple[Port, ...]:
    """The input ports of a callable, derived from its signature.

    Raises:
        TypeError: a parameter names no port, or its annotation is not the port's type.
    """
    parameters = inspect.signature(function).parameters
    return tuple(
        _port(name, parameter.annotation, function)
        for name, parameter in parameters.items()
        if name != "self"
    )


def port_type(name: str) -> str:
    """The type of a port, without None.

    Raises:
        TypeError: there is no such port.
    """
    annotation = FrameValues.__annotations__.get(name)
    if annotation is None:
        raise TypeError(
            f"{name!r} is not a port; ports are {', '.join(FrameValues.__annotations__)}"
        )
    return str(annotation).removesuffix(_MISSING)


def _port(name: str, annotation: object, function: Callable[..., object]) -> Port:
    written, wanted = str(annotation), port_type(name)
    if written.removesuffix(_MISSING) != wanted:
        raise TypeError(f"{function.__qualname__}: port {name!r} is a {wanted}, not a {written}")
    return Port(name=name, type=wanted, optional=written.endswith(_MISSING))


class Condition(Struct, frozen=True):
    """A predicate on a frame that decides whether a node runs.

    Attributes:
        name: as pipeline files write it.
        description: one phrase, for plans.
        test: takes ports as a node does; a frame without one of them fails it.
    """

    name: str
    description: str
    test: Callable[..., bool]

    def __post_init__(self) -> None:
        ports_of(self.test)

    def met(self, values: FrameValues) -> bool:
        """Whether a frame passes the test."""
        inputs = [getattr(values, port.name) for port in ports_of(self.test)]
        return all(value is not None for value in inputs) and self.test(*inputs)


LARGEST_MOMENTS = 257  # temporal samples of a frame that an option may ask for [1]


def _in_frame(bounds: ScreenBounds, frame_box: Box) -> bool:
    return not bounds.box.intersection(frame_box).empty


def _depth_steps(defocused: DefocusedLayer) -> bool:
    hides = defocused.behind is not None and not defocused.behind.box.empty
    return hides or defocused.largest_step_px >= STEP_PX


def _depth_range(bounds: ScreenBounds, fit: LensFit) -> bool:
    return fit.slope * (1.0 / bounds.nearest - 1.0 / bounds.farthest) >= STEP_PX


def _out_of_focus(defocused: DefocusedLayer) -> bool:
    return defocused.largest_coc_px >= NEGLIGIBLE_COC_PX


IN_FRAME = Condition("in-frame", "the object is in the frame", _in_frame)
DEPTH_STEPS = Condition(
    "depth-steps", f"the CoC steps by {STEP_PX} px inside the object", _depth_steps
)
DEPTH_RANGE = Condition("depth-range", f"the object's CoC spans {STEP_PX} px", _depth_range)
OUT_OF_FOCUS = Condition(
    "out-of-focus", f"the object's CoC reaches {NEGLIGIBLE_COC_PX} px", _out_of_focus
)


class Node:
    """A node of the frame graph. Subclasses define `__call__` with ports as its parameters.

    Ports are derived from the signature and checked when the class is created. A parameter that
    accepts None is an optional input; without a required input the node does not run on a frame.
    A node that reads the port it writes is an operation on that value: operations form a chain.
    Nodes that write a port without reading it are alternatives: the first that can run does.

    Class attributes:
        name: unique, as in pipeline files and timings.
        writes: the output port.
        effect: the effect that it simulates, or None; decides whether the node is built.
        lane: the thread that it runs on.
        once: whether it is part of finding the lens, and runs only until that is found.
        when: condition on the frame.
        skip_if: a port that disables the node on frames that hold it.
        round_only: whether it blurs by round discs, whatever the aperture.
        stateful: whether its result depends on earlier frames; such a node takes `picture` alone
            and also receives the frames before a range.
        same_with: input ports. Where they hold the very objects of the frame before, the result is
            that frame's too: nothing that the node looks at has moved. Empty if it always runs.
        ranges: option, least and largest value, for options that are numbers.
        choices: option and its values, for options that are texts.

    Attributes:
        description: method and backend in one phrase, for plans.
        notes: for the user, as of now.
    """

    name: ClassVar[str]
    writes: ClassVar[str]
    effect: ClassVar[str | None] = None
    lane: ClassVar[Lane] = "render"
    once: ClassVar[bool] = False
    when: ClassVar[Condition | None] = None
    skip_if: ClassVar[str | None] = None
    round_only: ClassVar[bool] = False
    stateful: ClassVar[bool] = False
    same_with: ClassVar[tuple[str, ...]] = ()
    ranges: ClassVar[tuple[tuple[str, float, float], ...]] = ()
    choices: ClassVar[tuple[tuple[str, tuple[str, ...]], ...]] = ()
    _read: ClassVar[tuple[str, ...]]
    _required: ClassVar[tuple[str, ...]]
    description: str = ""

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes for the user, as of now; none as a rule."""
        return ()

    def __init__(self, context: NodeContext) -> None:
        """Construct the node; subclasses that need none of its dependencies inherit this."""

    def __init_subclass__(cls, **keywords: Any) -> None:  # noqa: ANN401  object's own signature
        super().__init_subclass__(**keywords)
        ports = cls.inputs()
        cls._read = tuple(port.name for port in ports)
        cls._required = tuple(port.name for port in ports if not port.optional)
        unknown = set(cls.same_with) - set(cls._read)
        if unknown:
            raise TypeError(f"{cls.__name__}: same_with names {sorted(unknown)}, no inputs of it")
        annotation = inspect.signature(cls.call_function()).return_annotation
        returned, wanted = str(annotation).removesuffix(_MISSING), port_type(cls.writes)
        if returned != wanted:
            raise TypeError(
                f"{cls.__name__} returns {returned}, but its port {cls.writes!r} is a {wanted}"
            )

    @classmethod
    def call_function(cls) -> Callable[..., object]:
        """The class's own `__call__`.

        Raises:
            TypeError: the class defines none.
        """
        function: Callable[..., object] | None = vars(cls).get("__call__")
        if function is None:
            raise TypeError(f"{cls.__name__} defines no __call__")
        return function

    @classmethod
    def inputs(cls) -> tuple[Port, ...]:
        """The input ports."""
        return ports_of(cls.call_function())

    @classmethod
    def is_operation(cls) -> bool:
        """Whether the node reads the port that it writes."""
        return cls.writes in cls._read

    def runs_on(self, values: FrameValues) -> bool:
        """Whether the node runs on a frame with these values."""
        for name in self._required:
            if getattr(values, name) is None:
                return False
        if self.skip_if is not None and getattr(values, self.skip_if) is not None:
            return False
        if not self.is_operation() and getattr(values, self.writes) is not None:
            return False
        return self.when is None or self.when.met(values)

    def arguments(self, values: FrameValues) -> list[object]:
        """Values of the input ports."""
        return [getattr(values, name) for name in self._read]

    def run(self, *arguments: object) -> object:
        """Call the node with the values of its input ports."""
        call: Callable[..., object] = self  # type: ignore[assignment]  # subclasses are callable
        return call(*arguments)

    def warm_up(self) -> None:
        """Fill tables or load networks before the first frame; by default nothing."""
