"""Files that appear complete or not at all."""

import errno
import os
import platform
import signal
import subprocess
import sys
from pathlib import Path

import pytest
from support.clips import copy, noise_frame, write_clip

from nlens_video.core import signals
from nlens_video.core.errors import OutputError
from nlens_video.options.files import chunks_beside
from nlens_video.video.atomic_files import kept_name, left_over, partial_name, replacing


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


def filled(letter, end):
    """The longest name of a letter and an end: 255 bytes, or so many fewer as letters take."""
    return letter * ((255 - len(end.encode())) // len(letter.encode())) + end


@pytest.mark.parametrize("letter", ["x", "\u00fc", "\u6620", "\U0001f3ac"])
@pytest.mark.parametrize("end", [".mkv", "_%d.png"])
def test_longest_names_that_a_folder_takes_are_written(tmp_path, letter, end):
    clip = write_clip(tmp_path / "in.mkv", [noise_frame(32, 24, "gray", s) for s in range(2)])
    out = tmp_path / "out"
    out.mkdir()
    name = filled(letter, end)
    copy(clip, out / name)
    assert {path.name for path in out.iterdir()} == {name.replace("%d", str(n)) for n in range(2)}


@pytest.mark.parametrize("letter", ["x", "\u00fc", "\u6620", "\U0001f3ac"])
def test_names_beside_a_result_fit_whatever_the_names_of_file_and_machine(
    tmp_path, monkeypatch, letter
):
    monkeypatch.setattr(platform, "node", lambda: "render-node-" * 5)
    for end in (".mkv", "1.mkv", "22.mkv", "333.mkv"):  # cut within any byte of a letter
        path = tmp_path / filled(letter, end)
        for beside in (partial_name(path), kept_name(path), chunks_beside(path)):
            beside.write_bytes(b"x")
            assert ".mkv" in beside.suffixes and beside.name.startswith((letter, f".{letter}"))


def test_what_killed_runs_left_of_long_names_is_told_apart(tmp_path):
    one, other = (tmp_path / filled("x", f"{end}.mkv") for end in ("one", "other"))
    ended = subprocess.Popen([sys.executable, "-c", ""])
    ended.wait()
    for path in (one, other):
        partial = partial_name(path)
        partial.with_name(partial.name.replace(f"-{os.getpid()}.", f"-{ended.pid}.")).touch()
    (left,), (also,) = left_over(one), left_over(other)
    assert left != also
    assert kept_name(one) != kept_name(other) and chunks_beside(one) != chunks_beside(other)
    assert sorted((left, also)) == left_over(one, whole_folder=True)


def test_frames_of_a_sequence_with_a_long_name_are_kept_where_that_was_requested(
    tmp_path, monkeypatch
):
    clip = write_clip(tmp_path / "in.mkv", [noise_frame(32, 24, "gray", s) for s in range(4)])
    failing(monkeypatch, 2)
    with pytest.raises(OutputError):
        copy(clip, tmp_path / filled("x", "_%d.png"), keep_partial=True)
    (kept,) = tmp_path.glob("*.partial")
    assert len(contents(kept)) == 4
