"""A farm's result is the single run's, bit for bit, though its workers die."""

import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from support import shots
from support.command import nlens, one_line

from nlens_video.cli import solve_command
from nlens_video.cli.main import main
from nlens_video.core.errors import UsageError
from nlens_video.farm import job
from nlens_video.farm.chunk import mark_of
from nlens_video.farm.job import prepare, ranges, run_job
from nlens_video.farm.store import Folder
from nlens_video.networks.device import why_no_cuda
from nlens_video.options.parser import parse
from nlens_video.options.to_settings import settings

FRAMES = 12


@pytest.fixture(scope="module")
def shot(tmp_path_factory):
    slide = {"start": (-0.2, 0, -1.6), "end": (0.3, 0, -1.5), "seconds": 0.4}
    return shots.write_shot(tmp_path_factory.mktemp("farm"), FRAMES, fit=False, **slide)


def arguments(folder, out, *more):
    given = [str(folder / "in.mp4"), str(folder / "anim.glb"), str(folder / out)]
    return [*given, "--preset", "realtime", "--codec", "ffv1", *more]


@pytest.fixture(scope="module")
def whole(shot):
    assert main([*arguments(shot, "whole.mkv"), "-q"]) == 0
    return shot / "whole.mkv"


def children_at_work(chunks):
    """Processes that are writing a chunk, by the partial files' names."""
    files = list(chunks.iterdir()) if chunks.is_dir() else []
    found = (re.search(r"partial-\w+-(\d+)\.nut$", file.name) for file in files)
    return [int(match[1]) for match in found if match]


@pytest.mark.slow
@pytest.mark.needs_gl
def test_farm_with_a_killed_worker_equals_the_single_run_bit_for_bit(shot, whole):
    command = [sys.executable, "-m", "nlens_video", "farm", *arguments(shot, "out.mkv")]
    command += ["--workers", "2", "--chunk", "0.12", "--chunks", str(shot / "chunks"), "--json"]
    run = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    killed = None
    deadline = time.monotonic() + 200
    while killed is None and run.poll() is None and time.monotonic() < deadline:
        for process in children_at_work(shot / "chunks"):
            os.kill(process, signal.SIGKILL)
            killed = process
            break
        time.sleep(0.002)
    said, errors = run.communicate(timeout=200)
    assert run.returncode == 0, errors
    assert killed is not None
    (note,) = json.loads(said)["notes"]
    assert re.match(r"frames \d+ to \d+ of .*in\.mp4: done again \(", note)
    shots.assert_same_frames(whole, shot / "out.mkv")
    assert len(list((shot / "chunks").glob("[!.]*.nut"))) == 4
    assert not children_at_work(shot / "chunks")
    assert shots.audio_packets(shot / "out.mkv") == shots.audio_packets(whole) != []


TERMINATED = """
import os, signal, time
from nlens_video.core import signals
from nlens_video.farm.on_ray import Cluster, _connected
from nlens_video.farm.ray_folder import ray_folder

def interrupted():
    try:
        os.kill(os.getpid(), signal.SIGTERM)
        time.sleep(1)
    except KeyboardInterrupt:
        signals.requested.clear()
        return True
    return False

signal.signal(signal.SIGTERM, signals.handler)
with ray_folder(local=True) as folder, _connected(Cluster(workers=1), folder):
    during = interrupted()
print(during, interrupted())
"""


@pytest.mark.slow
def test_termination_signal_is_handled_during_and_after_a_ray_session():
    """While the last piece is joined Ray has ended: half-written results would stay behind."""
    ran = subprocess.run(
        [sys.executable, "-c", TERMINATED], capture_output=True, text=True, timeout=100, check=False
    )
    assert (ran.returncode, ran.stdout) == (0, "True True\n"), ran.stderr


TERMINATED_AT_START = """
import os, signal, sys, threading
from nlens_video.core import signals
from nlens_video.farm.on_ray import Cluster, _connected
from nlens_video.farm.ray_folder import ray_folder

signal.signal(signal.SIGTERM, signals.handler)
threading.Timer(float(sys.argv[1]), os.kill, (os.getpid(), signal.SIGTERM)).start()
try:
    with ray_folder(local=True) as folder, _connected(Cluster(workers=1), folder):
        threading.Event().wait(20)
except KeyboardInterrupt:
    print("interrupted")
"""


@pytest.mark.slow
@pytest.mark.parametrize("after_s", [0.05, 0.4, 0.8])
def test_termination_signal_interrupts_while_ray_starts(after_s):
    """Ray has a handler of its own meanwhile, which would end the program without a word."""
    ran = subprocess.run(
        [sys.executable, "-c", TERMINATED_AT_START, str(after_s)],
        capture_output=True, text=True, timeout=100, check=False,
    )  # fmt: skip
    assert (ran.returncode, ran.stdout) == (0, "interrupted\n"), ran.stderr


@pytest.mark.slow
@pytest.mark.needs_gl
def test_job_renders_only_missing_chunks(shot, whole, monkeypatch):
    run = settings(parse(["farm", *arguments(shot, "loop.mkv")]))
    rendered = []

    class RecordedFeed(job.ChunkFeed):
        def add(self, mark):
            rendered.append(mark.first)
            super().add(mark)

    monkeypatch.setattr(job, "ChunkFeed", RecordedFeed)
    told = []
    for _ in range(2):
        run_job(run, shot / "loop", 0.2, lambda done, total: told.append((done, total)))
    assert rendered == [0, 5, 10]
    assert told == [(0, 12), (5, 12), (10, 12), (12, 12), (12, 12)]
    shots.assert_same_frames(whole, shot / "loop.mkv")
    next((shot / "loop").glob("*-00000005-*.nut")).unlink()
    run_job(run, shot / "loop", 0.2, lambda done, total: None)
    assert rendered == [0, 5, 10, 5]


@pytest.mark.slow
@pytest.mark.needs_gl
def test_list_of_shots_is_rendered_and_a_failing_shot_stops_no_other(shot, whole, capfd):
    jobs = shot / "jobs.toml"
    listed = [
        (shot / "in.mp4", shot / "anim.glb", shot / "one.mkv"),
        (shot / "gone.mp4", shot / "anim.glb", shot / "none.mkv"),
        (shot / "in.mp4", shot / "anim.glb", shot / "two.mkv"),
    ]
    jobs.write_text(
        "".join(
            f'[[shot]]\nin = "{plate}"\nobject = "{glb}"\nout = "{out}"\n'
            'options = ["--preset", "realtime", "--codec", "ffv1"]\n'
            for plate, glb, out in listed
        )
    )
    assert main(["farm", "--jobs", str(jobs), "--workers", "2", "--chunk", "10"]) == 3
    said = capfd.readouterr().err
    assert said.count("merged") == 2
    assert f"nlens-video: shot 2 ({shot / 'gone.mp4'}): {shot / 'gone.mp4'}: no such file" in said
    shots.assert_same_frames(whole, shot / "one.mkv")
    shots.assert_same_frames(whole, shot / "two.mkv")
    assert not (shot / "none.mkv").exists()
    assert not [path.name for path in shot.iterdir() if path.name.endswith(".chunks")]


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "lists no"),
        ("[[shot]]\nin = 3", "must be texts"),
        ('[[shot]]\nin = "a"\nobject = "b"\nout = "c.mkv"\ninput = "d"', "no 'input' there"),
        ('[[shot]]\nin = "a"\nobject = "b"\nout = "c.mkv"\noptions = ["--colour"]', "--colour"),
        (
            '[[shot]]\nin = "a"\nobject = "b"\nout = "c.mkv"\n[[shot]]\nin = "a"\nobject = "b"\n'
            'out = "d.mkv"\noptions = ["--timings", "t.json"]',
            "jobs.toml: shot 2: --timings: is written by runs that render all frames at once",
        ),
        (2 * '[[shot]]\nin = "a"\nobject = "b"\nout = "c.mkv"\n', "two shots write c.mkv"),
        ('[[shot]]\nshot = "a.toml"\nin = "b"', "no 'in' there; expected shot, options"),
        ('[[shot]]\nshot = "missing.toml"', "missing.toml: cannot be read as a shot file"),
        ("not toml", "cannot be read"),
        (f"a = {'[' * 20_000}", "nested too deeply"),
        ('[[shot]]\nin = "a\\u0000b"\nobject = "b"\nout = "c.mkv"', "IN: has a NUL character"),
    ],
)
def test_invalid_list_of_shots_is_refused_in_one_line(text, says, tmp_path, capsys):
    jobs = tmp_path / "jobs.toml"
    jobs.write_text(text)
    assert main(["farm", "--jobs", str(jobs)]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1 and says in said


@pytest.mark.slow
@pytest.mark.parametrize(
    ("declared", "says"),
    [
        ("0", "the cluster declares no GPU; start its machines with ray start --num-gpus N"),
        ("2", "--device cuda: "),  # the worker was placed, and finds that the GPU is none
    ],
)
def test_gpu_worker_is_placed_only_where_the_cluster_declares_a_gpu(
    declared, says, shot, capfd, monkeypatch
):
    """The GPUs are Ray's book-keeping: where none is at hand, the worker says so."""
    if declared != "0" and not why_no_cuda():
        says = ""
    monkeypatch.setenv("RAY_OVERRIDE_RESOURCES", f'{{"GPU": {declared}}}')
    chunks = ["--chunks", str(shot / "gpu")]
    command = ["farm", *arguments(shot, "gpu.mkv"), "--workers", "1", *chunks]
    assert main([*command, "--device", "cuda", "-q"]) == (2 if says else 0)
    said = capfd.readouterr().err
    assert says in said and said.count("nlens-video: ") == bool(says)


@pytest.mark.slow
@pytest.mark.needs_gl
@pytest.mark.parametrize("focus", ["auto", "off"])  # counted by the look for a change, or alone
def test_frame_count_of_a_plate_equals_the_decoded_frames(shot, focus, tmp_path):
    run = settings(parse(["farm", *arguments(shot, "no.mkv"), "--track-focus", focus]))
    store = Folder(tmp_path)
    first = prepare(run, store, 0.2)
    assert first == prepare(run, store, 0.2)  # the fit is there: another way to count
    assert first.frames == FRAMES
    assert [(mark.first, mark.end) for mark in first.marks] == [(0, 5), (5, 10), (10, 12)]
    assert first.fit is not None and (tmp_path / first.fit).is_file()


def test_chunk_ranges_cover_every_frame_once():
    assert list(ranges(12, 5)) == [(0, 5), (5, 10), (10, 12)]
    assert list(ranges(10, 5)) == [(0, 5), (5, 10)]
    assert list(ranges(3, 5)) == [(0, 3)]


def test_farm_refuses_options_of_single_runs(shot, tmp_path):
    refused = (
        (["--range", "2:4"], "--range: chunks are made of all frames"),
        (["--frame", "3"], "--range or --frame: chunks are made of all frames"),
        (["--timings", "t.json"], "--timings: is written by runs that render all frames at once"),
        (["--report", "r"], "--report: is written by runs that render all frames at once"),
        (["--aov", "layers"], "--aov: is written by runs that render all frames at once"),
    )
    for more, said in refused:
        run = settings(parse(["farm", *arguments(shot, "no.mkv", *more)]))
        with pytest.raises(UsageError, match=f"^{said}"):
            run_job(run, tmp_path, 1.0, None)
    assert not list(Path(tmp_path).iterdir())


@pytest.mark.parametrize("more", [["--hold-budget"], ["--codec", "x264lib"], ["--fit", "no.json"]])
@pytest.mark.parametrize("command", [["farm"], ["render", "--resume"]])
def test_refused_farm_and_resume_leave_no_folder_of_chunks(shot, tmp_path, command, more):
    name, *resume = command
    refused = nlens(name, *arguments(shot, tmp_path / "out.mkv", *resume, *more))
    assert one_line(refused, 5 if "--fit" in more else 2)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "more",
    [
        ["--range", "0:3"],
        ["--frame", "3"],
        ["--report", "r"],
        ["--aov", "layers"],
        ["--timings", "t.json"],
        ["--save-fit", "kept.json"],
        ["--hold-budget"],
    ],
)
@pytest.mark.parametrize("command", [["farm"], ["render", "--resume"]])
def test_plan_of_chunks_refuses_what_the_run_refuses(shot, tmp_path, monkeypatch, command, more):
    monkeypatch.chdir(tmp_path)
    name, *resume = command
    words = [name, *arguments(shot, "no.mkv", *resume, *more)]
    lines = [one_line(nlens(*words, *plan), 2) for plan in ([], ["--plan"])]
    assert lines[0] == lines[1]
    assert more[0] in lines[0]
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("more", "named"),
    [([], "--fit"), (["--fit", "fit.json", "--crf", "20"], "the encoding"),
     (["--fit", "fit.json", "--hold-budget"], "--hold-budget")],
)  # fmt: skip
def test_plan_of_one_chunk_refuses_what_the_run_refuses(shot, tmp_path, more, named):
    given = [shot / word if word == "fit.json" else word for word in more]
    plate, scene = shot / "in.mp4", shot / "anim.glb"
    words = ["render", plate, scene, tmp_path / "chunks", "--chunk-out", *given]
    lines = [one_line(nlens(*words, *plan), 2) for plan in ([], ["--plan"])]
    assert lines[0] == lines[1]
    assert named in lines[0]
    assert not list(tmp_path.iterdir())


def test_what_cannot_be_chunks_is_refused_before_its_camera_is_solved(shot, tmp_path, monkeypatch):
    bare = shots.cube_glb(tmp_path / "bare.glb", camera=False)
    monkeypatch.setattr(solve_command, "solve_plate", lambda *given: pytest.fail("it is solved"))
    words = [shot / "in.mp4", bare, tmp_path / "no.mkv", "--at", "0.5,0.8", "--resume"]
    line = one_line(nlens(*words, "--range", "0:3"), 2)
    assert "--range: chunks are made of all frames" in line


@pytest.mark.parametrize("files", [[], ["0123456789abcdef-00000000-00000002.nut"]])
def test_refused_resume_promises_nothing_of_the_same_command(shot, tmp_path, files):
    chunks = tmp_path / "out.mkv.chunks"
    chunks.mkdir()
    for file in files:
        (chunks / file).touch()
    refused = nlens(*arguments(shot, tmp_path / "out.mkv", "--resume", "--range", "0:3"))
    assert one_line(refused, 2).endswith("all frames and only them; leave it out")


@pytest.mark.parametrize(
    ("files", "kept"),
    [
        (["0123456789abcdef-00000000-00000002.nut"], True),
        (["fit-0123456789abcdef.json"], True),
        (["mine.txt"], False),
        ([".0123456789abcdef-00000000-00000002.partial-a-1.nut"], False),
        ([], False),
    ],
)
def test_failed_resume_says_that_it_goes_on_only_where_something_is_done(
    shot, tmp_path, files, kept
):
    plate = tmp_path / "in.mp4"
    plate.write_bytes(b"no video")
    chunks = tmp_path / "out.mkv.chunks"
    chunks.mkdir()
    for file in files:
        (chunks / file).touch()
    failed = nlens(plate, shot / "anim.glb", tmp_path / "out.mkv", "--resume")
    assert ("chunks holds what is done" in one_line(failed, 3)) == kept


def test_farm_refuses_what_depends_on_the_machine_by_the_name_of_the_help(shot, tmp_path):
    for given in ("--hold-budget", "--adaptive-quality"):
        run = settings(parse(["farm", *arguments(shot, "no.mkv", given)]))
        with pytest.raises(UsageError, match="^--hold-budget: what it writes depends"):
            mark_of(run)
