"""What tells the scale of a plate whose camera is solved."""

from __future__ import annotations

from msgspec import Struct

from nlens_video.core.errors import UsageError


class ScaleSettings(Struct, frozen=True, kw_only=True):
    """What tells the scale of a plate whose camera is solved.

    Attributes:
        marker_m: side of the markers that lie on the ground, None for none [m].
        person_m: height of a person who stands on the ground, None for none [m].
        person: where the first frame shows the person: a point on the body, or left, upper, right
            and lower border, in fractions of the frame.
    """

    marker_m: float | None = None
    person_m: float | None = None
    person: tuple[float, ...] | None = None

    def __post_init__(self) -> None:
        if (self.person_m is None) != (self.person is None):
            raise UsageError(
                "give both --person-height 1.75m and --person X,Y, a point on that person, or "
                "X0,Y0,X1,Y1 from head to feet"
            )
        if self.marker_m is not None and self.person_m is not None:
            raise UsageError("--marker and --person-height both give the scale; leave one out")

    @property
    def given(self) -> bool:
        """Whether the scale is told."""
        return self.marker_m is not None or self.person_m is not None


UNKNOWN_SCALE = ScaleSettings()
