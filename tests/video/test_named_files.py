"""Names of sources and results: numbered sequences, their gaps, awkward file names."""

from pathlib import Path

import av
import numpy as np
import pytest
from msgspec.structs import replace
from support import shots
from support.clips import copy, noise_frame, write_plates

from nlens_video.core.errors import InputError, OutputError
from nlens_video.video.exr import LayerReader, write_layers
from nlens_video.video.input.holdout import open_holdout
from nlens_video.video.input.source import open_source
from nlens_video.video.output.sink import open_sink


def grey(path):
    """The one code of a plate's first plane."""
    with av.open(str(path)) as source:
        (frame,) = source.decode(video=0)
        return np.unique(frame.to_ndarray())


@pytest.mark.parametrize(
    ("plate", "name"),
    [
        ("p_%04d.png", "./p_%04d.png"),
        ("p_%04d.png", "../{folder}/p_%04d.png"),
        ("p_%04d.png", "link/p_%04d.png"),
        ("p_%04d.png", "p_%d.png"),
        ("p_%04d.png", "p_1002.png"),
        ("p_1001.png", "p_%04d.png"),
        ("p_1001.png", "../{folder}/p_1001.png"),
    ],
)
def test_sequence_is_not_overwritten_through_another_spelling_of_its_pattern(
    tmp_path, monkeypatch, plate, name
):
    write_plates(tmp_path, 1001, 1002)
    (tmp_path / "link").symlink_to(tmp_path)
    monkeypatch.chdir(tmp_path)
    target = name.format(folder=tmp_path.name)
    with (
        open_source(plate) as source,
        pytest.raises(OutputError, match="is the input as well") as caught,
    ):
        open_sink(target, source.info)
    assert "\n" not in str(caught.value)


def test_sequence_of_the_same_name_in_another_folder_is_allowed(tmp_path):
    write_plates(tmp_path, 1001, 1002)
    (tmp_path / "out").mkdir()
    copy(tmp_path / "p_%04d.png", tmp_path / "out" / "p_%04d.png")
    assert len(list((tmp_path / "out").iterdir())) == 2


def test_frames_of_a_range_keep_their_numbers(tmp_path):
    plates = write_plates(tmp_path, *range(1001, 1007))
    with (
        open_source(str(plates)) as source,
        open_sink(str(tmp_path / "out_%04d.png"), source.info) as sink,
    ):
        for frame in source:
            if 2 <= frame.index < 5:
                sink.write(replace(frame, pts=frame.index - 2))
        sink.commit()
    names = sorted(path.name for path in tmp_path.glob("out_*"))
    assert names == ["out_1003.png", "out_1004.png", "out_1005.png"]
    for number in (1003, 1004, 1005):
        np.testing.assert_array_equal(
            grey(tmp_path / f"out_{number}.png"), grey(tmp_path / f"p_{number}.png")
        )


def test_gap_in_a_sequence_is_reported_before_the_run(tmp_path):
    plates = write_plates(tmp_path, 1001, 1002, 1003, 1005, 1006)
    with pytest.raises(InputError, match=r"p_1004\.png: is missing.* with p_1005\.png"):
        open_source(str(plates))


def test_gap_in_an_openexr_sequence_is_reported_before_the_run(tmp_path):
    for number in (9, 10, 12):
        pixels = np.zeros((4, 4), np.float32)
        write_layers(tmp_path / f"p_{number}.exr", dict.fromkeys("RGB", pixels))
    with pytest.raises(InputError, match=r"p_11\.exr: is missing.* with p_12\.exr"):
        open_source(str(tmp_path / "p_%d.exr"))


def test_frames_before_a_read_error_are_delivered(tmp_path):
    for number in range(24):  # more than what is read ahead on opening
        noise_frame(512, 384, "rgb24").save(str(tmp_path / f"p_{number}.png"))
    with open_source(str(tmp_path / "p_%d.png")) as source:
        (tmp_path / "p_21.png").unlink()
        assert [frame.index for frame in source] == list(range(21))
        assert source.damaged


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


@pytest.mark.parametrize("ending", ["png", "exr"])
def test_picture_whose_name_looks_like_a_pattern_is_one_picture(tmp_path, ending):
    plate = tmp_path / f"100%d.{ending}"
    if ending == "exr":
        write_layers(plate, dict.fromkeys("RGB", np.full((48, 64), 0.25, np.float32)))
    else:
        noise_frame(64, 48, "rgb24").save(str(plate))
    assert copy(plate, tmp_path / f"out.{ending}") == ()
    with open_source(str(plate)) as before, open_source(str(tmp_path / f"out.{ending}")) as after:
        assert before.info.kind == "still"
        light = [next(iter(one)).picture.srgb() for one in (before, after)]
    np.testing.assert_array_equal(*light)


def test_holdout_and_layer_whose_names_look_like_patterns_are_one_file(tmp_path):
    name = str(tmp_path / "100%d.exr")
    write_layers(Path(name), dict.fromkeys("RGBAZ", np.full((6, 8), 0.5, np.float32)))
    layer, holdout = LayerReader(name, (8, 6)), open_holdout(name, (8, 6))
    for frame in (0, 3):
        assert layer.read(frame).rgba == pytest.approx(0.5, abs=1e-3)
        assert holdout.read(frame).depth == pytest.approx(0.5, abs=1e-3)
