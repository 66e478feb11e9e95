"""What was found of things in front of the object, for the planner."""

from __future__ import annotations

from msgspec import Struct


class Finding(Struct, frozen=True):
    """What was found of things in front of the object.

    Attributes:
        reason: for people.
        wanted: whether occlusion is called for.
        certainty: share of the object's surroundings whose background is known, None where none
            was looked for [1].
        threshold: least certainty that calls for it [1].
    """

    reason: str
    wanted: bool = False
    certainty: float | None = None
    threshold: float | None = None
