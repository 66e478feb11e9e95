"""Result of a run and its sidecar outputs (fit, timings, AOVs, report), which may fail apart."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from nlens_video.core.errors import OutputError
from nlens_video.core.lens_fit import LensFit
from nlens_video.effects.planner import Decision
from nlens_video.graph.base.profiler import FrameTiming, Summary
from nlens_video.graph.executor import FrameState
from nlens_video.run.observers import BaseObserver, Observer


@dataclass(frozen=True, slots=True, kw_only=True)
class RunResult:
    """The result of `render`.

    Attributes:
        output: what was written.
        fit: the lens fit, None where the object was never in view.
        decisions: of each effect, whether it was simulated and why.
        timing: statistics of the frame times.
        composited: frames on which the object was in view [1].
        damaged: packets and frames of the source that were damaged [1].
        notes: for the user.
        missing: sidecar outputs that could not be written, and why.
    """

    output: str
    fit: LensFit | None
    decisions: tuple[Decision, ...]
    timing: Summary
    composited: int
    damaged: int
    notes: tuple[str, ...]
    missing: tuple[str, ...] = ()

    def as_json(self) -> dict[str, Any]:
        """Plain data for JSON."""
        return {**asdict(self), "timing": {**asdict(self.timing), "fps": self.timing.fps}}


@dataclass(frozen=True, slots=True, kw_only=True)
class FitOutcome:
    """The result of `fit`: fit and file, notes and missing sidecar outputs as in `RunResult`."""

    fit: LensFit
    path: Path
    notes: tuple[str, ...]
    missing: tuple[str, ...] = ()


class SidecarOutputs(BaseObserver):
    """Several observers as one; an observer that fails to write is dropped.

    Args:
        observers: that write files.
    """

    def __init__(self, observers: Sequence[Observer]) -> None:
        self._observers = tuple(observers)  # replaced, never changed: two threads read it
        self._missing: list[str] = []
        self._stack = ExitStack()

    @property
    def missing(self) -> tuple[str, ...]:
        """One line for each output that could not be written so far, with the reason."""
        return tuple(self._missing)

    def __enter__(self) -> Self:
        with ExitStack() as entered:
            for one in self._observers:
                entered.enter_context(one)
            self._stack = entered.pop_all()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._stack.__exit__(kind, error, trace)

    def on_frame_start(self, state: FrameState) -> None:
        """A frame was decoded; called on the decoding thread."""
        for one in self._observers:
            one.on_frame_start(state)

    def frame(self, state: FrameState, timing: FrameTiming) -> None:
        """A frame was written."""
        for one in self._observers:
            with self._dropped_on_error(one):
                one.frame(state, timing)

    def finish(self, summary: Summary, notes: tuple[str, ...]) -> None:
        """The result is complete."""
        for one in self._observers:
            with self._dropped_on_error(one):
                one.finish(summary, notes)

    @contextmanager
    def _dropped_on_error(self, one: Observer) -> Iterator[None]:
        """Drop an observer that cannot write."""
        try:
            yield
        except (OutputError, OSError) as error:
            with suppress(OutputError, OSError):  # the same full disk again
                one.__exit__(type(error), error, error.__traceback__)
            self._observers = tuple(other for other in self._observers if other is not one)
            reason = error.strerror if isinstance(error, OSError) else str(error)
            self._missing.append(f"{one.what}: {reason or error}")


def check_sidecars(result: str, missing: Sequence[str]) -> None:
    """Fail a command whose result is complete but whose sidecar outputs are not.

    Args:
        result: name of the result.
        missing: as of `SidecarOutputs`.

    Raises:
        OutputError: a sidecar output is missing.
    """
    if missing:
        raise OutputError(
            f"{result} is complete, but not what was asked for beside it: " + "; ".join(missing)
        )


@contextmanager
def note_on_complete_result(result: str) -> Iterator[None]:
    """Add to an error that the result is complete."""
    try:
        yield
    except BaseException as error:
        error.add_note(f"{result} is complete")
        raise
