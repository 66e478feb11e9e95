"""Chroma at the size of luma."""

import av
import numpy as np
import pytest

from nlens_video.core.color import ColorTags
from nlens_video.video.pixels.chroma import with_full_chroma
from nlens_video.video.pixels.orientation import Orientation
from nlens_video.video.pixels.picture import AvPicture

_TAGS = ColorTags(matrix="bt709", transfer="bt709", primaries="bt709", full_range=False)


def ramp(pixel_format, siting, rotation=0, *, size=(31, 17)):
    """A picture whose blue difference rises by 2 a column, its red one by 4 a row, as stored."""
    width, height = size
    frame = av.VideoFrame(width, height, pixel_format)
    down = 2 if pixel_format == "yuv420p" else 1
    left = 0.5 if siting == "center" else 0.0
    top = 0.5 if down == 2 else 0.0
    for place, plane in enumerate(frame.planes):
        rows = np.frombuffer(memoryview(plane), np.uint8).reshape(plane.height, -1)
        view = rows[:, : plane.width]
        across = 2.0 * (2 * np.arange(plane.width) + left)
        along = 4.0 * (down * np.arange(plane.height) + top)
        values = (
            np.full(view.shape, 100.0),
            np.broadcast_to(60 + across, view.shape),
            np.broadcast_to((60 + along)[:, None], view.shape),
        )[place]
        plane.update(_padded(values, rows.shape[1]))
    return AvPicture(frame, _TAGS, orientation=Orientation(rotation), chroma_siting=siting)


def _padded(values, stride):
    rows = np.zeros((values.shape[0], stride), np.uint8)
    rows[:, : values.shape[1]] = np.round(values)
    return rows


@pytest.mark.parametrize("rotation", [0, 90, 180, 270])
@pytest.mark.parametrize("siting", ["left", "center"])
@pytest.mark.parametrize("pixel_format", ["yuv420p", "yuv422p"])
def test_slopes_of_chroma_lie_where_they_lie_at_full_size(pixel_format, siting, rotation):
    full = with_full_chroma(ramp(pixel_format, siting, rotation).samples())
    turned = [np.rot90(one, -rotation // 90) for one in full.planes]
    inside = np.s_[2:-2, 2:-2]
    columns, rows = np.arange(31)[None, 2:-2], np.arange(17)[2:-2, None]
    assert np.abs(turned[1][inside] - (60.0 + 2 * columns)).max() <= 1
    assert np.abs(turned[2][inside] - (60.0 + 4 * rows)).max() <= 1
    assert (full.across.step, full.down.step) == (1, 1)


def test_chroma_of_every_pixel_and_luma_are_shared():
    samples = AvPicture(av.VideoFrame(8, 6, "yuv444p"), _TAGS).samples()
    assert with_full_chroma(samples) is samples
    halved = ramp("yuv420p", "left").samples()
    assert with_full_chroma(halved).planes[0] is halved.planes[0]
