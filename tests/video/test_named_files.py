"""Awkward names: what is there on disk is meant, whatever it looks like."""

import pytest
from support import shots

from nlens_video.video.input.source import open_source
from nlens_video.video.output.sink import open_sink


@pytest.mark.parametrize(
    "name", ["take:1.mp4", "100%done.mp4", "shot_%04d.mp4", "é 猫.mp4", "-in.mp4", "a b.mp4"]
)
def test_video_with_an_unusual_file_name_is_read_and_written(tmp_path, monkeypatch, name):
    monkeypatch.chdir(tmp_path)
    shots.write_video(tmp_path / "plain.mp4", frames=3, rgb=shots.grey()[:64, :96], audio=False)
    (tmp_path / "plain.mp4").rename(tmp_path / name)
    with open_source(name) as source, open_sink(f"out_{name}", source.info) as sink:
        for frame in source:
            sink.write(frame)
        sink.commit()
    (tmp_path / f"out_{name}").rename(tmp_path / "result.mp4")
    assert len(shots.read_planes(tmp_path / "result.mp4")) == 3
