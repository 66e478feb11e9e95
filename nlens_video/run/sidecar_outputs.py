"""What a run writes beside its result: none of it may cost the result."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager, suppress
from types import TracebackType
from typing import Self

from nlens_video.core.errors import OutputError
from nlens_video.graph.base.profiler import FrameTiming, Summary
from nlens_video.graph.executor import FrameState
from nlens_video.run.observers import BaseObserver, Observer


class Beside(BaseObserver):
    """Observers that write, as one; what cannot be written any more is left out from then on.

    Args:
        watching: they.
    """

    def __init__(self, watching: Sequence[Observer]) -> None:
        self._watching = tuple(watching)  # replaced, never changed: two threads look at it
        self._missing: list[str] = []
        self._stack = ExitStack()

    @property
    def missing(self) -> tuple[str, ...]:
        """What could not be written so far, and why, a line each."""
        return tuple(self._missing)

    def __enter__(self) -> Self:
        with ExitStack() as entered:
            for one in self._watching:
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
        """A frame comes in, not yet touched (on the decoding thread)."""
        for one in self._watching:
            one.on_frame_start(state)

    def frame(self, state: FrameState, timing: FrameTiming) -> None:
        """A frame was written."""
        for one in self._watching:
            with self._spared(one):
                one.frame(state, timing)

    def finish(self, summary: Summary, notes: tuple[str, ...]) -> None:
        """The result is complete."""
        for one in self._watching:
            with self._spared(one):
                one.finish(summary, notes)

    @contextmanager
    def _spared(self, one: Observer) -> Iterator[None]:
        """Go on without an observer that cannot write."""
        try:
            yield
        except (OutputError, OSError) as error:
            with suppress(OutputError, OSError):  # a second word on the same full disk
                one.__exit__(type(error), error, error.__traceback__)
            self._watching = tuple(other for other in self._watching if other is not one)
            reason = error.strerror if isinstance(error, OSError) else str(error)
            self._missing.append(f"{one.what}: {reason or error}")


def tell_missing(result: str, missing: Sequence[str]) -> None:
    """End a command whose result is complete, and what belongs beside it not.

    Args:
        result: what is complete.
        missing: as of `Beside`.

    Raises:
        OutputError: something is missing.
    """
    if missing:
        raise OutputError(
            f"{result} is complete, but not what was asked for beside it: " + "; ".join(missing)
        )


@contextmanager
def telling_what_is_complete(result: str) -> Iterator[None]:
    """Say of a result that is complete that it is, to whoever hears of an interruption."""
    try:
        yield
    except BaseException as error:
        error.add_note(f"{result} is complete")
        raise
