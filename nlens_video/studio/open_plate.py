"""The plate of the pictures that are drawn: its frames, and what is known of them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import count

from nlens_video.core.errors import InputError
from nlens_video.core.layers import CocMap, Picture
from nlens_video.core.settings import SourceSettings
from nlens_video.effects.measurement import MOST_PICTURES
from nlens_video.graph.base.context import CocEstimator
from nlens_video.graph.base.plate_preview import PlatePreview
from nlens_video.networks.device import choose
from nlens_video.networks.lazy import lazy_coc_estimator
from nlens_video.run.frame_range import LOOKAHEAD_FRAMES
from nlens_video.studio.plate_frames import PlateFrames
from nlens_video.video.info import SourceFrame

MOST_PX = 960 * 544
"""Of a previewed frame: larger plates are shown reduced [px]."""


@dataclass(slots=True)
class Plate:
    """An open plate and what is known of it."""

    source: SourceSettings
    frames: PlateFrames
    preview: PlatePreview
    estimate_coc: CocEstimator

    @classmethod
    def opened(cls, source: SourceSettings) -> Plate:
        """Open a plate; raises as `PlateFrames`."""
        frames = PlateFrames(source, MOST_PX)
        start = source.frames[0]

        def pictures() -> tuple[Picture, ...]:
            most = MOST_PICTURES if frames.info.kind in ("video", "sequence") else 1
            return tuple(frame.picture for frame in frames.first(0, most))

        def from_start(*, sparse: bool = False) -> Iterator[SourceFrame]:
            for index in count():
                try:
                    yield frames.frame(index)
                except InputError:  # it has no more
                    return

        estimate = lazy_coc_estimator(frames.info.pixel_aspect, choose("auto"))
        preview = PlatePreview(pictures, start, from_start=from_start)
        return cls(source, frames, preview, _remembering(estimate))

    def first(self) -> tuple[SourceFrame, ...]:
        """The frame on which the lens is found, and those after it that are looked at with it."""
        return self.frames.first(self.source.frames[0], 1 + LOOKAHEAD_FRAMES)


def _remembering(estimate: CocEstimator) -> CocEstimator:
    """F, which keeps its last result; the pictures that it is asked about are not written to."""
    last: list[tuple[list[Picture], CocMap]] = []

    def estimated(picture: Picture, following: Sequence[Picture]) -> CocMap:
        asked = [picture, *following]
        for pictures, found in last:
            if len(pictures) == len(asked) and all(map(_same, pictures, asked)):
                return found
        found = estimate(picture, asked[1:])
        last[:] = [(asked, found)]
        return found

    return estimated


def _same(one: object, other: object) -> bool:
    return one is other
