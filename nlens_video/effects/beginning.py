"""The beginning of a shot: black, white or a fade, before a frame tells the light."""

from __future__ import annotations

import numpy as np

from nlens_video.core.layers import Picture
from nlens_video.effects.light_change import LEAST_SHARE, SmallPicture

_BLACK, _WHITE = 0.02, 0.9  # mean light of pictures that may show nothing [1]
_NOTHING = 0.002  # mean light of pictures that do show nothing [1]
_STEADY = 0.02  # change of the light from frame to frame up to which it rests [1]
_FADE = 0.25  # change of the light by which a fade from a dark picture begins, at least [1]


class Beginning:
    """Finds the first frame of a shot that tells its light.

    That is the first one, unless it is black or white: then the first that is neither and at which
    the light has come to rest, so that a fade is over. It rests as soon as it no longer moves on in
    the direction of the fade, so flickering lamps do not delay it.

    Attributes:
        rests: whether the light of a picture that shows something has come to rest.
        fades_in: whether a fade from black, or nearly, goes on.
    """

    def __init__(self) -> None:
        self.rests = self.fades_in = False
        self._level: float | None = None
        self._dark = False

    def ends(self, picture: Picture) -> bool:
        """Whether a picture tells the light; called with each frame of the shot in order."""
        return self.ends_with(SmallPicture.of(picture))

    def ends_with(self, small: SmallPicture) -> bool:
        """`ends`, for a picture that is reduced already."""
        before, self._level = self._level, float(small.light.mean())
        known = np.isfinite(small.stops).all(axis=2).mean()
        tells = bool(known >= LEAST_SHARE) or _BLACK < self._level < _WHITE
        if before is None:
            self._dark = self._level < 0.5
            return tells
        rises = self._level > (1.0 + _STEADY) * before
        fades = rises if self._dark else self._level < (1.0 - _STEADY) * before
        self.rests |= self._level > _NOTHING and not fades
        starts = before <= _NOTHING or self._level > (1.0 + _FADE) * before
        self.fades_in = rises and not self.rests and (self.fades_in or starts)
        return tells and not fades
