"""Files that appear complete or not at all."""

import pytest

from nlens_video.core.errors import OutputError
from nlens_video.video.atomic_files import partial_name, replacing


def test_full_disk_while_writing_text_is_a_one_line_error(tmp_path):
    path = tmp_path / "fit.json"
    partial_name(tmp_path / "fit.json").symlink_to("/dev/full")
    with (
        pytest.raises(OutputError, match=r"fit\.json: cannot be written \(No space left") as caught,
        replacing(path) as partial,
    ):
        partial.write_text("x" * 100000)
    assert "\n" not in str(caught.value)
    assert not list(tmp_path.iterdir())


def test_unrelated_missing_file_error_is_not_replaced(tmp_path):
    with pytest.raises(FileNotFoundError, match="other"), replacing(tmp_path / "fit.json"):
        (tmp_path / "other").read_text()
    assert not list(tmp_path.iterdir())
