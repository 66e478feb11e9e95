"""What a run has left behind when its report is written."""

from __future__ import annotations

from dataclasses import dataclass

from nlens_video.core.layers import DefocusedLayer
from nlens_video.core.lens_fit import LensFit
from nlens_video.graph.base.profiler import FrameTiming, Summary
from nlens_video.graph.base.values import ShotValues
from nlens_video.graph.session import Session
from nlens_video.report.downsampling import TimingBin
from nlens_video.report.pictures import Image
from nlens_video.stages.r_regression import Regression
from nlens_video.video.info import SourceInfo


@dataclass(frozen=True, slots=True, kw_only=True)
class Shown:
    """The frame that the page shows at length: the one that carried the fit, if there is one.

    Attributes:
        index: position in the source [1].
        time_s: moment of the animation [s].
        before: the plate.
        after: the composite, None where nothing was composited.
        defocused: the object and its CoC, None where it was left sharp or not drawn.
    """

    index: int
    time_s: float
    before: Image
    after: Image | None
    defocused: DefocusedLayer | None


@dataclass(frozen=True, slots=True, kw_only=True)
class StripFrame:
    """A composited frame in small.

    Attributes:
        index: position in the source [1].
        time_s: moment of the animation [s].
        jpeg: the picture.
        size: columns and rows of the frame itself [px].
        largest_coc_px: the object's greatest blur, None where it was left sharp [px].
    """

    index: int
    time_s: float
    jpeg: bytes
    size: tuple[int, int]
    largest_coc_px: float | None


@dataclass(frozen=True, slots=True, kw_only=True)
class Findings:
    """All that the page is made from.

    Attributes:
        info: the source.
        output: what was written, as the user gave it.
        session: graph, decisions and what the fit was made from.
        shown: the frame shown at length, None where the object was never in view.
        strip: composited frames, spread evenly.
        bins: timings of the frames, without `warm_up`.
        bin_width: frames per full bin [1].
        warm_up: the frame that carried the fit.
        summary: the run in a few numbers.
        notes: what a person should know.
    """

    info: SourceInfo
    output: str
    session: Session
    shown: Shown | None
    strip: tuple[StripFrame, ...]
    bins: tuple[TimingBin, ...]
    bin_width: int
    warm_up: FrameTiming | None
    summary: Summary
    notes: tuple[str, ...]

    @property
    def fit(self) -> LensFit | None:
        """The lens, once found or given."""
        return self.session.executor.fit

    @property
    def shot(self) -> ShotValues:
        """What the fit was made from."""
        return self.session.executor.shot

    @property
    def regression(self) -> Regression | None:
        """The fit with its samples, where it was made on this plate."""
        found = self.shot.found_lens
        return None if found is None else found.regression

    @property
    def doubt(self) -> str:
        """What a person should know about the fit; empty if nothing."""
        found = self.shot.found_lens
        return "" if found is None else found.warning
