"""Numbered sequences: which files they are, what is missing, what is written."""

import pytest
from clips import copy, write_plates

from nlens_video.errors import OutputError
from nlens_video.video.sink import open_sink
from nlens_video.video.source import open_source


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
def test_the_plates_are_not_overwritten_under_another_spelling(tmp_path, monkeypatch, plate, name):
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


def test_a_sequence_of_the_same_name_in_another_folder_is_no_overwriting(tmp_path):
    write_plates(tmp_path, 1001, 1002)
    (tmp_path / "out").mkdir()
    copy(tmp_path / "p_%04d.png", tmp_path / "out" / "p_%04d.png")
    assert len(list((tmp_path / "out").iterdir())) == 2
