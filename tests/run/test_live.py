"""Frames that come at their own pace: through real pipes, from a producer that does not wait."""

import json
import subprocess
import sys
import time
from fractions import Fraction

import av
import pytest
from support import shots

from nlens_video.cli.main import main

pytestmark = pytest.mark.needs_gl
FRAMES, RATE = 50, 25


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    slide = {"end": (0.2, 0.0, -2.0), "seconds": 2.0}
    return shots.write_shot(tmp_path_factory.mktemp("live"), **slide)


def produce(pipe):
    """Raw frames in NUT at their own pace; what is not taken in time is late, not lost."""
    picture = av.VideoFrame.from_ndarray(shots.plate(), "rgb24").reformat(format="yuv420p")
    start = time.monotonic()
    with av.open(pipe, "w", format="nut") as out:
        stream = out.add_stream("rawvideo", rate=RATE)
        stream.width, stream.height, stream.pix_fmt = shots.WIDTH, shots.HEIGHT, "yuv420p"
        for number in range(FRAMES):
            time.sleep(max(0.0, start + number / RATE - time.monotonic()))
            picture.pts, picture.time_base = number, Fraction(1, RATE)
            out.mux(stream.encode(picture))
    pipe.close()


def command(files, out, *words):
    said = [sys.executable, "-m", "nlens_video", "-", files / "anim.glb", out,
            "--fit", files / "fit.json", "--json", *words]  # fmt: skip
    return [*map(str, said)]


def run(files, out, *words):
    """A run fed by the producer; its summary, and the times of what was written [frames]."""
    running = subprocess.Popen(
        command(files, out, *words),
        stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
    )  # fmt: skip
    produce(running.stdin)
    running.stdin = None
    said, errors = running.communicate(timeout=200)
    assert running.returncode == 0, errors.decode()
    with av.open(str(out)) as result:
        times = [frame.pts * frame.time_base * RATE for frame in result.decode(video=0)]
    return json.loads(said)["timing"], [round(moment) for moment in times]


@pytest.mark.slow
def test_every_frame_of_a_paced_source_is_written_and_latency_is_reported(files, tmp_path):
    timing, times = run(files, tmp_path / "out.mkv", "--preset", "draft")
    assert times == list(range(FRAMES)) and timing["dropped"] == 0
    assert timing["node_median_ms"]["decode"] < 0.5 * 1000 / RATE  # waiting is no cost of a frame
    assert 0 < timing["latency_median_ms"] <= timing["latency_p95_ms"] * 1.02


@pytest.mark.slow
def test_late_frames_are_dropped_and_counted_and_others_keep_their_times(files, tmp_path):
    words = ("--preset", "reference", "--late", "drop")
    timing, times = run(files, tmp_path / "out.mkv", *words)
    assert timing["dropped"] > 0
    assert timing["frames"] + timing["dropped"] == FRAMES and len(times) == timing["frames"]
    assert times == sorted(set(times)) and set(times) <= set(range(FRAMES))


@pytest.mark.slow
def test_dropped_late_frames_are_not_reported_as_a_truncated_source(files, tmp_path):
    given = shots.write_video(tmp_path / "in.mkv", FRAMES, rate=RATE)  # its header tells how many
    words = command(files, tmp_path / "out.mkv", "--preset", "reference", "--late", "drop")
    with given.open("rb") as pipe:  # read as fast as it can be, and so late at once
        told = json.loads(subprocess.run(words, stdin=pipe, capture_output=True, check=True).stdout)
    assert told["timing"]["dropped"] > FRAMES // 4
    assert not [note for note in told["notes"] if "cut short" in note]


def test_frames_of_a_file_are_never_late(files, tmp_path, capsys):
    words = (files / "in.mp4", files / "anim.glb", tmp_path / "o.mp4", "--late", "drop")
    assert main([*map(str, words)]) == 2
    assert "leave it out" in capsys.readouterr().err


def test_latency_of_a_file_is_not_reported(files, tmp_path, capsys):
    words = (files / "in.mp4", files / "anim.glb", tmp_path / "o.mp4", "--preset", "draft",
             "--fit", files / "fit.json", "--json")  # fmt: skip
    assert main([*map(str, words)]) == 0
    assert json.loads(capsys.readouterr().out)["timing"]["latency_median_ms"] == 0
