"""A first look at a file, before its first frame is composited: one quick pass for all that asks.

Whether the lens rests and whether anything moves can only be told from the whole shot. Frames that
no other frame is predicted from are not decoded, and of the others a few each second are looked at.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager, suppress
from itertools import takewhile
from threading import Event

from msgspec import Struct

from nlens_video.core import signals
from nlens_video.core.layers import Picture
from nlens_video.core.settings import Settings
from nlens_video.effects.foreground.survey import StaticCameraSurvey
from nlens_video.effects.planner import OCCLUSION, EffectRequest
from nlens_video.graph.scheduler import begin_in_thread, run_workers
from nlens_video.run.plate_source import frame_s, opened
from nlens_video.stages.r_lens_change import Signature, calls_for_fit, is_cut, signature
from nlens_video.video.info import SourceFrame
from nlens_video.video.input.open import can_be_read_again

_EVERY_S = 0.2  # from one frame whose blur is measured to the next [s]


class FirstLook(Struct, frozen=True):
    """What one quick pass over a file has told.

    Attributes:
        lens_rests: whether the lens stays as it is on the first frame, as far as a run asks.
        survey: of what moves, as a still camera would see it; None where a run does not ask, or
            only a part was read.
    """

    lens_rests: bool
    survey: StaticCameraSurvey | None


def follows_lens(settings: Settings) -> bool:
    """Whether a run looks for changes of the lens: not on streams, which can be read only once."""
    return (
        settings.track_focus != "off"
        and settings.fit is None
        and len(EffectRequest.parse(settings.effects).possible) > 0
        and not settings.source.one_frame  # the run fits the lens on that frame
        and can_be_read_again(settings.source.spec)
    )


def _asks_what_moves(settings: Settings) -> bool:
    """Whether a run looks for what moves in front of the object, in the whole of a file.

    The view of a camera that moves is read when its path is known; it is of use here only where the
    lens is watched anyway.
    """
    real = settings.scene.real
    return (
        settings.output is not None
        and real.occlusion != "none"
        and real.holdout is None
        and real.found is None
        and settings.source.frames[1] is None
        and OCCLUSION in EffectRequest.parse(settings.effects).possible
        and can_be_read_again(settings.source.spec)
        and (settings.scene.camera_from is None or follows_lens(settings))
    )


@contextmanager
def begun_look(settings: Settings) -> Iterator[Callable[[], FirstLook | None]]:
    """A look on a thread of its own, which begins now and ends with the context at the latest.

    Yields:
        What waits for the look and returns it, as `first_look`.
    """
    left = Event()
    look = begin_in_thread(lambda: first_look(settings, left))
    try:
        yield look
    except BaseException:
        left.set()
        with suppress(BaseException):  # an interrupt too: the first error keeps its notes
            look()
        raise
    left.set()
    with suppress(Exception):  # of a look that nobody waits for
        look()


def first_look(settings: Settings, left: Event | None = None) -> FirstLook | None:
    """Look at a file whose lens may change, or in which something may move past the object.

    Args:
        settings: the run.
        left: set as soon as nobody waits for the look any more.

    Returns:
        What was seen; None where a run asks for neither, or `track_focus` is an interval.

    Raises:
        NlensError: as `run.render`.
    """
    watches_lens, surveys = follows_lens(settings), _asks_what_moves(settings)
    if not (watches_lens or surveys) or isinstance(settings.track_focus, int):
        return None
    end = settings.source.frames[1]
    with opened(settings.source, sparse=end is None) as source:
        info = source.info
        if info.kind not in ("video", "sequence"):
            return None
        lens = _LensWatch(frame_s(info) or 1 / 25) if watches_lens else None
        survey = StaticCameraSurvey((info.width, info.height)) if surveys else None
        frames = takewhile(lambda frame: end is None or frame.index < end, source)
        looks = [one for one in (lens, survey) if one is not None]
        with closing(run_workers(frames, ())) as decoded:
            for frame in decoded:
                signals.check()
                if left is not None and left.is_set():
                    return None
                for one in looks:
                    one.see(frame)
    return FirstLook(lens is None or lens.rests(), survey)


class _LensWatch:
    """Tells whether the lens stays as it is on the first frame.

    Args:
        frame_s: from one frame to the next, > 0 [s].
    """

    def __init__(self, frame_s: float) -> None:
        self._frame_s = frame_s
        self._first: tuple[float, Signature] | None = None
        self._before: Signature | None = None
        self._due_s = 0.0
        self._rests = True
        self._last: tuple[float, Picture] | None = None  # the last frame, unless it was measured

    def see(self, frame: SourceFrame) -> None:
        """Look at the next frame."""
        self._last = (frame.time_s, frame.picture)
        if self._rests and (self._first is None or frame.time_s >= self._due_s):
            self._measure(*self._last)

    def rests(self) -> bool:
        """Whether it rests on the frames seen, the last one included."""
        if self._rests and self._last is not None:
            self._measure(*self._last)
        return self._rests

    def _measure(self, time_s: float, picture: Picture) -> None:
        seen = signature(picture)
        if self._first is None or self._before is None:
            self._first = time_s, seen
        else:
            first_s, first = self._first
            frames = round((time_s - first_s) / self._frame_s)
            self._rests = not (
                is_cut(self._before, seen) or calls_for_fit(first, seen, frames, self._frame_s)
            )
        self._before, self._due_s, self._last = seen, time_s + _EVERY_S, None
