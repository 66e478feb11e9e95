"""Results of a run, for the command line and for `--json`."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from nlens_video.core.lens_fit import LensFit
from nlens_video.effects.planner import Decision
from nlens_video.graph.base.profiler import Summary


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
