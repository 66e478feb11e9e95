"""Raw pictures in .y4m: all depths that FFmpeg writes, to the bit."""

import os
import threading

import av
import numpy as np
import pytest
from support.clips import copy, noise_frame, planes, write_clip

from nlens_video.core.errors import OutputError

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


def test_pictures_that_y4m_does_not_hold_are_refused_by_their_format(tmp_path):
    rgb = [noise_frame(64, 48, "rgb24")] * 3
    plate = write_clip(tmp_path / "in.mkv", rgb, codec="libx264rgb")
    with pytest.raises(OutputError, match="in gbrp at 25 frames per second"):
        copy(plate, tmp_path / "out.y4m")
