"""Faults outside the program: full disks, unwritable folders, unusual names."""

import json
import os
import resource
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import av
import cv2
import numpy as np
import OpenEXR
import pytest
from hard.faults import kills
from support import shots

from nlens_video.cli.main import main
from nlens_video.core.errors import NlensError, OutputError
from nlens_video.farm.store import Folder, FolderInUse
from nlens_video.networks import model_store
from nlens_video.options.files import chunks_beside
from nlens_video.run import preflight as preflight_module
from nlens_video.video.atomic_files import left_over, partial_name, remove_stale
from nlens_video.video.input.source import open_source
from nlens_video.video.output.sink import open_sink

pytestmark = pytest.mark.needs_gl
FULL = "File too large"


@pytest.fixture(scope="module")
def shot(tmp_path_factory):
    slide = {"start": (-0.2, 0, -1.6), "end": (0.3, 0, -1.5)}
    return shots.write_shot(tmp_path_factory.mktemp("shot"), 30, **slide)


def arguments(shot, out, *more):
    given = [str(shot / "in.mp4"), str(shot / "anim.glb"), str(out)]
    return [*given, "--fit", str(shot / "fit.json"), "--preset", "realtime", "-q", *more]


def run(command, **options):
    return subprocess.run(
        [sys.executable, "-m", "nlens_video", *command], capture_output=True, text=True,
        timeout=120, **options,
    )  # fmt: skip


def small_files():
    resource.setrlimit(resource.RLIMIT_FSIZE, (40_000, 40_000))


@pytest.mark.parametrize("more", [(), ("--keep-partial",), ("--resume",)])
def test_disk_full_midway_is_a_one_line_error_without_a_result(shot, tmp_path, more):
    done = run(
        arguments(shot, tmp_path / "out.mp4", "--codec", "ffv1", *more), preexec_fn=small_files
    )
    assert done.returncode == 6, done.stderr
    assert done.stderr.count("\n") == 1
    assert "cannot be written" in done.stderr
    left = {path.name for path in tmp_path.iterdir()}
    assert left == ({"out.mp4.chunks"} if more == ("--resume",) else set())
    if left:
        assert "the same command goes on" in done.stderr
        assert main(arguments(shot, tmp_path / "out.mp4", "--codec", "ffv1", *more)) == 0
        assert [path.name for path in tmp_path.iterdir()] == ["out.mp4"]


def little_memory():
    resource.setrlimit(resource.RLIMIT_AS, (3 << 30, 3 << 30))


def test_out_of_memory_is_a_one_line_error_without_a_result(shot, tmp_path):
    assert cv2.imwrite(str(tmp_path / "large.png"), np.full((12000, 12000, 3), 90, np.uint8))
    given = [str(tmp_path / "large.png"), str(shot / "anim.glb"), str(tmp_path / "out.png")]
    done = run(
        [*given, "--fit", str(shot / "fit.json"), "--preset", "draft"], preexec_fn=little_memory
    )
    assert done.returncode == 1
    assert done.stderr.startswith("nlens-video: out of memory (")
    assert done.stderr.count("\n") == 1
    assert [path.name for path in tmp_path.iterdir()] == ["large.png"]


def test_full_disk_leaves_no_file_of_an_image_sequence(shot, tmp_path):
    done = run(arguments(shot, tmp_path / "o_%03d.png"), preexec_fn=small_files)
    assert (done.returncode, done.stderr.count("\n")) == (6, 1), done.stderr
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("out", ["/proc/out.mp4", "/proc/o_%03d.png", "/proc/version/out.mp4"])
def test_unwritable_location_is_a_one_line_error(shot, out, capsys):
    assert main(arguments(shot, out)) == 6
    said = capsys.readouterr().err
    assert said.count("\n") == 1 and out in said


@pytest.mark.parametrize("name", ["with space.mp4", "ünï-日本.mp4", "-dash.mp4", "a%b'c\".mp4"])
def test_unusual_file_names_are_read_and_written(shot, tmp_path, name):
    folder = tmp_path / "in put"
    folder.mkdir()
    shutil.copy(shot / "in.mp4", folder / name)
    shutil.copy(shot / "anim.glb", folder / f"{name}.glb")
    before = {path: path.stat().st_mtime_ns for path in folder.iterdir()}
    given = [f"./{name}", f"./{name}.glb", f"../{name}", "--fit", str(shot / "fit.json")]
    done = run([*given, "--preset", "realtime", "-q"], cwd=folder)
    assert (done.returncode, done.stderr) == (0, "")
    assert {path: path.stat().st_mtime_ns for path in folder.iterdir()} == before
    assert {path.name for path in tmp_path.iterdir()} == {"in put", name}


def test_file_names_with_leading_dashes_follow_a_double_dash(shot, tmp_path):
    shutil.copy(shot / "in.mp4", tmp_path / "-in.mp4")
    options = ["--fit", str(shot / "fit.json"), "--preset", "realtime", "-q"]
    done = run([*options, "--", "-in.mp4", str(shot / "anim.glb"), "-out.mp4"], cwd=tmp_path)
    assert (done.returncode, done.stderr) == (0, "")
    assert (tmp_path / "-out.mp4").is_file()


class Failing:
    """An encoder that gives up at its third frame."""

    def __init__(self, context):
        self.context, self.calls = context, 0

    def encode(self, frame=None):
        self.calls += 1
        if self.calls == 3:
            raise av.UnknownError(1, "encoder failed")
        return self.context.encode(frame)


@pytest.mark.parametrize("keep", [False, True])
def test_encoder_failure_midway_raises_one_error_without_a_result(shot, tmp_path, keep):
    with (
        pytest.raises(OutputError, match="cannot be written") as caught,
        open_source(str(shot / "in.mp4")) as source,
        open_sink(str(tmp_path / "out.mkv"), source.info, keep_partial=keep) as sink,
    ):
        sink._stream = Failing(sink._stream)
        for frame in source:
            sink.write(frame)
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "out.mkv").exists()
    assert not list(tmp_path.glob(".*"))


@pytest.mark.parametrize("more", [(), ("--keep-partial",)])
def test_encoder_failure_in_a_run_is_a_one_line_error_without_a_result(
    shot, tmp_path, capsys, monkeypatch, more
):
    def opened(*given, **named):
        sink = open_sink(*given, **named)
        sink._stream = Failing(sink._stream)
        return sink

    monkeypatch.setattr(preflight_module, "open_sink", opened)
    assert main(arguments(shot, tmp_path / "out.mkv", *more)) == 6
    said = capsys.readouterr().err
    assert said.count("\n") == 1 and "out.mkv: cannot be written" in said
    left = [path.name for path in tmp_path.iterdir()]
    assert left == (["out.partial.mkv"] if more else [])
    if more:
        assert said.endswith(f"the part written so far is {tmp_path / left[0]}\n")
        assert len(shots.read_planes(tmp_path / left[0])) >= 2


def test_resumable_run_interrupted_twice_keeps_its_chunks_and_can_be_completed(tmp_path):
    folder = kills.make_shot(tmp_path / "shot")
    kills.finish(folder, "--resume")
    undisturbed = kills.decoded(folder / "out.mp4")
    (folder / "out.mp4").unlink()
    running = kills.start(folder, "--resume")
    chunks, deadline = folder / "out.mp4.chunks", time.monotonic() + 120
    while not list(chunks.glob("[0-9a-f]*.nut")) and time.monotonic() < deadline:
        time.sleep(0.05)
    for _ in range(2):
        running.send_signal(signal.SIGINT)
        time.sleep(0.02)
    _, said = running.communicate(timeout=60)
    assert running.returncode == 130
    assert said.decode().count("\n") == 1 and "the same command goes on" in said.decode()
    assert not (folder / "out.mp4").exists()
    left = {path.name: path.stat().st_mtime_ns for path in chunks.glob("[0-9a-f]*.nut")}
    assert left and not list(folder.glob(".*"))
    kills.finish(folder, "--resume")
    assert kills.decoded(folder / "out.mp4") == undisturbed
    assert {path.name for path in folder.iterdir()} == {"in.mp4", "anim.glb", "out.mp4"}


def test_library_crash_names_its_source_line_and_leaves_no_result(tmp_path):
    folder = kills.make_shot(tmp_path / "shot", 300)
    running = kills.start(folder)
    deadline = time.monotonic() + 120
    while not list(folder.glob(".out.partial-*")) and time.monotonic() < deadline:
        time.sleep(0.05)
    running.send_signal(signal.SIGSEGV)  # as the processor answers a stray pointer
    _, said = running.communicate(timeout=60)
    assert running.returncode == -signal.SIGSEGV
    assert b"Fatal Python error: Segmentation fault" in said and b"nlens_video" in said
    assert not (folder / "out.mp4").exists()
    kills.finish(folder)
    assert {path.name for path in folder.iterdir()} == {"in.mp4", "anim.glb", "out.mp4"}


def test_library_output_does_not_reach_pictures_or_json(shot, tmp_path):
    """OpenEXR's binding prints a warning on standard output when a file ends too early."""
    light = np.random.default_rng(0).random((shots.HEIGHT, shots.WIDTH, 3), np.float32)
    head = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    for number in range(3):
        with OpenEXR.File(head, {"RGB": light}) as file:
            file.write(str(tmp_path / f"p_{number}.exr"))
    whole = (tmp_path / "p_1.exr").read_bytes()
    (tmp_path / "p_1.exr").write_bytes(whole[: len(whole) // 2])
    given = [str(tmp_path / "p_%d.exr"), str(shot / "anim.glb")]
    given += ["--fit", str(shot / "fit.json"), "--preset", "draft"]
    command = [sys.executable, "-m", "nlens_video", *given]
    streamed = subprocess.run([*command, "-", "-q"], capture_output=True, timeout=120, check=True)
    assert b"Warning" in streamed.stderr and b"Warning" not in streamed.stdout
    (tmp_path / "out.nut").write_bytes(streamed.stdout)
    assert len(shots.read_planes(tmp_path / "out.nut")) == 2
    done = run([*given, str(tmp_path / "o_%d.exr"), "--json"])
    assert json.loads(done.stdout)["damaged"] == 1, done.stderr


def test_damaged_or_missing_network_error_states_what_to_do(tmp_path):
    shutil.copytree(model_store.models_folder(), tmp_path / "models")
    path = model_store.find_model("coc", tmp_path / "models").path
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)
    with pytest.raises(NlensError, match="not the shipped weights; install"):
        model_store.find_model("coc", tmp_path / "models")
    path.unlink()
    with pytest.raises(NlensError, match="cannot be read .*; install"):
        model_store.find_model("coc", tmp_path / "models")


def gone():
    """A process number that nobody has any more."""
    child = subprocess.Popen([sys.executable, "-c", ""])
    child.wait()
    return child.pid


def test_only_temporary_files_of_ended_local_processes_are_removed(tmp_path):
    out = tmp_path / "out[1].mp4"
    mine = partial_name(out)
    dead = Path(str(mine).replace(f"-{os.getpid()}", f"-{gone()}"))
    elsewhere = tmp_path / f".out[1].partial-otherhost-{gone()}.mp4"
    other = tmp_path / dead.name.replace("out[1]", "two")
    for path in (mine, dead, elsewhere, other):
        path.write_bytes(b"x")
    assert left_over(out) == [dead]
    (note,) = remove_stale(out)
    assert dead.name in note
    assert set(tmp_path.iterdir()) == {mine, elsewhere, other}


def test_concurrent_runs_do_not_share_chunks_and_other_files_are_kept(tmp_path):
    folder = chunks_beside(tmp_path / "out.mp4")
    with Folder(folder).held(), pytest.raises(OutputError, match="another run is using it"):
        with Folder(folder).held():
            pass
    folder.mkdir()
    (folder / ("0" * 16 + "-00000000-end.nut")).write_bytes(b"x")
    (folder / "mine.txt").write_bytes(b"x")
    Folder(folder).clear()
    assert [path.name for path in folder.iterdir()] == ["mine.txt"]


def test_second_resumable_run_of_a_result_is_refused_in_one_line(shot, tmp_path, capsys):
    out = tmp_path / "out.mp4"
    with Folder(chunks_beside(out)).held():
        assert main(arguments(shot, out, "--resume")) == 6
    said = capsys.readouterr().err
    assert said.endswith(
        "out.mp4.chunks: another run is using it; wait for it, or give OUT another name\n"
    )
    assert said.count("\n") == 1 and not out.exists()
    assert main(arguments(shot, out, "--resume")) == 0


def test_resumable_run_removes_its_chunks_while_no_other_run_can_begin(shot, tmp_path, monkeypatch):
    clear, refused = Folder.clear, []

    def cleared(folder):
        with pytest.raises(FolderInUse) as error, folder.held():
            pass
        refused.append(error)
        clear(folder)

    monkeypatch.setattr(Folder, "clear", cleared)
    assert main(arguments(shot, tmp_path / "out.mp4", "--resume")) == 0
    assert len(refused) == 1
    assert [path.name for path in tmp_path.iterdir()] == ["out.mp4"]


def test_options_of_single_runs_are_refused_with_resume(shot, tmp_path, capsys):
    for more, told in (
        (["--report", str(tmp_path / "r")], "is written by runs that render all frames at once"),
        (["--range", "2:4"], "chunks are made of all frames"),
    ):
        assert main(arguments(shot, tmp_path / "out.mp4", "--resume", *more)) == 2
        assert f"{more[0]}: {told}" in capsys.readouterr().err
    assert not list(tmp_path.iterdir())
