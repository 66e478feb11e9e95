"""A second video of the plate, which is copied, can be decoded in a range too."""

from fractions import Fraction

import av
import pytest
from support.clips import copy, copy_range, noise_frame, planes

RATE = 25


def write_two_videos(path, group):
    """Fifty pictures of two videos; the second one has a key frame every `group` pictures."""
    options = {"bf": "2", "g": str(group), "sc_threshold": "0", "x264-params": "cpu-independent=1"}
    with av.open(str(path), "w") as out:
        videos = [out.add_stream("mpeg4", RATE), out.add_stream("libx264", RATE, options)]
        for video in videos:
            video.width, video.height, video.pix_fmt = 64, 48, "yuv420p"
        for index in range(50):
            for video in videos:
                frame = noise_frame(64, 48, "yuv420p", index)
                frame.pts, frame.time_base = index, Fraction(1, RATE)
                out.mux(video.encode(frame))
        for video in videos:
            out.mux(video.encode(None))
    return path


def pictures(path):
    """Time [s] and samples of each picture of the second video."""
    with av.open(str(path)) as source:
        if len(source.streams.video) < 2:
            return []
        return [(frame.time, planes(frame)[0].tolist()) for frame in source.decode(video=1)]


@pytest.mark.parametrize("plate_ending", ["mp4", "mkv", "avi"])
def test_second_video_of_h264_is_copied_into_avi(tmp_path, plate_ending):
    """AVI takes H.264 with start codes alone, which files of ISO media and Matroska have not."""
    plate = write_two_videos(tmp_path / f"in.{plate_ending}", group=16)
    notes = copy(plate, tmp_path / "out.avi")
    assert not [note for note in notes if "(video)" in note]
    expected, found = pictures(plate), pictures(tmp_path / "out.avi")
    assert [samples for _, samples in found] == [samples for _, samples in expected]


@pytest.mark.parametrize("ending", ["mp4", "mkv", "ts", "nut"])
def test_second_video_of_a_matroska_file_keeps_its_first_pictures(tmp_path, ending):
    """FFmpeg finds no decoding times for these where pictures are reordered."""
    plate = write_two_videos(tmp_path / "in.mkv", group=16)
    assert copy(plate, tmp_path / f"out.{ending}") == ()
    expected, found = pictures(plate), pictures(tmp_path / f"out.{ending}")
    assert [samples for _, samples in found] == [samples for _, samples in expected]


@pytest.mark.parametrize("ending", ["mp4", "mkv", "ts"])
def test_second_video_of_a_range_begins_at_its_first_key_frame(tmp_path, ending):
    plate = write_two_videos(tmp_path / "in.mp4", group=16)
    notes = copy_range(plate, tmp_path / f"out.{ending}", 20, 44)
    assert "stream 1 (video) begins 0.480 s later, at its first key frame in the range" in notes
    expected, found = pictures(plate)[32:44], pictures(tmp_path / f"out.{ending}")
    assert len(found) <= len(expected) + 2  # those that the last ones are predicted from
    assert [samples for _, samples in found[:12]] == [samples for _, samples in expected]
    with av.open(str(tmp_path / f"out.{ending}")) as out:
        begun = next(out.decode(video=0)).time
    assert found[0][0] - begun == pytest.approx(0.48, abs=0.001)


@pytest.mark.parametrize("ending", ["mp4", "mkv"])
def test_second_video_without_a_key_frame_in_the_range_is_noted(tmp_path, ending):
    plate = write_two_videos(tmp_path / "in.mp4", group=100)
    notes = copy_range(plate, tmp_path / f"out.{ending}", 20, 44)
    assert "stream 1 (video) has no pictures: the range holds none of its key frames" in notes
    assert pictures(tmp_path / f"out.{ending}") == []


def test_second_video_of_key_frames_is_whole_in_a_range(tmp_path):
    plate = write_two_videos(tmp_path / "in.mp4", group=1)
    notes = copy_range(plate, tmp_path / "out.mp4", 20, 44)
    assert not [note for note in notes if "(video)" in note]
    assert len(pictures(tmp_path / "out.mp4")) == 24
