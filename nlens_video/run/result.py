"""How a run went: what the command line shows and scripts read."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from nlens_video.core.lens_fit import LensFit
from nlens_video.effects.planner import Decision
from nlens_video.graph.base.profiler import Summary


@dataclass(frozen=True, slots=True, kw_only=True)
class RunResult:
    """How a run went.

    Attributes:
        output: what was written.
        fit: the lens, None where the object was never in view.
        decisions: which effects were simulated, and why.
        timing: the frames in a few numbers.
        composited: frames on which the object was in view [1].
        damaged: packets and frames of the source that were damaged [1].
        notes: what a person should know.
        missing: what was asked for beside the result and could not be written, and why.
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
        """For scripts."""
        return {**asdict(self), "timing": {**asdict(self.timing), "fps": self.timing.fps}}


@dataclass(frozen=True, slots=True, kw_only=True)
class FitOutcome:
    """A lens fit, where it was saved, what a person should know, and what is missing beside it."""

    fit: LensFit
    path: Path
    notes: tuple[str, ...]
    missing: tuple[str, ...] = ()
