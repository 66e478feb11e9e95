"""The progress bar on a terminal: one line, with as many of its parts as fit."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager

from rich.console import Console
from rich.progress import (
    BarColumn,
    Progress,
    ProgressColumn,
    Task,
    TaskProgressColumn,
    TextColumn,
    TimeRemainingColumn,
)
from rich.table import Table

_BARS = (40, 20, 10)
"""Widths of the bar, from the first that fits [characters]."""
_UNBOUNDED = 1000  # characters: a line in which nothing is cut


@contextmanager
def progress_bar(console: Console, what: str) -> Iterator[Callable[[int, int | None], None]]:
    """A progress bar; yields a function of (frames done, frames in all or None).

    Args:
        console: on a terminal.
        what: label of the bar from the first frame on.
    """
    with _Line(console) as bar:
        task = bar.add_task("starting", total=None, frames="", rate="")

        def on_progress(done: int, total: int | None) -> None:
            if not done:  # a farm reports the total first
                bar.update(task, total=total)
                return
            elapsed = bar.tasks[0].elapsed or 0.0
            bar.update(
                task, completed=done, total=total, description=what,
                frames="1 frame" if done == 1 else f"{done} frames",
                rate=f", {done / elapsed:.1f} fps" if elapsed > 0 else "",
            )  # fmt: skip

        yield on_progress


class _Line(Progress):
    """Progress in one line, from which parts are left out until the others are whole."""

    def __init__(self, console: Console) -> None:
        self._terminal, self._layouts = console, tuple(_layouts())  # its base draws as it begins
        super().__init__(
            console=console,
            transient=True,
            redirect_stdout=False,  # the output of libraries goes to standard error as it is
            redirect_stderr=False,
        )

    def make_tasks_table(self, tasks: Iterable[Task]) -> Table:
        """The line with the most parts that the terminal has room for; with the fewest else."""
        tasks = list(tasks)
        unbounded = self._terminal.options.update_width(_UNBOUNDED)
        for columns in self._layouts:
            self.columns = columns
            table = super().make_tasks_table(tasks)
            if self._terminal.measure(table, options=unbounded).maximum <= self._terminal.width:
                break
        return table


def _layouts() -> Iterator[tuple[ProgressColumn, ...]]:
    """Columns of the line, each set of them shorter than the one before."""
    what, share = TextColumn("{task.description}"), TaskProgressColumn()
    pace = TextColumn("{task.fields[frames]}{task.fields[rate]}")
    frames, left = TextColumn("{task.fields[frames]}"), TimeRemainingColumn(compact=True)
    for width in _BARS:
        yield what, BarColumn(width), share, pace, left
    yield what, share, pace, left
    yield what, share, frames, left
    yield what, share, left
    yield what, share
