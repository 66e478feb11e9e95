"""Pictures, maps and plots of the report against values worked out by hand."""

import base64
import re

import av
import cv2
import numpy as np
import pytest

from nlens_video.core.layers import Box
from nlens_video.report.collect import copied, thumbnail
from nlens_video.report.html import embedded_jpeg, jpeg, to_8_bit
from nlens_video.report.maps import COC_MAP, Scale
from nlens_video.report.svg import Axes, nice_step, ticks
from nlens_video.video.pixels.orientation import Orientation
from nlens_video.video.pixels.picture import ArrayPicture, AvPicture

RAMP = np.linspace(30, 220, 960)[None, :, None] * np.ones((512, 1, 3))


def decoded(data):
    return cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)[..., ::-1]


def picture(pixel_format="yuv420p", rotation=0, rgb=RAMP):
    frame = av.VideoFrame.from_ndarray(rgb.astype(np.uint8), "rgb24")
    frame = frame.reformat(format=pixel_format, dst_colorspace="ITU709", dst_color_range="MPEG")
    frame.colorspace, frame.color_range = 1, 1
    return AvPicture(frame, orientation=Orientation(rotation))


def test_copied_picture_keeps_the_plate_after_compositing():
    plate = picture()
    expected = to_8_bit(plate.shown())
    before = copied(plate)
    plate.composite_over(Box(0, 0, 64, 64), np.ones((64, 64, 4), np.float32))
    np.testing.assert_array_equal(before(), expected)
    assert np.abs(to_8_bit(plate.shown()).astype(int) - expected).max() > 50


def test_copied_array_picture_keeps_the_plate_after_compositing():
    array = np.full((20, 30, 3), 90, np.uint8)
    before = copied(ArrayPicture(array))
    array[:] = 0
    assert (before() == 90).all()


@pytest.mark.parametrize("pixel_format", ["yuv420p", "yuv422p", "yuv444p10le", "gbrp", "gray"])
@pytest.mark.parametrize("rotation", [0, 90])
def test_thumbnail_equals_the_downscaled_picture(pixel_format, rotation):
    whole = picture(pixel_format, rotation)
    expected = to_8_bit(whole.shown(), 320)
    small = decoded(thumbnail(whole))
    assert small.shape[1] == 320
    reference = cv2.resize(expected, small.shape[1::-1], interpolation=cv2.INTER_AREA)
    assert np.abs(small.astype(float) - reference).mean() < 2.0


def test_a_small_picture_is_not_enlarged():
    small = picture(rgb=RAMP[:40, :64])
    assert decoded(thumbnail(small)).shape == (40, 64, 3)


def test_data_uri_holds_the_images_bytes():
    data = jpeg(np.full((4, 4, 3), 128, np.uint8))
    source = re.search('src="data:image/jpeg;base64,(.*?)"', embedded_jpeg(data, (4, 4), "grey"))
    assert base64.b64decode(source[1]) == data


def test_colour_scale_starts_at_zero_and_saturates_at_its_top():
    scale = Scale(top_px=8.0, colormap=COC_MAP)
    colors = scale.colors(np.array([[0.0, 8.0, 80.0]], np.float32))[0].astype(int)
    np.testing.assert_allclose(colors[0], [68, 1, 84], atol=1)  # viridis begins dark violet
    np.testing.assert_allclose(colors[1], [253, 231, 37], atol=3)  # and ends yellow
    np.testing.assert_array_equal(colors[1], colors[2])


def test_axes_place_values_at_their_ticks():
    axes = Axes(width=200, height=100, x=(0, 10), y=(-1, 1), margins=(20, 10, 30, 15))
    np.testing.assert_allclose(axes.place_x(np.array([0, 5, 10])), [20, 95, 170])
    np.testing.assert_allclose(axes.place_y(np.array([-1, 0, 1])), [85, 47.5, 10])


@pytest.mark.parametrize(
    ("low", "high", "expected"),
    [(0, 10, [0, 2, 4, 6, 8, 10]), (-3, 3, [-3, -2, -1, 0, 1, 2, 3]), (0, 0.26, [0, 0.05])],
)
def test_ticks_are_round_numbers_within_the_range(low, high, expected):
    found = ticks(low, high)
    np.testing.assert_allclose(found[: len(expected)], expected, atol=1e-12)
    assert low <= found[0]
    assert found[-1] <= high


def test_tick_steps_are_1_2_2_5_or_5():
    assert [nice_step(v) for v in (0.9, 1.1, 2.1, 3, 6)] == [1, 2, 2.5, 5, 10]
