"""The command `fit`: the lens of a plate, kept in a file."""

from __future__ import annotations

from contextlib import ExitStack
from pathlib import Path

from msgspec import Struct

from nlens_video.core import signals
from nlens_video.core.errors import OutOfViewError, UsageError
from nlens_video.core.lens_fit import LensFit
from nlens_video.core.settings import Settings
from nlens_video.graph.base.profiler import Profiler
from nlens_video.graph.executor import FrameState
from nlens_video.run.checks.interlaced import notes_on_fields
from nlens_video.run.checks.lens_told import check_lens_told
from nlens_video.run.checks.plate_checks import notes_on_given_focus
from nlens_video.run.lens_track_pass import lens_track_pass
from nlens_video.run.observers import SidecarOutputs, note_on_complete_result, observers, save_fit
from nlens_video.run.open_run import open_run
from nlens_video.run.plate_source import no_such_frames
from nlens_video.run.pooled_samples import samples_of_other_frames
from nlens_video.video.atomic_files import check_folder, remove_stale

FIT_SEARCH_FRAMES = 240
"""Frames within which `fit` expects the object to come into view."""


class FitOutcome(Struct, frozen=True, kw_only=True):
    """The result of `fit`: fit and file, notes and missing sidecar outputs as in `RunResult`."""

    fit: LensFit
    path: Path
    notes: tuple[str, ...]
    missing: tuple[str, ...] = ()


def find_fit(settings: Settings, search_frames: float = FIT_SEARCH_FRAMES) -> FitOutcome:
    """Fit the lens on the first frame with the object in view, and save the fit.

    Where the lens changes over a file and `track_focus` is on, the whole track is saved.

    Args:
        settings: the run; `save_fit` names the file.
        search_frames: frames to search at most, infinity for all [1].

    Raises:
        NlensError: as `render`; OutOfViewError when the object does not come into view.
    """
    if settings.save_fit is None:
        raise UsageError("no file for the fit was named")
    check_folder(settings.save_fit)
    remove_stale(settings.save_fit)
    if settings.chart_m is not None:
        from nlens_video.run.chart_fit import chart_fit  # here: scipy takes long to load

        charted, about = chart_fit(settings, settings.chart_m)
        save_fit(charted, settings.save_fit)
        return FitOutcome(fit=charted, path=settings.save_fit, notes=about)
    track = lens_track_pass(settings)
    if track is not None:
        first = settings.source.frames[0]
        save_fit(track, settings.save_fit, first)
        notes = (track.describe(), *notes_on_given_focus(settings, track))
        return FitOutcome(fit=track.at(first), path=settings.save_fit, notes=notes)
    profiler = Profiler(settings.budget_ms)
    with ExitStack() as stack:
        others = samples_of_other_frames(settings)
        run_input = stack.enter_context(open_run(settings, profiler, others))
        session = run_input.session
        found = observers(settings, run_input.info, session, None)
        sidecars = stack.enter_context(SidecarOutputs(found))
        find_lens = session.graph.find_lens
        seen = 0
        for state in run_input.items([sidecars]):
            if not isinstance(state, FrameState):
                continue
            seen += 1
            signals.check()
            session.executor.run(state, find_lens)
            frame = state.frame
            timing = profiler.close_frame(frame.index, frame.pts, warm_up=state.fitted_here)
            sidecars.frame(state, timing)
            if session.executor.fit is not None or seen >= search_frames:
                break
        fit = session.executor.fit
        if not seen:
            raise UsageError(no_such_frames(settings.source, run_input.info))
        if fit is None:
            check_lens_told(session)
            raise OutOfViewError(
                f"{settings.scene.glb}: the object does not come into view within {seen} frames, "
                "so there is nothing to fit; check the camera or --range"
            )
        save_fit(fit, settings.save_fit)
        notes = (*notes_on_fields(run_input.info), *session.notes)
        with note_on_complete_result(str(settings.save_fit)):
            sidecars.finish(profiler.summary(), notes)
    return FitOutcome(fit=fit, path=settings.save_fit, notes=notes, missing=sidecars.missing)
