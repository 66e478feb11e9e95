"""MXF holds all pictures of a shot, each with sound of its time."""

import av
from support.clips import copy, noise_frame, write_clip


def count(path, kind):
    """Packets of the first stream of a kind."""
    with av.open(str(path)) as source:
        return sum(packet.size > 0 for packet in source.demux(source.streams.best(kind)))


def test_a_shot_without_cuts_gets_key_frames_as_often_as_its_index_requires(tmp_path):
    still = noise_frame(32, 24, "yuv420p")
    plate = write_clip(tmp_path / "in.mp4", [still] * 400, codec="libx264")
    copy(plate, tmp_path / "out.mxf")
    assert count(tmp_path / "out.mxf", "video") == 400
