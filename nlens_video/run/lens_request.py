"""How a run finds and simulates the lens: its settings and what the source says of itself."""

from __future__ import annotations

from nlens_video.core.settings import Settings
from nlens_video.graph.base.lens_search import STREAM_S
from nlens_video.graph.effect_plan import LensRequest
from nlens_video.run.plate_source import frame_s
from nlens_video.stages.r_lens_track import read_fit
from nlens_video.video.exposure_time import exposure_time_s
from nlens_video.video.info import SourceInfo
from nlens_video.video.input.open import can_be_read_again
from nlens_video.video.lens_tags import tagged_lens


def lens_request(settings: Settings, info: SourceInfo) -> LensRequest:
    """The request of a run.

    Args:
        settings: the run.
        info: of its source.

    Raises:
        LensFitError: the file of `--fit` cannot be used.
    """
    stream = not can_be_read_again(settings.source.spec)
    return LensRequest(
        preset=settings.preset,
        effects=settings.effects,
        fit=read_fit(settings.fit) if settings.fit is not None else None,
        fallback=settings.fallback,
        device=settings.device,
        aperture=settings.aperture,
        shutter_deg=settings.shutter_deg,
        frame_s=frame_s(info),
        exposure_s=exposure_time_s(info.camera_tags),
        optics=settings.optics,
        known=settings.known_lens,
        tagged=tagged_lens(info.camera_tags),
        fit_region=settings.fit_region,
        hold_budget=settings.hold_budget,
        live=settings.track_focus != "off" and stream,
        search_s=STREAM_S if stream else 0.0,
    )
