"""All checks of the plate during a run, with what they tell the user."""

from __future__ import annotations

from nlens_video.core.errors import Note
from nlens_video.core.known_lens import UNKNOWN_LENS
from nlens_video.core.settings import Settings
from nlens_video.graph.executor import Observer
from nlens_video.graph.session import Session
from nlens_video.run.checks.camera_frames import notes_on_camera_frames
from nlens_video.run.checks.cut import CutCheck
from nlens_video.run.checks.drift import DriftCheck
from nlens_video.run.checks.interlaced import notes_on_fields
from nlens_video.run.checks.zoom import ZoomCheck
from nlens_video.stages.r_lens_track import FitTrack
from nlens_video.video.info import SourceInfo


def notes_beforehand(settings: Settings, info: SourceInfo, session: Session) -> tuple[Note, ...]:
    """What is known before the first frame."""
    frames = settings.source.frames
    return (
        *notes_on_fields(info),
        *notes_on_camera_frames(session.view.solved, info, frames),
        *_unused_beside_a_fit(settings),
        *notes_on_given_focus(settings, session.executor.track),
    )


def _unused_beside_a_fit(settings: Settings) -> tuple[Note, ...]:
    """A note on each option that tells of the lens where `--fit` gives it."""
    if settings.fit is None:
        return ()
    given = {
        "--lens": settings.lens != UNKNOWN_LENS,
        "--prefer": settings.prefer is not None,
        "--fit-region": settings.fit_region is not None,
    }
    return tuple(
        Note(f"{option}: --fit gives the lens, so it changes nothing; leave one of them out")
        for option, is_given in given.items()
        if is_given
    )


def notes_on_given_focus(settings: Settings, track: FitTrack | None) -> tuple[Note, ...]:
    """A note where the focus of `--lens` is not used, since the lens changes along the file."""
    if track is None or settings.lens.focus_m is None or settings.fit is not None:
        return ()
    return (
        Note(
            "the focus of --lens is not used, since the lens changes and nobody says when it was "
            "so; --track-focus off holds it"
        ),
    )


class PlateChecks:
    """The checks of one run.

    Args:
        settings: the run.
        info: the plate.
        session: its graph.
        frame_s: frame interval, 0 for a still [s].

    Attributes:
        observers: what compares frames.
    """

    def __init__(
        self, settings: Settings, info: SourceInfo, session: Session, frame_s: float
    ) -> None:
        short = notes_on_camera_frames(session.view.solved, info, settings.source.frames)
        self._cut = CutCheck(frame_s, live=info.kind == "stream")
        self._zoom = ZoomCheck(frame_s)
        self._drift = DriftCheck(
            frame_s, session.context.ground_height, solved=settings.scene.camera_from is not None,
            distortion_k1=session.distortion_k1, ends_early=bool(short),
        )  # fmt: skip
        self.observers: tuple[Observer, ...] = (self._cut, self._zoom, self._drift)

    @property
    def notes(self) -> tuple[str, ...]:
        """What they have found, as of now."""
        return (*self._cut.notes, *self._zoom.notes, *self._drift.notes)
