"""Raw pictures in .y4m: all depths that FFmpeg writes, to the bit."""

import os
import threading

import av
import numpy as np
import pytest
from support.clips import copy, noise_frame, planes, write_clip

from nlens_video.core.errors import UsageError

DEEP = ("yuv420p10le", "yuv422p10le", "yuv444p12le", "gray12le", "gray16le")


def assert_same(path, plate):
    with av.open(str(plate)) as given, av.open(str(path)) as made:
        pairs = list(zip(given.decode(video=0), made.decode(video=0), strict=True))
    assert len(pairs) == 3
    for one, other in pairs:
        assert one.format.name == other.format.name
        for expected, found in zip(planes(one), planes(other), strict=True):
            np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize("pixel_format", ["yuv420p", "yuv444p", "gray", *DEEP])
def test_samples_of_a_plate_of_any_depth_are_kept(tmp_path, pixel_format):
    made = [noise_frame(64, 48, pixel_format, seed) for seed in range(3)]
    plate = write_clip(tmp_path / "in.mkv", made)
    copy(plate, tmp_path / "out.y4m")
    assert_same(tmp_path / "out.y4m", plate)


def test_deep_pictures_go_through_a_named_pipe(tmp_path):
    made = [noise_frame(64, 48, "yuv422p10le", seed) for seed in range(3)]
    plate = write_clip(tmp_path / "in.mkv", made)
    pipe = tmp_path / "out.y4m"
    os.mkfifo(pipe)
    read = []
    reader = threading.Thread(target=lambda: read.append(pipe.read_bytes()))
    reader.start()
    copy(plate, pipe)
    reader.join()
    (tmp_path / "read.y4m").write_bytes(read[0])
    assert_same(tmp_path / "read.y4m", plate)


@pytest.mark.parametrize(
    ("pixel_format", "becomes"),
    [("bgr0", "yuv444p"), ("bgra", "yuv444p"), ("gbrp10le", "yuv444p10le")],
)
def test_rgb_becomes_yuv_with_a_colour_for_each_pixel(tmp_path, pixel_format, becomes):
    plate = write_clip(tmp_path / "in.mkv", [noise_frame(64, 48, pixel_format)] * 3)
    copy(plate, tmp_path / "out.y4m")
    with av.open(str(tmp_path / "out.y4m")) as made:
        assert [one.format.name for one in made.decode(video=0)] == [becomes] * 3


def test_rgb_that_is_asked_for_is_refused(tmp_path):
    plate = write_clip(tmp_path / "in.mkv", [noise_frame(64, 48, "yuv420p")] * 3)
    with pytest.raises(UsageError, match="does not hold rawvideo in rgb24"):
        copy(plate, tmp_path / "out.y4m", pix_fmt="rgb24")
