"""What several objects are, and how one moves by keys: settings. Imports nothing heavy."""

from __future__ import annotations

import itertools
import math
from collections.abc import Collection
from pathlib import Path
from typing import Literal

from msgspec import Struct
from msgspec.structs import force_setattr

from nlens_video.core.errors import UsageError
from nlens_video.core.placement import GroundPlacing

Interpolation = Literal["smooth", "linear"]
_LATEST_S = 1e6  # of a key: eleven days, beyond which it is a number of frames or a mistake
_MOST_TURNS = 1e4

ALL = "all"


class Playback(Struct, frozen=True, kw_only=True):
    """Mapping from the plate's time to the animation's.

    Camera animation is unaffected: it was matched to the plate and keeps the plate's time.

    Attributes:
        animation: name of the one that plays, else its number from 0, or `all`; of those that
            move the same thing, `all` plays the first.
        loop: whether it starts again after the last key of what moves meshes and lights; else it
            rests there.
        speed: seconds of the animation per second of the plate, > 0 [1].
        offset_s: moment of the animation on the first frame [s].
    """

    animation: str = ALL
    loop: bool = False
    speed: float = 1.0
    offset_s: float = 0.0

    def __post_init__(self) -> None:
        if not 0.0 < self.speed < math.inf:
            raise UsageError(f"animation speed {self.speed:g}: must be a number above 0")
        if not math.isfinite(self.offset_s):
            raise UsageError(f"animation offset {self.offset_s}: must be a number of seconds")

    def moment(self, time_s: float, duration_s: float) -> float:
        """Moment of the animation at a moment of the plate.

        Args:
            time_s: seconds since the plate's first frame [s].
            duration_s: time of the animation's last key [s].
        """
        moment = self.offset_s + self.speed * time_s
        return moment % duration_s if self.loop and duration_s > 0.0 else moment


ONCE = Playback()
"""All animations, once, from the plate's first frame on."""


class PlaceKey(Struct, frozen=True, kw_only=True):
    """An object's place, size or turn at one moment; what is None is not keyed there.

    Attributes:
        time_s: the moment [s]; None where the frame is given.
        frame: frame of the plate, counted from 0; None where the time is given.
        at: column and row where it touches the ground, as the camera of that moment sees it
            [frame width, frame height].
        size: rows from there up to its highest point, > 0 [frame height].
        height_m: its height, in place of `size` [m].
        yaw_deg: as of `Placement`, towards the camera of that moment [deg].
    """

    time_s: float | None = None
    frame: int | None = None
    at: tuple[float, float] | None = None
    size: float | None = None
    height_m: float | None = None
    yaw_deg: float | None = None

    def __post_init__(self) -> None:
        if (self.time_s is None) == (self.frame is None):
            raise UsageError("a key needs its moment: time = seconds, or frame = its number")
        if self.time_s is not None and not 0.0 <= self.time_s <= _LATEST_S:
            raise UsageError(f"time {self.time_s:g}: expected seconds from the plate's first frame")
        if all(value is None for value in (self.at, self.size, self.height_m, self.yaw_deg)):
            raise UsageError(f"the key {self.when} gives nothing; give at, size, height or yaw")
        if self.yaw_deg is not None and not abs(self.yaw_deg) <= 360.0 * _MOST_TURNS:
            raise UsageError(f"yaw {self.yaw_deg:g} must be a number of degrees")
        try:
            GroundPlacing(at=self.at, size=self.size, height_m=self.height_m)
        except UsageError as error:
            raise UsageError(f"the key {self.when}: {error}") from error

    @property
    def when(self) -> str:
        """Its moment in words."""
        return f"at {self.time_s:g} s" if self.frame is None else f"at frame {self.frame}"

    @property
    def named(self) -> frozenset[str]:
        """Which of `at`, `size` (in either form) and `yaw` it gives."""
        tall = self.size is not None or self.height_m is not None
        given = {"at": self.at is not None, "size": tall, "yaw": self.yaw_deg is not None}
        return frozenset(name for name, there in given.items() if there)


class PlaceKeys(Struct, frozen=True, kw_only=True):
    """The keys of one object; before its first one and after its last a quantity rests.

    Attributes:
        keys: given in any order, kept in that of time.
        interpolation: between keys: `smooth` without a corner in the speed and never beyond the
            keys' values, or `linear`.
    """

    keys: tuple[PlaceKey, ...] = ()
    interpolation: Interpolation = "smooth"

    def __post_init__(self) -> None:
        if len({key.frame is None for key in self.keys}) > 1:
            raise UsageError("the keys of an object have times or frames, not both")
        ordered = tuple(sorted(self.keys, key=lambda key: key.time_s or key.frame or 0))
        force_setattr(self, "keys", ordered)
        for name in ("at", "size", "yaw"):
            named = self.of(name)
            for before, after in itertools.pairwise(named):
                if (before.time_s, before.frame) == (after.time_s, after.frame):
                    raise UsageError(f"two keys give {name} {after.when}; leave one of them out")

    def __bool__(self) -> bool:
        return bool(self.keys)

    def of(self, name: str) -> tuple[PlaceKey, ...]:
        """The keys that give `at`, `size` or `yaw`."""
        return tuple(key for key in self.keys if name in key.named)

    def check_beside(self, given: Collection[str]) -> None:
        """Check that what holds for all of the shot is not keyed as well.

        Args:
            given: names of `at`, `size`, `height` and `yaw` that are given for all of the shot.

        Raises:
            UsageError: one of them is keyed.
        """
        for name in given:
            keyed = self.of("size" if name == "height" else name)
            if keyed:
                raise UsageError(
                    f"{name} is given for all of the shot, and by the key {keyed[0].when}; leave "
                    "one of them out"
                )


NO_KEYS = PlaceKeys()


class FurtherObject(Struct, frozen=True, kw_only=True):
    """An object beside the first one, whose camera, ground and light it shares.

    Attributes:
        glb: its file.
        scene: as of `ObjectSettings`.
        playback: which of its animations play, and when.
        ground_y: height in its file that touches the ground, None for its lowest point
            [scene unit].
        placing: where it stands, and how large; what is None there is given by keys. None: where
            its file has it, in the world of the first one's file.
        at_frame: frame that `placing` is of.
        keys: how its place, size and turn change over time.
    """

    glb: Path
    scene: str | None = None
    playback: Playback = ONCE
    ground_y: float | None = None
    placing: GroundPlacing | None = None
    at_frame: int = 0
    keys: PlaceKeys = NO_KEYS

    def __post_init__(self) -> None:
        placing = self.placing or GroundPlacing()
        lacks_place = placing.at is None and not self.keys.of("at")
        lacks_size = placing.size is None and placing.height_m is None and not self.keys.of("size")
        if (self.placing is not None or self.keys) and (lacks_place or lacks_size):
            raise UsageError(
                f"{self.glb}: give {'at = [X, Y]' if lacks_place else 'size or height'} too; only "
                "the first object's place and size can be chosen"
            )
