"""Console output: progress, plan, fit and summary, as text or as JSON."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from typing import TYPE_CHECKING

from msgspec.structs import asdict
from rich.console import Console as RichConsole

from nlens_video.core import signals
from nlens_video.core.errors import NlensError, OutputError, ReaderGone
from nlens_video.core.stdio import escape_controls, print_out, standard_error

if TYPE_CHECKING:
    from pathlib import Path

    from nlens_video.cameras.solved import SolvedCamera
    from nlens_video.effects.planner import Decision
    from nlens_video.farm.chunk import Chunk
    from nlens_video.farm.merge import Merged
    from nlens_video.graph.base.profiler import Summary
    from nlens_video.run.find_fit import FitOutcome
    from nlens_video.run.render import RunResult

OnProgress = Callable[[int, int | None], None]


class Console:
    """Writes messages to standard error; JSON and plans to standard output, where it is free.

    What it shows as a result is written: from then on a signal comes too late to end the run.

    Args:
        quiet: errors only.
        verbose: every reason and figure.
        as_json: results as JSON on standard output.
        progress: whether a progress bar may be shown.
        stdout_taken: whether the video goes to standard output.
        progress_lines: whether progress is told as lines of JSON in place of a bar.
    """

    def __init__(
        self, *, quiet: bool, verbose: bool, as_json: bool, progress: bool, stdout_taken: bool,
        progress_lines: bool = False,
    ) -> None:  # fmt: skip
        self._quiet = quiet
        self._verbose = verbose
        self._json = as_json
        self._console = RichConsole(file=standard_error(), highlight=False)
        self._progress = progress and not quiet and self._console.is_terminal
        self._lines = progress_lines
        self._results = sys.stderr if stdout_taken else sys.stdout

    @contextmanager
    def progress_bar(self, what: str = "compositing") -> Iterator[OnProgress]:
        """A progress bar; yields a function of (frames done, frames in all or None).

        Args:
            what: label of the bar from the first frame on.
        """
        if self._lines:
            yield partial(_progress_line, what)
            return
        if not self._progress:
            yield lambda done, total: None
            return
        from nlens_video.cli.progress_bar import progress_bar  # loads much of Rich

        with progress_bar(self._console, what) as on_progress:
            yield on_progress

    def plan(self, lines: Sequence[str]) -> None:
        """Show the resolved graph."""
        if self._json:
            self._emit({"plan": list(lines)})
        else:
            print_out("".join(f"{escape_controls(line)}\n" for line in lines), self._results)

    def fit(self, outcome: FitOutcome) -> None:
        """Show a fit that was saved."""
        signals.complete()
        if self._json:
            self._emit({"fit": asdict(outcome.fit), "saved": str(outcome.path)})
        elif not self._quiet:
            self._say("lens", outcome.fit.describe())
            self._notes(outcome.notes)
            self._say("saved", str(outcome.path))

    def camera(self, path: Path, camera: SolvedCamera) -> None:
        """Show a plate's camera that was saved."""
        signals.complete()
        from nlens_video.cameras.doubt import doubt, missed  # compiled kernels load with it

        first, errors = camera.keys[0], camera.errors
        if self._json:
            self._emit({"saved": str(path), "camera": json.loads(camera.to_json())})
        elif not self._quiet:
            frames = "all frames" if len(camera.keys) == 1 else f"{len(camera.keys)} frames"
            self._say(
                "camera",
                f"field of view {first.fov_x_deg:.1f} ± {errors.fov_deg:.1f} degrees "
                f"({camera.fov_source}), pitch {first.pitch_deg:z.1f} ± {errors.pitch_deg:.1f}, "
                f"roll {first.roll_deg:z.1f} ± {errors.roll_deg:.1f} ({camera.horizon})",
            )
            self._say("path", f"{camera.path}, {frames}, scale {camera.scale}; {camera.method}")
            for text in filter(None, (doubt(camera), missed(camera))):
                self._say("note", text)
            self._say("saved", str(path))

    def note(self, text: str) -> None:
        """Show a note."""
        if not self._quiet:
            self._say("note", text)

    def choices(self, path: Path, options: tuple[str, ...]) -> None:
        """Show that a contact sheet was written, and the options of each of its pictures."""
        signals.complete()
        if self._json:
            self._emit({"saved": str(path), "choices": options})
        elif not self._quiet:
            self._say("saved", str(path))
            for number, line in enumerate(options, start=1):
                self._say(str(number), line)

    def chunk(self, chunk: Chunk) -> None:
        """Show a chunk that was rendered, or was there."""
        if self._json:
            rendered = None if chunk.result is None else chunk.result.as_json()
            self._emit({"chunk": str(chunk.path), "outcome": rendered})
        elif chunk.result is not None:
            self.outcome(chunk.result)
        elif not self._quiet:
            self._say("chunk", f"{chunk.path} is there already")

    def merged(self, merged: Merged) -> None:
        """Show the result of a merge."""
        signals.complete()
        if self._json:
            self._emit(asdict(merged))
        elif not self._quiet:
            where = "standard output" if merged.output == "-" else merged.output
            chunks = "1 chunk" if merged.chunks == 1 else f"{merged.chunks} chunks"
            self._say("merged", f"{where}, {merged.frames} frames of {chunks}")
            self._notes(merged.notes)

    def shots(self, results: Sequence[tuple[str, Merged | NlensError]]) -> None:
        """Show the result of each shot of a list by number and plate; errors even with `quiet`."""
        signals.complete()
        if self._json:
            self._emit(
                [
                    {"shot": name, "error": str(one)}
                    if isinstance(one, NlensError)
                    else {"shot": name, **asdict(one)}
                    for name, one in results
                ]
            )
        for number, (name, one) in enumerate(results, 1):
            if isinstance(one, NlensError):
                text = escape_controls(f"nlens-video: shot {number} ({name}): {one}")
                self._console.print(text, markup=False, soft_wrap=True, highlight=False)
            elif not self._json and not self._quiet:
                self.merged(one)

    def outcome(self, outcome: RunResult) -> None:
        """Show the result of a run."""
        signals.complete()
        if self._json:
            self._emit(outcome.as_json())
        elif not self._quiet:
            self._summary(outcome)

    def _summary(self, outcome: RunResult) -> None:
        timing = outcome.timing
        where = "standard output" if outcome.output == "-" else outcome.output
        count, changed = timing.frames, outcome.composited
        told = (
            f"{count} frames, {changed} of them changed"
            if count != 1
            else (f"1 frame{'' if changed else ', unchanged'}")
        )
        self._say("wrote", f"{where}, {told}")
        self._say("lens", outcome.fit.describe() if outcome.fit else _no_lens(outcome.decisions))
        self._effects(outcome.decisions)
        if self._verbose:
            nodes = ", ".join(f"{name} {ms:.1f}" for name, ms in timing.node_median_ms.items())
            self._say("ms", f"median of each node: {nodes}")
        self._frame_times(timing)
        if timing.latency_median_ms:
            self._say(
                "live",
                f"from decoding to writing {timing.latency_median_ms:.0f} ms in the median, "
                f"p95 {timing.latency_p95_ms:.0f} ms; {timing.dropped} late frames left out",
            )
        if outcome.damaged:
            self._say("note", f"{outcome.damaged} damaged packets or frames in the source")
        self._notes(outcome.notes)

    def _frame_times(self, timing: Summary) -> None:
        if timing.frames == 1:  # no statistics: it has what is done once as well
            fitted = timing.first_frame_ms > 0
            spent_ms = timing.first_frame_ms if fitted else timing.median_ms
            self._say("frame", f"{spent_ms:.0f} ms{' with the fit' if fitted else ''}")
            return
        first = f", with the fit {timing.first_frame_ms:.0f} ms" if timing.first_frame_ms else ""
        self._say(
            "frame",
            f"median {timing.median_ms:.1f} ms, p95 {timing.p95_ms:.1f} ms{first}; "
            f"{timing.within_budget:.0%} within {timing.budget_ms:g} ms; {timing.fps:.1f} fps",
        )

    def _effects(self, decisions: Sequence[Decision]) -> None:
        for decision in decisions:
            if decision.wanted or self._verbose:
                state = "on" if decision.wanted else "off"
                self._say("effect", f"{decision.effect} {state}: {decision.reason}")
        off = [decision.effect for decision in decisions if not decision.wanted]
        if off and not self._verbose:
            self._say("effect", f"off: {', '.join(off)} (-v says why)")

    def _notes(self, notes: Sequence[str]) -> None:
        for note in notes:
            self._say("note", note)

    def _say(self, label: str, text: str) -> None:
        self._console.print(escape_controls(f"{label:7}{text}"), markup=False, soft_wrap=True)

    def _emit(self, value: object) -> None:
        print_out(json.dumps(value, indent=2) + "\n", self._results)


def _no_lens(decisions: Sequence[Decision]) -> str:
    """Why a run has no lens."""
    off = any(one.effect == "defocus" and not one.wanted for one in decisions)
    return "none: defocus is off" if off else "none: no object in view"


def _progress_line(what: str, done: int, total: int | None) -> None:
    """Tell the program that started this run; once that is gone, end as by Ctrl-C."""
    if sys.stderr is None:
        return
    line = json.dumps({"progress": what, "frames": done, "of": total})
    try:
        print_out(f"{line}\n", sys.stderr)
    except ReaderGone as gone:
        raise KeyboardInterrupt from gone
    except OutputError:
        pass  # a full disk, say, is no reason to end
