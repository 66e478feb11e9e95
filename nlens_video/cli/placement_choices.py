"""Placements around a given one, and the options that repeat each."""

from __future__ import annotations

import shlex

from msgspec import Struct
from msgspec.structs import replace

from nlens_video.core.objects import ALL
from nlens_video.core.placement import Placement
from nlens_video.core.settings import ObjectSettings

_HORIZON_STEP, _SIZE_FACTOR, _YAW_STEP = 0.12, 1.5, 45.0
_ASIDE, _ALONG = 0.2, 0.3  # of the frame's width; of the way to the lower border
_LENS_FACTOR = 0.5  # of the field of view: a longer lens, from farther away [1]


class Choice(Struct, frozen=True):
    """A placement and the field of view that it is seen with.

    Attributes:
        placing: where the object stands.
        fov_deg: across the frame, None for the plate's own or the assumed one [deg].
    """

    placing: Placement
    fov_deg: float | None

    def options(self, scene: ObjectSettings) -> tuple[str, ...]:
        """The options that repeat it, each with its value.

        Args:
            scene: the object; its options are the same for all choices.
        """
        played = scene.playback
        fov = None if self.fov_deg is None else f"{self.fov_deg:.4g}"
        given = (
            ("--fov", fov),
            ("--camera-from", None if scene.camera_from is None else str(scene.camera_from)),
            ("--ground-y", None if scene.ground_y is None else f"{scene.ground_y:g}"),
            ("--scene", scene.scene),
            ("--animation", None if played.animation == ALL else played.animation),
            ("--animation-speed", None if played.speed == 1.0 else f"{played.speed:g}"),
            ("--animation-offset", None if played.offset_s == 0.0 else f"{played.offset_s:g}"),
        )
        place = self.placing.describe().split(" --")
        return (
            place[0],
            *(f"--{option}" for option in place[1:]),
            *(f"{name} {shlex.quote(value)}" for name, value in given if value is not None),
            *(["--loop"] if played.loop else []),
        )


def choices(start: Placement, fov_deg: float | None, assumed_fov_deg: float) -> tuple[Choice, ...]:
    """Nine choices: the given one first; then horizon, size, turn and lens changed by a step.

    Args:
        start: the placement that is varied.
        fov_deg: field of view that `--fov` gives, else None [deg].
        assumed_fov_deg: what it is else [deg].
    """
    lowest = 0.5 * (start.horizon_row + start.at[1])  # a horizon must lie above the contact point
    horizons = (start.horizon_row - _HORIZON_STEP, min(start.horizon_row + _HORIZON_STEP, lowest))
    sizes = (start.size / _SIZE_FACTOR, start.size * _SIZE_FACTOR)
    yaws = (start.yaw_deg - _YAW_STEP, start.yaw_deg + _YAW_STEP, start.yaw_deg + 180.0)
    places = (
        start,
        *(replace(start, horizon=horizon) for horizon in horizons),
        *(replace(start, yaw_deg=yaw) for yaw in yaws),
        *(replace(start, size=size) for size in sizes),
    )
    longer = _LENS_FACTOR * (assumed_fov_deg if fov_deg is None else fov_deg)
    return (*(Choice(place, fov_deg) for place in places), Choice(start, longer))


def choices_on_ground(start: Placement, fov_deg: float | None) -> tuple[Choice, ...]:
    """Nine choices on a solved ground: the given one; then place, size and turn changed by a step.

    Args:
        start: the placement that is varied.
        fov_deg: field of view that `--fov` gives, else None [deg].
    """
    x, y = start.at
    nearer = y + _ALONG * (1.0 - y)
    places = (
        start,
        *(replace(start, at=at) for at in ((x - _ASIDE, y), (x + _ASIDE, y))),
        replace(start, at=(x, nearer), size=start.size * _SIZE_FACTOR),
        *(replace(start, size=size) for size in (start.size / _SIZE_FACTOR,
                                                 start.size * _SIZE_FACTOR)),
        *(replace(start, yaw_deg=start.yaw_deg + turn) for turn in (-_YAW_STEP, _YAW_STEP, 180.0)),
    )  # fmt: skip
    return tuple(Choice(place, fov_deg) for place in places)
