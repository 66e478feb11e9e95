"""Following a lens that changes: a pass over a file that finds where, and fits there.

The watch (`stages.lens_watch`) sees every third frame and decides where the lens must be found
anew; only there the network runs. A file whose lens stays as it is costs that pass and nothing
more: its lens is found in the run itself, as ever.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

from nlens_video.core import signals
from nlens_video.core.errors import LensFitError
from nlens_video.core.layers import Picture
from nlens_video.core.lens_fit import LensFit
from nlens_video.core.settings import Settings
from nlens_video.effects.planner import requested_effects
from nlens_video.graph.base.profiler import Profiler
from nlens_video.run.open_run import frame_s, open_run, opened
from nlens_video.stages.r_change_detector import CHANGED, Signature, changed, is_cut, signature
from nlens_video.stages.r_lens_track import FitTrack, Keyframe, hold_segments
from nlens_video.video.info import SourceFrame
from nlens_video.video.input.open import can_be_read_again
from nlens_video.video.input.source import Source

_EVERY = 3  # frames from one look to the next
_SPACING_S = 0.16  # least time between two fits of one shot
_STRETCH_S = 0.2  # over which fits are smoothed
_SETTLED_S = 0.5  # after so much time a smaller change is looked into, too
_SETTLED_CHANGE = 0.4 * CHANGED
_SURE = 3.0  # standard errors by which a fit of doubtful sign may differ from the one before


@dataclass(frozen=True, slots=True)
class FitRequest:
    """A frame on which the lens must be found.

    Attributes:
        index: of the frame [1].
        shot: number of the shot [1].
    """

    index: int
    shot: int


def lens_track_pass(
    settings: Settings, on_counted: Callable[[int], None] = lambda frames: None
) -> FitTrack | None:
    """Find the lens of a file all along it.

    Args:
        settings: of the run; `track_focus` says how. A stream, which can be read only once, is
            not followed here, nor is a still.
        on_counted: called with the number of frames up to the end of the range, if they were read.

    Returns:
        The track; None where the lens does not change, or is not to be followed.

    Raises:
        NlensError: as `run.render`.
    """
    if (
        settings.track_focus == "off"
        or settings.fit is not None
        or not requested_effects(settings.effects)
        or settings.source.one_frame  # whose lens is found on itself
    ):
        return None
    if not can_be_read_again(settings.source.spec):
        return None
    with opened(settings.source) as source:
        if source.info.kind not in ("video", "sequence"):
            return None
        seconds = frame_s(source.info) or 1 / 25
        every = settings.track_focus if isinstance(settings.track_focus, int) else None
        end = settings.source.frames[1]
        seen = _Seen(source, end)
        needs = tuple(_needs(seen.pictures(), _Times.of(seconds), every))
    on_counted(seen.count)
    if len(needs) < 2:
        return None
    keys = tuple(_keys(settings, needs))
    if len(keys) < 2:
        return None
    spacing = max(1, round(_SPACING_S / seconds))
    cuts = [need.index for before, need in zip(needs[:-1], needs[1:], strict=True)
            if need.shot != before.shot]  # fmt: skip
    return FitTrack(
        hold_segments(keys, spacing, seen.count), max(1.0, _STRETCH_S / seconds), tuple(cuts)
    )


@dataclass(frozen=True, slots=True)
class _Times:
    """Times in frames."""

    spacing: int
    settled: int

    @classmethod
    def of(cls, frame_s: float) -> _Times:
        return cls(max(1, round(_SPACING_S / frame_s)), max(2, round(_SETTLED_S / frame_s)))


class _Seen:
    """The frames of a source up to an end, counted."""

    def __init__(self, source: Source, end: int | None) -> None:
        self._source = source
        self._end = end
        self.count = 0

    def pictures(self) -> Iterator[tuple[int, Picture]]:
        """Number and picture of each."""
        for frame in self._source:
            if self._end is not None and frame.index >= self._end:
                return
            signals.check()
            self.count = frame.index + 1
            yield frame.index, frame.picture


def _needs(
    pictures: Iterator[tuple[int, Picture]], times: _Times, every: int | None
) -> Iterator[FitRequest]:
    """Frames on which the lens must be found: the first, after cuts, and where the blur changed."""
    shot, last = 0, 0
    reference = before = None
    skipped: list[tuple[int, Picture]] = []
    for index, picture in pictures:
        if reference is None or before is None:
            reference = before = signature(picture)
            last = index
            yield FitRequest(index, shot)
            continue
        if (index - last) % _EVERY and every is None:
            skipped.append((index, picture))
            continue
        now = signature(picture)
        if is_cut(before, now):
            shot, last = shot + 1, _first_after_cut(before, now, skipped, index)
            reference = now
            yield FitRequest(last, shot)
        elif _asks(reference, now, index - last, times, every):
            reference, last = now, index
            yield FitRequest(index, shot)
        before = now
        skipped.clear()


def _first_after_cut(
    before: Signature, after: Signature, skipped: list[tuple[int, Picture]], index: int
) -> int:
    """Of the frames between two looks and the latter, the first of the new shot."""
    for at, picture in skipped:
        here = signature(picture)
        if abs(here.light - after.light).mean() < abs(here.light - before.light).mean():
            return at
    return index


def _asks(
    reference: Signature, now: Signature, since: int, times: _Times, every: int | None
) -> bool:
    if every is not None:
        return since >= every
    change = changed(reference, now)
    if since >= times.settled:
        return change > _SETTLED_CHANGE
    return since >= times.spacing and change > CHANGED


def _keys(settings: Settings, needs: tuple[FitRequest, ...]) -> Iterator[Keyframe]:
    """The lens at each frame that needs it; where it cannot be found there is none."""
    wanted = {need.index: need for need in needs}
    ranged = replace(settings.source, frames=(0, max(wanted) + 1))
    run = replace(settings, source=ranged, effects="defocus", fallback="none")
    known: LensFit | None = None
    with open_run(run, Profiler()) as intake:
        steps = intake.session.executor
        # no frames ahead: their mean would lag behind a lens that changes
        for item, _ in intake.frames.iterate(lambda: False):
            if not isinstance(item, SourceFrame) or item.index not in wanted:
                continue
            signals.check()
            state = steps.begin_frame(item)
            try:
                fit = steps.find_lens(state)
            except LensFitError:
                continue
            finally:
                steps.profiler.close_frame(item.index, 0)
            if fit is None or (known is not None and _doubtful(known, fit)):
                continue
            known = fit
            need = wanted[item.index]
            yield Keyframe(need.index, need.shot, fit)


def _doubtful(known: LensFit, fit: LensFit) -> bool:
    """Whether a fit may have taken the wrong side of the focus."""
    if fit.sign == "resolved":
        return False
    error = max(fit.intercept_stderr, known.intercept_stderr)
    return abs(fit.intercept - known.intercept) > _SURE * error
