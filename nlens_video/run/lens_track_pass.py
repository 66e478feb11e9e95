"""Focus and zoom tracking: a first pass over a file detects lens changes and fits each of them.

A lens that rests, as a first look at the file tells (`run.first_look`), is fitted in the run
itself. Else the change detector (`stages.r_lens_change`) measures every third frame, and the CoC
network runs only on the frames where it reports a change.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from itertools import groupby, pairwise, takewhile

from msgspec import Struct
from msgspec.structs import replace

from nlens_video.core import signals
from nlens_video.core.errors import LensFitError
from nlens_video.core.layers import Picture
from nlens_video.core.lens_fit import LensFit
from nlens_video.core.settings import Settings
from nlens_video.graph.base.profiler import Profiler
from nlens_video.run.first_look import FirstLook, first_look, follows_lens
from nlens_video.run.open_run import open_run
from nlens_video.run.plate_source import frame_s, opened
from nlens_video.run.shot_slope import ShotSlope
from nlens_video.stages.r_lens_change import (
    CHANGED,
    SPACING_S,
    Signature,
    calls_for_fit,
    changed,
    differs,
    is_cut,
    signature,
    stands_still,
)
from nlens_video.stages.r_lens_track import FitTrack, Keyframe, hold_segments, share_slope
from nlens_video.video.info import SourceFrame

_EVERY = 3  # frames between two signatures
_SMOOTHING_S = 0.1  # standard deviation of the smoothing of fits over time [s]
_BEGUN = 0.3 * CHANGED  # less than this is noise, and the lens rests
_QUICK = 2.0 * CHANGED  # from one look to the next: the focus is racked
_MOST_BETWEEN = 8  # frames kept from where a change begins to where it is told
_MOST_DEVIATION = 3.0  # of a fit of unresolved sign from the one before [standard error]


class FitRequest(Struct, frozen=True):
    """A frame on which the lens is fitted.

    Attributes:
        index: of the frame [1].
        shot: number of the shot [1].
        seen: its signature.
        until: last frame seen on which the blur is still the same [1].
        quick: whether the blur changes so fast there that each frame is fitted.
    """

    index: int
    shot: int
    seen: Signature
    until: int
    quick: bool = False


def lens_track_pass(settings: Settings, look: FirstLook | None = None) -> FitTrack | None:
    """Fit the lens over the length of a file.

    Args:
        settings: of the run; `track_focus` sets the interval. Streams, which can be read only
            once, and stills are not tracked.
        look: the first look at the file; default: it is taken.

    Returns:
        The track; None where the lens does not change or tracking is off.

    Raises:
        NlensError: as `run.render`.
    """
    if not follows_lens(settings):
        return None
    look = look or first_look(settings)
    if look is not None and look.lens_rests:
        return None
    with opened(settings.source) as source:
        if source.info.kind not in ("video", "sequence"):
            return None
        seconds = frame_s(source.info) or 1 / 25
        every = settings.track_focus if isinstance(settings.track_focus, int) else None
        end = settings.source.frames[1]
        scan = _Scan(seconds, every)
        for frame in takewhile(lambda frame: end is None or frame.index < end, source):
            signals.check()
            scan.see(frame.index, frame.picture)
        scan.end_shot()
    requests = scan.requests
    if len(requests) < 2:
        return None
    # a focus that is given is that of one moment, of which nobody says which
    unfocused = replace(settings, lens=replace(settings.lens, focus_m=None))
    keyframes = _told_changes(tuple(_keyframes(unfocused, requests)), requests)
    if len(keyframes) < 2:
        return None
    spacing = max(1, round(SPACING_S / seconds))
    cuts = [after.index for before, after in pairwise(requests) if after.shot != before.shot]
    held = {request.index: request.until for request in requests}
    return FitTrack(
        hold_segments(keyframes, spacing, held),
        max(1.0, _SMOOTHING_S / seconds),
        tuple(cuts),
    )


class _Scan:
    """Chooses the frames to fit the lens on: the first of each shot, where it changed, the last.

    Args:
        frame_s: from one frame to the next, > 0 [s].
        every: frames from one fit to the next, None to fit where the blur changes [1].
    """

    def __init__(self, frame_s: float, every: int | None) -> None:
        self.requests: list[FitRequest] = []
        self._frame_s, self._every = frame_s, every
        self._before: FitRequest | None = None  # the last frame whose signature is known
        self._skipped: list[tuple[int, Picture]] = []  # frames after it
        self._between: list[FitRequest] = []  # since the last request, where a change has begun

    def see(self, index: int, picture: Picture) -> None:
        """Look at the next frame."""
        before = self._before
        if before is None:
            self._before = FitRequest(index, 0, signature(picture), index)
            self.requests.append(self._before)
            return
        last = self.requests[-1]
        if (index - last.index) % _EVERY and self._every is None:
            self._skipped.append((index, picture))
            return
        seen = signature(picture)
        cut = is_cut(before.seen, seen)
        quick = not cut and self._every is None and changed(before.seen, seen) > _QUICK
        now = FitRequest(index, last.shot, seen, index, quick)
        if quick:
            self._between += [
                replace(now, index=at, until=at, seen=signature(skipped))
                for at, skipped in self._skipped
            ]
        if cut:
            first = _first_after_cut(before.seen, now.seen, self._skipped, index)
            self._skipped = [item for item in self._skipped if item[0] < first]
            self.end_shot()
            self.requests.append(replace(now, index=first, shot=last.shot + 1))
        elif self._fitted_again(last, now):
            self._add(now)
        elif changed(last.seen, now.seen) < _BEGUN:
            self._rests(index)
        else:
            self._between.append(now)
            del self._between[:-_MOST_BETWEEN]
        self._before = now
        self._skipped.clear()

    def _fitted_again(self, last: FitRequest, now: FitRequest) -> bool:
        since = now.index - last.index
        if self._every is not None:
            return since >= self._every
        return calls_for_fit(last.seen, now.seen, since, self._frame_s)

    def end_shot(self) -> None:
        """Add the last frame of a shot in which the lens changes, unless it has come to rest."""
        now = self._before
        if now is not None and len(self.requests) > 1 and self.requests[-2].shot == now.shot:
            if self._skipped:
                index, picture = self._skipped[-1]
                now = FitRequest(index, now.shot, signature(picture), index)
            if changed(self.requests[-1].seen, now.seen) < _BEGUN:
                self._rests(now.index)
            elif now.index > self.requests[-1].index:
                self._add(now)
        self._between.clear()

    def _add(self, request: FitRequest) -> None:
        last = self.requests[-1].index
        self.requests += _spaced([*self._between, request], last, self._frame_s)
        self._between.clear()

    def _rests(self, until: int) -> None:
        self.requests[-1] = replace(self.requests[-1], until=until)
        self._between.clear()


def _spaced(requests: list[FitRequest], last: int, frame_s: float) -> Iterator[FitRequest]:
    """Those requests that are far enough from the one before them, quick ones, and the last."""
    spacing = max(1, round(SPACING_S / frame_s))
    for request in requests:
        if request.quick or request.index - last >= spacing or request is requests[-1]:
            last = request.index
            yield request


def _first_after_cut(
    before: Signature, after: Signature, skipped: list[tuple[int, Picture]], index: int
) -> int:
    """The first frame of the new shot: one of the skipped frames, or the one at `index`."""
    for at, picture in skipped:
        skipped_one = signature(picture)
        if (
            abs(skipped_one.light - after.light).mean()
            < abs(skipped_one.light - before.light).mean()
        ):
            return at
    return index


def _keyframes(settings: Settings, requests: list[FitRequest]) -> Iterator[Keyframe]:
    """The lens fit of each request, left out where it fails or its sign is not to be trusted."""
    wanted = {request.index: request for request in requests}
    ranged = replace(settings.source, frames=(0, max(wanted) + 1))
    run = replace(settings, source=ranged, effects="defocus", fallback="none")
    known: LensFit | None = None
    slopes: defaultdict[int, ShotSlope] = defaultdict(ShotSlope)
    with open_run(run, Profiler()) as run_input:
        executor = run_input.session.executor
        # no lookahead: the mean of later frames would lag behind a lens that changes
        for item in run_input.frames:
            if not isinstance(item, SourceFrame) or item.index not in wanted:
                continue
            signals.check()
            state = executor.begin_frame(item)
            shot = wanted[item.index].shot
            try:
                fit = executor.find_lens(state, "several")
            except LensFitError:
                continue
            finally:
                executor.profiler.close_frame(item.index, 0)
            if state.values.found_lens is not None:
                fit = slopes[shot].lend(state.values.found_lens)
            if fit is None or (known is not None and _doubtful(known, fit)):
                continue
            known = fit
            yield Keyframe(item.index, shot, fit)


def _told_changes(keys: tuple[Keyframe, ...], requests: list[FitRequest]) -> tuple[Keyframe, ...]:
    """All keys of the shots in which the lens changes, the first key of the others."""
    seen = {request.index: request.seen for request in requests}
    kept: list[Keyframe] = []
    for _, group in groupby(keys, key=lambda key: key.shot):
        first, *others = group
        told = [
            differs(first.fit, key.fit, still=stands_still(seen[first.index], seen[key.index]))
            for key in others
        ]
        # one fit alone may be of a passing thing, unless the change comes last
        changes = sum(told) > 1 or (bool(told) and told[-1])
        kept += share_slope([first, *others]) if changes else [first]
    return tuple(kept)


def _doubtful(known: LensFit, fit: LensFit) -> bool:
    """Whether a fit may lie on the wrong side of the focus."""
    if fit.sign == "resolved":
        return False
    error = max(fit.intercept_stderr, known.intercept_stderr)
    return abs(fit.intercept - known.intercept) > _MOST_DEVIATION * error
