"""A shot's first pictures, before a frame is composited, and what was measured on them."""

from __future__ import annotations

from collections.abc import Callable, Sequence, Set
from dataclasses import dataclass, field

from nlens_video.core.layers import Picture
from nlens_video.effects.beginning import Beginning
from nlens_video.effects.camera.aperture_shape import ApertureReading, read_aperture
from nlens_video.effects.foreground.survey import StaticCameraSurvey
from nlens_video.effects.measurement import (
    MOST_PICTURES,
    PLATE_EFFECTS,
    Measurement,
    measure_plate,
    shutter_angle,
)
from nlens_video.graph.base.context import ReadAgain
from nlens_video.video.info import SourceFrame

_LONGEST_S = 10.0  # of a black or white beginning, or a fade, that is read over [s]


@dataclass(slots=True)
class PlatePreview:
    """A shot's first pictures, before a frame is composited, and what was measured on them.

    Sessions that share it measure the plate once.

    Attributes:
        pictures: reads them, perhaps only one; called where an effect is measured on them, before
            the run's frames are read.
        first: number of the frame that the time of measuring is counted to [1].
        again: reads all frames of the shot, None where it can be read only once.
        survey: waits for what was seen of what moves, None where the shot was not looked at.
        begins_run: whether these very pictures are those of the run's first frames.
        from_start: reads the frames from the shot's first one, whatever the range; None where it
            can be read only once.
    """

    pictures: Callable[[], Sequence[Picture]]
    first: int = 0
    again: ReadAgain | None = None
    survey: Callable[[], StaticCameraSurvey | None] = lambda: None
    begins_run: bool = False
    from_start: ReadAgain | None = None
    _measured: dict[str, Measurement] = field(default_factory=dict)
    _shutter: tuple[float | None] | None = None
    _aperture: tuple[ApertureReading | None] | None = None
    _later: tuple[SourceFrame, ...] | None = None

    def first_lit_frame(self) -> SourceFrame | None:
        """The first frame that tells the light of a shot whose first one does not.

        That one is black, white, or part of a fade. None where it tells the light, where the shot
        can be read only once, and where the light comes later than after ten seconds, or never.
        Call it before the run's frames are read.
        """
        if self._later is None:
            waits = self.from_start is not None and _is_beginning(self.pictures())
            self._later = _later(self.from_start) if self.from_start and waits else ()
        return self._later[0] if self._later else None

    def _telling(self) -> Sequence[Picture]:
        """The first pictures, or those from `first_lit_frame` on where these tell nothing."""
        if self.first_lit_frame() is not None and self._later:
            return [frame.picture for frame in self._later]
        return self.pictures()

    def measured(self, effects: Set[str]) -> dict[str, Measurement]:
        """Effects of the camera as these pictures show them, each measured once."""
        missing = effects - self._measured.keys()
        if missing:
            self._measured.update(measure_plate(missing, self._telling()))
        found = effects & self._measured.keys()  # none where there is no picture
        return {one: self._measured[one] for one in PLATE_EFFECTS if one in found}

    def shutter_deg(self) -> float | None:
        """The shutter's angle by their motion blur, None where that does not show [deg]."""
        if self._shutter is None:
            self._shutter = (shutter_angle(self._telling()),)
        return self._shutter[0]

    def aperture(self, pixel_aspect: float) -> ApertureReading | None:
        """The aperture's shape by the first one's highlights, None where they do not tell it.

        Args:
            pixel_aspect: width of a pixel by its height [1].
        """
        if self._aperture is None:
            first = self._telling()[:1]
            self._aperture = (read_aperture(first[0], pixel_aspect) if first else None,)
        return self._aperture[0]


def _is_beginning(pictures: Sequence[Picture]) -> bool:
    """Whether a shot's first picture does not tell its light: it is black, white or fades."""
    beginning = Beginning()
    tells = [beginning.ends(picture) for picture in pictures[:2]]
    return not all(tells)


def _later(from_start: ReadAgain) -> tuple[SourceFrame, ...]:
    """Frames from the first one on that tells the light; none where it comes too late."""
    beginning = Beginning()
    found: list[SourceFrame] = []
    for number, frame in enumerate(from_start()):
        if not found and frame.time_s > _LONGEST_S:
            break
        if found or (beginning.ends(frame.picture) and number > 0):
            found.append(frame)
        if len(found) == MOST_PICTURES:
            break
    return tuple(found)
