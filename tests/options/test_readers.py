"""Readers of option values that have several spellings."""

import os

import pytest

from nlens_video.core.errors import UsageError
from nlens_video.options.parser import parse


@pytest.mark.parametrize(
    ("given", "read"),
    [
        ("png/p.####.png", "png/p.%04d.png"),
        ("p_######.exr", "p_%06d.exr"),
        ("p.%04d.png", "p.%04d.png"),
        ("sh##/p.png", "sh##/p.png"),
        ("take#2.mov", "take#2.mov"),
        ("take##.mkv", "take##.mkv"),
        ("a/TAKE_####.MOV", "a/TAKE_####.MOV"),
        ("p_####.dpx", "p_%04d.dpx"),
        ("p.##.####.png", "p.##.####.png"),
        ("rtsp://camera/p##", "rtsp://camera/p##"),
        ("-", "-"),
    ],
)
def test_hashes_number_the_files_of_a_sequence(given, read):
    args = parse([given, "a.glb", given, "--layers", given, "--holdout", given])
    assert [args.input, args.output, args.layers, args.holdout] == [read] * 4


def test_file_whose_own_name_has_hashes_is_that_file(tmp_path):
    own = tmp_path / "p.####.png"
    own.touch()
    assert parse([str(own), "a.glb", "o.mp4"]).input == str(own)


@pytest.mark.parametrize(
    ("table", "said"),
    [
        (r'{file = "a\u0000b"}', "file: has a NUL character"),
        ("{a = " + "[" * 20_000, "is no table, such as"),
    ],
)
def test_object_that_cannot_be_read_is_told_shortly(table, said):
    with pytest.raises(UsageError) as caught:
        parse(["in.mp4", "a.glb", "o.mp4", "--object", table])
    assert said in str(caught.value)
    assert len(str(caught.value)) < 300


@pytest.mark.parametrize("option", ["--fit", "--camera-from", "--holdout", "--env-map", "--layers"])
@pytest.mark.parametrize("protocol", ["", "file:"])
def test_pipe_for_a_file_that_is_read_more_than_once_is_refused(tmp_path, option, protocol):
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    with pytest.raises(UsageError, match=rf"{option}\b.*pipe' is a pipe or a device; give a file"):
        parse(["in.mp4", "a.glb", "o.mp4", option, f"{protocol}{pipe}"])


def test_plate_and_result_may_be_pipes(tmp_path):
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    args = parse([str(pipe), "a.glb", str(pipe)])
    assert [args.input, args.output] == [str(pipe)] * 2


@pytest.mark.parametrize(
    "option", ["--timings", "--save-fit", "--save-shot", "--report", "--aov", "--fit"]
)
def test_standard_stream_in_place_of_a_file_is_refused(option):
    with pytest.raises(UsageError, match=f"{option}: '-' is a standard stream; give a file"):
        parse(["in.mp4", "a.glb", "o.mp4", option, "-"])
    assert parse(["in.mp4", "a.glb", "o.mp4", "--timings", "./-"]).timings.name == "-"
