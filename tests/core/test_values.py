"""Values that are changed are checked as those that are made."""

import math

import pytest
from msgspec.structs import replace

from nlens_video.core.errors import LensFitError, NlensError
from nlens_video.core.lens_fit import LensFit
from nlens_video.core.objects import PlaceKey, PlaceKeys, Playback


def test_value_that_is_replaced_is_checked():
    with pytest.raises(NlensError):
        replace(Playback(), speed=-1.0)
    with pytest.raises(LensFitError):
        replace(LensFit(slope=1.0, intercept=0.0, width=8, height=8), slope=math.nan)


def test_keys_that_are_replaced_are_ordered():
    keys = [PlaceKey(time_s=time_s, yaw_deg=0.0) for time_s in (2.0, 1.0)]
    ordered = replace(PlaceKeys(), keys=tuple(keys)).keys
    assert [key.time_s for key in ordered] == [1.0, 2.0]
