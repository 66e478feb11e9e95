"""Files that appear complete or not at all."""

import os
import signal
from pathlib import Path

import pytest
from support.clips import copy, noise_frame, write_clip

from nlens_video.core import signals
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


@pytest.fixture
def _own_signals():
    """After a signal the program ignores more of them until it ends; the tests go on."""
    before = {number: signal.getsignal(number) for number in signals.ENDING}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)
    signals.requested.clear()


@pytest.mark.usefixtures("_own_signals")
@pytest.mark.parametrize("keep", [False, True])
def test_interrupt_while_a_sequence_gets_its_names_is_raised_when_all_have_them(
    tmp_path, monkeypatch, keep
):
    clip = write_clip(tmp_path / "in.mkv", [noise_frame(32, 24, "gray", s) for s in range(8)])
    rename, seen = Path.replace, []

    def replace(path, target):
        seen.append(target)
        if len(seen) == 4:
            os.kill(os.getpid(), signal.SIGINT)
        return rename(path, target)

    monkeypatch.setattr(Path, "replace", replace)
    with pytest.raises(KeyboardInterrupt) as caught, signals.interruptible():
        copy(clip, tmp_path / "p_%d.png", keep_partial=keep)
    names = {path.name for path in tmp_path.iterdir()}
    assert names == {"in.mkv", *(f"p_{number}.png" for number in range(8))}
    assert caught.value.__notes__ == [f"{tmp_path / 'p_%d.png'} is complete"]


@pytest.mark.usefixtures("_own_signals")
def test_interrupt_while_a_sequence_goes_to_the_disk_leaves_none_of_it(tmp_path, monkeypatch):
    clip = write_clip(tmp_path / "in.mkv", [noise_frame(32, 24, "gray", s) for s in range(8)])
    flush, seen = os.fsync, []

    def fsync(number):
        seen.append(number)
        if len(seen) == 4:
            os.kill(os.getpid(), signal.SIGTERM)
        flush(number)

    monkeypatch.setattr(os, "fsync", fsync)
    with pytest.raises(KeyboardInterrupt), signals.interruptible():
        copy(clip, tmp_path / "p_%d.png")
    assert [path.name for path in tmp_path.iterdir()] == ["in.mkv"]
