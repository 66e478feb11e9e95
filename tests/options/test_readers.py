"""Readers of option values that have several spellings."""

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
