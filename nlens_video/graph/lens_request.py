"""The lens as a run asks for it."""

from __future__ import annotations

from dataclasses import dataclass

from nlens_video.core.lens_fit import LensFit
from nlens_video.core.optics import ASSUMED_ANGLE_DEG, ROUND, Aperture, LensOverrides, Shutter
from nlens_video.core.settings import Device, Fallback
from nlens_video.stages.r_lens_track import FitTrack


@dataclass(frozen=True, slots=True, kw_only=True)
class LensRequest:
    """How the lens is found and simulated.

    Attributes:
        preset: shipped pipeline's name or path of a pipeline file.
        effects: `auto`, `none`, or names separated by commas.
        fit: the lens, when it is known beforehand.
        fallback: what stands in for a fit that fails.
        device: where networks and kernels run.
        aperture: shape of its aperture.
        shutter_deg: how long the shutter is open, 360 for all of a frame, None if not known [deg].
        frame_s: from one frame to the next, 0 for a still [s].
        optics: what a person says about it beside.
        track: the lens all along a file whose lens changes, in the pixels of its frames.
        live: whether a lens that changes is followed as it goes.
        hold_budget: whether quality steps down and up to keep the frame budget.
    """

    preset: str = "standard"
    effects: str = "auto"
    fit: LensFit | None = None
    fallback: Fallback = "none"
    device: Device = "auto"
    aperture: Aperture = ROUND
    shutter_deg: float | None = None
    frame_s: float = 0.0
    optics: LensOverrides = LensOverrides()
    track: FitTrack | None = None
    live: bool = False
    hold_budget: bool = False

    @property
    def shutter(self) -> Shutter:
        """The plate's shutter."""
        if self.shutter_deg is None:
            return Shutter(angle_deg=ASSUMED_ANGLE_DEG, frame_s=self.frame_s, source="assumed")
        return Shutter(angle_deg=self.shutter_deg, frame_s=self.frame_s, source="given", given=True)
