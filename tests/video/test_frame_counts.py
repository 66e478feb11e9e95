"""How many frames a file says that it has equals how many are shown."""

import av
import pytest
from support import shots
from support.clips import trim

from nlens_video.video.input.source import open_source


def stated_and_shown(path):
    with open_source(str(path)) as source:
        return source.info.frame_count, sum(1 for _ in source)


@pytest.mark.parametrize("ending", ["mp4", "mov"])
def test_frames_before_the_beginning_of_an_edit_list_do_not_count(tmp_path, ending):
    whole = shots.write_video(tmp_path / f"whole.{ending}", 24, audio=False)
    path = trim(whole, tmp_path / f"in.{ending}", 16)
    with av.open(str(path)) as stored:
        assert stored.streams.video[0].frames == 24
    assert stated_and_shown(path) == (8, 8)


def test_frames_behind_the_end_of_an_edit_list_do_not_count(tmp_path):
    path = shots.write_video(tmp_path / "in.mp4", 24, audio=False)
    data = bytearray(path.read_bytes())
    at = data.index(b"elst") + 12  # behind name, version and number of edits
    duration_ms = int.from_bytes(data[at : at + 4], "big")
    data[at : at + 4] = (duration_ms // 2).to_bytes(4, "big")
    path.write_bytes(data)
    assert stated_and_shown(path) == (12, 12)


def test_frames_of_later_fragments_count(tmp_path):
    whole = shots.write_video(tmp_path / "whole.mp4", 24, audio=False, group=6)
    path = trim(whole, tmp_path / "in.mp4", 0, movflags="frag_keyframe")
    with av.open(str(path)) as stored:
        assert stored.streams.video[0].frames == 6
    assert stated_and_shown(path) == (24, 24)


def test_frames_of_matroska_are_counted_by_the_length_of_the_video_not_of_longer_sound(tmp_path):
    path = shots.write_video(tmp_path / "in.mkv", 12)
    with av.open(str(path)) as stored:
        assert stored.duration / av.time_base * 25 > 12.5
    assert stated_and_shown(path) == (12, 12)
