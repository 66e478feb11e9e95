"""Files that appear complete or not at all."""

import errno
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


def failing(monkeypatch, *numbers, error=errno.ENOSPC):
    """Renaming fails at these calls, counted from 1."""
    rename, seen = Path.replace, []

    def replace(path, target):
        seen.append(target)
        if len(seen) in numbers:
            raise OSError(error, os.strerror(error))
        return rename(path, target)

    monkeypatch.setattr(Path, "replace", replace)


def contents(folder):
    return {path.name: path.read_bytes() for path in folder.iterdir() if path.is_file()}


@pytest.mark.parametrize("error", [errno.ENOSPC, errno.EACCES])
def test_failure_while_a_sequence_gets_its_names_leaves_what_was_there(
    tmp_path, monkeypatch, error
):
    clip = write_clip(tmp_path / "in.mkv", [noise_frame(32, 24, "gray", s) for s in range(8)])
    for number in (1, 2, 6):
        (tmp_path / f"p_{number}.png").write_text(f"former {number}")
    before = contents(tmp_path)
    failing(monkeypatch, 4, error=error)
    with pytest.raises(OutputError, match=r"p_3\.png: cannot be written") as caught:
        copy(clip, tmp_path / "p_%d.png")
    assert contents(tmp_path) == before
    assert [path.name for path in tmp_path.iterdir() if path.is_dir()] == []
    assert "already" not in str(caught.value)


def test_folder_of_the_name_of_a_later_frame_leaves_none_of_a_sequence(tmp_path):
    clip = write_clip(tmp_path / "in.mkv", [noise_frame(32, 24, "gray", s) for s in range(4)])
    (tmp_path / "p_2.png").mkdir()
    with pytest.raises(OutputError, match=r"p_2\.png: cannot be written \(Is a directory\)"):
        copy(clip, tmp_path / "p_%d.png")
    assert {path.name for path in tmp_path.iterdir()} == {"in.mkv", "p_2.png"}


def test_failure_while_a_sequence_gets_its_names_keeps_all_frames_where_that_was_requested(
    tmp_path, monkeypatch
):
    clip = write_clip(tmp_path / "in.mkv", [noise_frame(32, 24, "gray", s) for s in range(8)])
    (tmp_path / "p_1.png").write_text("former")
    failing(monkeypatch, 4)
    with pytest.raises(OutputError):
        copy(clip, tmp_path / "p_%d.png", keep_partial=True)
    kept = contents(tmp_path / "p_%d.partial")
    assert sorted(kept) == [f"p_{number}.png" for number in range(8)]
    assert all(one.startswith(b"\x89PNG") for one in kept.values())
    assert contents(tmp_path)["p_1.png"] == b"former"


@pytest.mark.parametrize(
    ("links", "calls", "told"),
    [
        (True, range(4, 20), "; already there: p_0.png to p_2.png"),
        (False, (4,), "; already there: p_1.png"),
    ],
)
def test_what_cannot_be_taken_back_is_told(tmp_path, monkeypatch, links, calls, told):
    clip = write_clip(tmp_path / "in.mkv", [noise_frame(32, 24, "gray", s) for s in range(8)])
    (tmp_path / "p_1.png").write_text("former")
    failing(monkeypatch, *calls)
    if not links:
        monkeypatch.setattr(os, "link", _no_links)
    with pytest.raises(OutputError) as caught:
        copy(clip, tmp_path / "p_%d.png")
    assert str(caught.value).endswith(told)


def _no_links(*_):
    raise OSError(errno.EPERM, "no links here")
