"""Samples for the lens fit from several frames of a moving camera.

Frames of a moving camera see more of the ground, at more distances, than the one on which the lens
is fitted, and what misleads one of them seldom misleads all. They lie within the first seconds,
so that a long file is not read twice.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress

import numpy as np
from msgspec.structs import replace

from nlens_video.cameras.solved import SolvedCamera
from nlens_video.core import signals
from nlens_video.core.errors import LensFitError
from nlens_video.core.settings import Settings
from nlens_video.effects.foreground.survey import StaticCameraSurvey
from nlens_video.effects.planner import EffectRequest
from nlens_video.graph.base.profiler import Profiler
from nlens_video.graph.session import LensPasses
from nlens_video.run.first_look import FirstLook, follows_lens
from nlens_video.run.lens_track_pass import lens_track_pass
from nlens_video.run.open_run import ShotPasses, open_run
from nlens_video.stages.r_samples import FitSamples
from nlens_video.video.info import SourceFrame
from nlens_video.video.input.open import can_be_read_again

_FRAMES = 5  # of which samples are taken, the first one included
_WITHIN_S = 4.0
_SAME_FOCAL = 0.01  # relative change beyond which a lens that zooms is another one


def passes(settings: Settings, look: Callable[[], FirstLook | None]) -> ShotPasses:
    """What passes over a file tell before a run.

    Args:
        settings: the run.
        look: waits for a first look at the file, which has begun; raises as `run.render`.
    """

    def of_lens() -> LensPasses:
        """The lens' track where it changes, else samples of other frames."""
        track = lens_track_pass(settings, look()) if follows_lens(settings) else None
        return LensPasses(track, samples_of_other_frames(settings) if track is None else ())

    def of_what_moves() -> StaticCameraSurvey | None:
        seen = look()
        return None if seen is None else seen.survey

    return ShotPasses(of_lens, of_what_moves, under_way=True)


def samples_of_other_frames(settings: Settings) -> tuple[FitSamples, ...]:
    """Samples of frames after the first, empty where the camera stays, zooms or is not solved.

    Args:
        settings: of a run whose lens does not change.

    Raises:
        NlensError: as `run.render`.
    """
    if (
        settings.scene.camera_from is None
        or settings.fit is not None
        or settings.source.one_frame
        or not EffectRequest.parse(settings.effects).possible
        or not can_be_read_again(settings.source.spec)
    ):
        return ()
    run = replace(settings, effects="defocus", fallback="none")
    with open_run(run, Profiler()) as run_input:
        cameras = run_input.session.view.cameras
        wanted = () if cameras is None else _frames(cameras.solved, settings.source.frames)
        if not wanted:
            return ()
        executor = run_input.session.executor
        found: list[FitSamples] = []
        for item in run_input.frames:
            if not isinstance(item, SourceFrame) or item.index not in wanted:
                continue
            signals.check()
            state = executor.begin_frame(item)
            with suppress(LensFitError):
                executor.find_lens(state, "several")
                lens = state.values.found_lens
                if lens is not None and lens.regression is not None:
                    found.append(lens.regression.samples)
            executor.profiler.close_frame(item.index, 0)
            if item.index == wanted[-1]:
                break
    return tuple(found)


def _frames(camera: SolvedCamera, given: tuple[int, int | None]) -> tuple[int, ...]:
    """Frames evenly spaced over the first seconds of a range, without its first."""
    start, end = given
    keys = [key for key in camera.keys if key.index >= start and (end is None or key.index < end)]
    if len(keys) < _FRAMES or camera.path == "still":
        return ()
    keys = [key for key in keys if key.pts_s <= keys[0].pts_s + _WITHIN_S]
    focals = [camera.at(key.pts_s).fx for key in keys]
    if np.ptp(focals) > _SAME_FOCAL * focals[0]:
        return ()
    picked = np.linspace(0, len(keys) - 1, _FRAMES).round().astype(int)[1:]
    return tuple(keys[at].index for at in picked)
