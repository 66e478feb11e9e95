"""The command line on real files, and as a process of its own."""

import contextlib
import itertools
import json
import os
import signal
import subprocess
import sys
import time
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np
import pytest
from support import shots
from support.command import nlens, one_line, process

pytestmark = pytest.mark.needs_gl


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    slide = {"end": (0.3, 0.0, -2.6), "seconds": 0.5}
    folder = shots.write_shot(tmp_path_factory.mktemp("shot"), **slide)
    shots.write_video(folder / "long.mp4", frames=100)
    return folder


@pytest.mark.slow
def test_output_video_has_every_frame_time_and_audio_packet_of_the_plate(files, tmp_path):
    run = nlens(
        files / "in.mp4", files / "anim.glb", tmp_path / "out.mp4",
        "--save-fit", tmp_path / "fit.json", "--timings", tmp_path / "t.json", "--json",
    )  # fmt: skip
    assert run.returncode == 0, run.stderr
    before, after = shots.read_planes(files / "in.mp4"), shots.read_planes(tmp_path / "out.mp4")
    assert [pts for pts, _ in after] == [pts for pts, _ in before]
    assert shots.audio_packets(tmp_path / "out.mp4") == shots.audio_packets(files / "in.mp4")
    summary = json.loads(run.stdout)
    assert summary["timing"]["frames"] == 12 and summary["composited"] == 12
    timings = json.loads((tmp_path / "t.json").read_text())
    assert timings["budget_ms"] == 180 and timings["preset"] == "standard"
    assert len(timings["frames"]) == 12
    assert timings["aliases"]["reblur"] == "scatter"
    assert set(timings["aliases"]) <= set(timings["frames"][0]["nodes"])
    assert {"decode", "render", "composite", "encode"} <= set(timings["frames"][5]["nodes"])
    assert "fit" in timings["frames"][0]["nodes"] and "fit" not in timings["frames"][1]["nodes"]
    fit = json.loads((tmp_path / "fit.json").read_text())
    assert fit["model"] == "coc_px = slope * disparity + intercept"
    assert (fit["width"], fit["height"], fit["frame"]) == (shots.WIDTH, shots.HEIGHT, 0)


@pytest.mark.slow
def test_summary_of_a_still_has_no_statistics_of_frames(files, tmp_path):
    run = nlens(files / "plate.png", files / "anim.glb", tmp_path / "out.png", "--no-progress")
    assert run.returncode == 0, run.stderr
    lines = run.stderr.splitlines()
    assert f"wrote  {tmp_path / 'out.png'}, 1 frame" in lines
    told = [line for line in lines if line.startswith("frame ")]
    assert len(told) == 1 and told[0].endswith(" ms with the fit") and "median" not in told[0]


def test_summary_of_a_still_with_a_given_lens_tells_of_no_fit(files, tmp_path):
    run = nlens(files / "plate.png", files / "anim.glb", tmp_path / "out.png", "--no-progress",
                "--preset", "draft", "--fit", files / "fit.json")  # fmt: skip
    assert run.returncode == 0, run.stderr
    (told,) = [line for line in run.stderr.splitlines() if line.startswith("frame ")]
    assert told.endswith(" ms") and "fit" not in told


@pytest.mark.slow
def test_lens_fit_is_estimated_from_the_plate(files, tmp_path):
    run = nlens("fit", files / "plate.png", files / "anim.glb", tmp_path / "fit.json")
    assert run.returncode == 0, run.stderr
    fit = json.loads((tmp_path / "fit.json").read_text())
    for depth in (1.9, 2.4, 3.5):  # of the ground that the plate shows, the object's among them
        true = shots.SLOPE / depth + shots.INTERCEPT
        assert fit["slope"] / depth + fit["intercept"] == pytest.approx(true, abs=1.5)


def test_samples_outside_the_object_are_bit_identical_to_the_plate(files, tmp_path):
    shots.write_video(tmp_path / "in.mkv", codec="ffv1", pix_fmt="yuv420p", frames=4)
    run = nlens(
        tmp_path / "in.mkv", files / "anim.glb", tmp_path / "out.mkv", "--effects", "defocus",
        "--fit", files / "fit.json", "--aov", tmp_path / "aov",
    )  # fmt: skip
    assert run.returncode == 0, run.stderr
    before, after = shots.read_planes(tmp_path / "in.mkv"), shots.read_planes(tmp_path / "out.mkv")
    assert len(after) == 4
    for (_, old), (_, new), layer in zip(
        before, after, sorted((tmp_path / "aov").iterdir()), strict=True
    ):
        alpha = read_channel(layer, "A")
        reached = cv2.dilate((alpha > 0).astype(np.uint8), np.ones((3, 3), np.uint8)) > 0
        assert 0 < reached.mean() < 0.3
        assert np.array_equal(old[0][~reached], new[0][~reached])
        assert (old[0] != new[0])[reached].mean() > 0.5
        small = cv2.resize(
            reached.astype(np.uint8), old[1].shape[::-1], interpolation=cv2.INTER_AREA
        )
        grown = cv2.dilate(small, np.ones((3, 3), np.uint8)) > 0
        for plane in (1, 2):
            assert np.array_equal(old[plane][~grown], new[plane][~grown])


def read_channel(path, name):
    import OpenEXR

    with OpenEXR.File(str(path), separate_channels=True) as file:
        return np.array(file.channels()[name].pixels)


@pytest.mark.slow
def test_two_runs_give_identical_pictures(files, tmp_path):
    for name in ("a.mkv", "b.mkv"):
        run = nlens(
            files / "in.mp4", files / "anim.glb", tmp_path / name, "--codec", "ffv1",
            "--save-fit", tmp_path / f"{name}.json",
        )  # fmt: skip
        assert run.returncode == 0, run.stderr
    first, second = shots.read_planes(tmp_path / "a.mkv"), shots.read_planes(tmp_path / "b.mkv")
    assert (tmp_path / "a.mkv.json").read_text() == (tmp_path / "b.mkv.json").read_text()
    shots.assert_same_frames(first, second)


@pytest.mark.slow
def test_saved_fit_reproduces_the_picture(files, tmp_path):
    plate, glb = files / "plate.png", files / "anim.glb"
    first = nlens(plate, glb, tmp_path / "a.png", "--save-fit", tmp_path / "fit.json")
    second = nlens(
        plate, glb, tmp_path / "b.png", "--fit", tmp_path / "fit.json",
        "--timings", tmp_path / "t.json",
    )  # fmt: skip
    assert first.returncode == second.returncode == 0, first.stderr + second.stderr
    assert (tmp_path / "a.png").read_bytes() == (tmp_path / "b.png").read_bytes()
    nodes = json.loads((tmp_path / "t.json").read_text())["frames"][0]["nodes"]
    assert "estimate-coc" not in nodes and "fit" not in nodes


@pytest.mark.slow
def test_still_plate_gives_a_still_with_the_object(files, tmp_path):
    run = nlens(files / "plate.png", files / "anim.glb", tmp_path / "out.png")
    assert run.returncode == 0, run.stderr
    before, after = cv2.imread(str(files / "plate.png")), cv2.imread(str(tmp_path / "out.png"))
    assert before.shape == after.shape
    changed = np.abs(before.astype(int) - after).max(axis=2) > 10
    assert 0.005 < changed.mean() < 0.3


def test_image_sequence_is_read_and_written(files, tmp_path):
    for number in range(7, 10):
        shots.write_png(tmp_path / f"plate_{number:04d}.png")
    run = nlens(
        tmp_path / "plate_%04d.png", files / "anim.glb", tmp_path / "out_%04d.png",
        "--fit", files / "fit.json", "--input-rate", "25",
    )  # fmt: skip
    assert run.returncode == 0, run.stderr
    assert len(list(tmp_path.glob("out_*.png"))) == 3


@pytest.mark.slow
def test_variable_frame_rate_plate_keeps_every_pts(files, tmp_path):
    pts = [0, 33, 95, 120, 210, 214, 300, 391]
    shots.write_video(
        tmp_path / "in.mkv", frames=8, codec="ffv1", audio=False, pts=pts,
        time_base=Fraction(1, 1000),
    )  # fmt: skip
    run = nlens(
        tmp_path / "in.mkv", files / "anim.glb", tmp_path / "out.mkv", "--fit", files / "fit.json"
    )
    assert run.returncode == 0, run.stderr
    assert [at for at, _ in shots.read_planes(tmp_path / "out.mkv")] == pts


@pytest.mark.slow
def test_range_option_writes_only_those_frames_of_the_animation(files, tmp_path):
    whole = nlens(
        files / "in.mp4", files / "anim.glb", tmp_path / "whole.mkv", "--codec", "ffv1",
        "--fit", files / "fit.json",
    )  # fmt: skip
    part = nlens(
        files / "in.mp4", files / "anim.glb", tmp_path / "part.mkv", "--codec", "ffv1",
        "--fit", files / "fit.json", "--range", "5:9",
    )  # fmt: skip
    assert whole.returncode == part.returncode == 0, whole.stderr + part.stderr
    frames, some = (
        shots.read_planes(tmp_path / "whole.mkv"),
        shots.read_planes(tmp_path / "part.mkv"),
    )
    assert len(some) == 4 and some[0][0] == 0
    for (_, a), (_, b) in zip(frames[5:9], some, strict=True):
        assert np.array_equal(a[0], b[0])


@pytest.mark.slow
def test_range_option_keeps_the_audio_of_its_frames(files, tmp_path):
    run = nlens(
        files / "long.mp4", files / "anim.glb", tmp_path / "part.mp4",
        "--fit", files / "fit.json", "--range", "30:80",
    )  # fmt: skip
    assert run.returncode == 0, run.stderr
    with av.open(str(tmp_path / "part.mp4")) as container:
        sound = [
            (float(p.pts * p.time_base), float((p.pts + p.duration) * p.time_base))
            for p in container.demux(audio=0)
            if p.dts is not None
        ]
    assert -0.03 < sound[0][0] < 0.03
    assert 1.97 < sound[-1][1] < 2.045  # 50 frames at 25 a second; a packet of sound lasts 0.021 s
    assert all(a[1] == pytest.approx(b[0], abs=1e-3) for a, b in itertools.pairwise(sound))


def test_object_out_of_view_leaves_the_plate_unchanged(files, tmp_path):
    shots.cube_glb(tmp_path / "away.glb", start=(0.0, 0.0, 30.0))
    shots.write_video(tmp_path / "in.mkv", codec="ffv1", frames=3, audio=False)
    run = nlens(
        tmp_path / "in.mkv", tmp_path / "away.glb", tmp_path / "out.mkv", "--range", "0:3", "--json"
    )
    assert run.returncode == 0, run.stderr
    outcome = json.loads(run.stdout)
    assert outcome["fit"] is None and outcome["composited"] == 0
    before, after = shots.read_planes(tmp_path / "in.mkv"), shots.read_planes(tmp_path / "out.mkv")
    shots.assert_same_frames(before, after)


def test_effects_none_composites_the_sharp_object(files, tmp_path):
    run = nlens(
        files / "plate.png", files / "anim.glb", tmp_path / "out.png", "--effects", "none", "--json"
    )
    assert run.returncode == 0, run.stderr
    assert json.loads(run.stdout)["fit"] is None


def test_plan_lists_nodes_backends_and_effects_and_writes_no_file(files, tmp_path):
    run = nlens(files / "in.mp4", files / "anim.glb", tmp_path / "out.mp4", "--plan")
    assert run.returncode == 0, run.stderr
    text = run.stdout
    for word in ("pipeline standard", "effect defocus", "node reblur", "onnxruntime", "bt709"):
        assert word in text
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
@pytest.mark.parametrize("form", ["nut", "yuv4mpegpipe", "rawvideo"])
def test_raw_video_on_standard_input_is_a_live_source(files, tmp_path, form):
    """Frames come at 25 fps through a pipe, as a camera would send them."""
    rgb = shots.plate()
    raw = form == "rawvideo"
    words = ["-", files / "anim.glb", tmp_path / "out.mkv", "--fit", files / "fit.json", "--json"]
    if raw:
        size = f"{shots.WIDTH}x{shots.HEIGHT}"
        words += ["--input-format", "rawvideo", "--input-size", size, "--input-rate", "25"]
    run = process(*words, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    feed(run.stdin, form, rgb, frames=15)
    run.stdin = None  # closed: nothing for communicate to flush
    out, err = run.communicate(timeout=120)
    assert run.returncode == 0, err.decode()
    assert json.loads(out)["timing"]["frames"] == 15
    frames = shots.read_planes(tmp_path / "out.mkv")
    with av.open(str(tmp_path / "out.mkv")) as container:
        base = container.streams.video[0].time_base
    seconds = [float((pts - frames[0][0]) * base) for pts, _ in frames]
    assert seconds == pytest.approx([n / 25 for n in range(15)], abs=1.1e-3)


def feed(pipe, form, rgb, frames):
    start = time.monotonic()
    yuv = av.VideoFrame.from_ndarray(rgb, "rgb24").reformat(format="yuv420p")
    if form == "rawvideo":
        planes = yuv.to_ndarray().tobytes()
        for number in range(frames):
            time.sleep(max(0.0, start + number / 25 - time.monotonic()))
            pipe.write(planes)
            pipe.flush()
        pipe.close()
        return
    with av.open(pipe, "w", format=form) as container:
        codec = "rawvideo" if form == "nut" else "wrapped_avframe"
        stream = container.add_stream(codec, rate=25)
        stream.width, stream.height, stream.pix_fmt = rgb.shape[1], rgb.shape[0], "yuv420p"
        for number in range(frames):
            time.sleep(max(0.0, start + number / 25 - time.monotonic()))
            yuv.pts, yuv.time_base = number, Fraction(1, 25)
            container.mux(stream.encode(yuv))
        container.mux(stream.encode())
    pipe.close()


@pytest.mark.slow
def test_result_on_standard_output_is_readable_by_another_process(files, tmp_path):
    run = process(
        files / "in.mp4", files / "anim.glb", "-", "--fit", files / "fit.json", "-q",
        stdout=subprocess.PIPE,
    )  # fmt: skip
    out, err = run.communicate(timeout=120)
    assert run.returncode == 0, err.decode()
    (tmp_path / "out.nut").write_bytes(out)
    frames = shots.read_planes(tmp_path / "out.nut")
    assert len(frames) == 12
    assert shots.audio_packets(tmp_path / "out.nut") == shots.audio_packets(files / "in.mp4")


def test_ffmpeg_input_device_is_opened_by_name(files, tmp_path):
    size = f"{shots.WIDTH}x{shots.HEIGHT}"
    run = nlens(
        f"testsrc2=size={size}:rate=25", files / "anim.glb", tmp_path / "out.mkv",
        "--input-format", "lavfi", "--range", "0:10", "--fit", files / "fit.json", "--json",
    )  # fmt: skip
    assert run.returncode == 0, run.stderr
    assert json.loads(run.stdout)["timing"]["frames"] == 10


def endless(files, output, more=(), **options):
    """A run on a source without an end."""
    return process(
        f"testsrc2=size={shots.WIDTH}x{shots.HEIGHT}:rate=25", files / "anim.glb", output,
        "--input-format", "lavfi", "--fit", files / "fit.json", *more, **options,
    )  # fmt: skip


def _partial_bytes(folder):
    return sum(path.stat().st_size for path in folder.glob(".*partial*"))


def stopped(run, folder, *signals, patience=60):
    """Let a run write some frames, send it signals, wait for its end."""
    deadline = time.monotonic() + patience
    while _partial_bytes(folder) < 40_000 and time.monotonic() < deadline:
        time.sleep(0.1)
    for number in signals:
        run.send_signal(number)
        time.sleep(0.05)
    run.stdin = None
    _, err = run.communicate(timeout=30)
    return err.decode().strip()


def test_interrupt_after_the_result_is_complete_says_so(files, tmp_path, monkeypatch, capsys):
    from nlens_video.cli.main import main
    from nlens_video.graph.nodes.warm_up import WarmUp

    ended = WarmUp.__exit__

    def interrupted(self, *exception):  # one of the last things that a run does
        ended(self, *exception)
        raise KeyboardInterrupt

    monkeypatch.setattr(WarmUp, "__exit__", interrupted)
    out = tmp_path / "out.mp4"
    words = [files / "in.mp4", files / "anim.glb", out, "--fit", files / "fit.json", "-q"]
    assert main([str(word) for word in words]) == 130
    assert capsys.readouterr().err.endswith(f"nlens-video: interrupted; {out} is complete\n")
    assert out.exists()


@pytest.mark.parametrize("name", ["SIGINT", "SIGTERM", "SIGHUP"])
def test_signal_while_the_summary_is_shown_does_not_fail_the_run(files, tmp_path, name):
    out = tmp_path / "out.mp4"
    run = process(files / "in.mp4", files / "anim.glb", out, "--fit", files / "fit.json")
    for line in run.stderr:
        if line.startswith(b"wrote"):
            run.send_signal(getattr(signal, name))
            break
    run.communicate(timeout=60)
    assert run.returncode == 0
    assert out.exists()


NOTHING = "nlens-video: interrupted, no output written"
LOST = "nlens-video: interrupted; no output written (--keep-partial keeps what was recorded)"


@pytest.mark.slow
@pytest.mark.parametrize(
    "signals", [[signal.SIGINT], [signal.SIGTERM], [signal.SIGINT, signal.SIGINT, signal.SIGINT]]
)
def test_interrupt_prints_one_line_and_leaves_no_output(files, tmp_path, signals):
    run = endless(files, tmp_path / "out.mp4")
    message = stopped(run, tmp_path, *signals)
    assert (run.returncode, message) == (130, LOST)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "start",
    ["exec('os.kill(os.getpid(), signal.SIGINT)')", "abused()"],
    ids=["within an exec of text", "that a library takes for something else"],
)
def test_interrupt_during_imports_gives_one_line_and_exit_code_130(tmp_path, start):
    """While modules are loaded: dataclasses are made by exec, libraries run their own start."""
    (tmp_path / "started.py").write_text(f"""
import os, signal, sys
from nlens_video.cli import main as cli

def abused():
    try:
        os.kill(os.getpid(), signal.SIGINT)
    except KeyboardInterrupt:
        raise ImportError("initialization failed")

cli._run = lambda words: {start}
sys.exit(cli.main(["in.mp4"]))
""")
    run = subprocess.run(
        [sys.executable, "-m", "started"], capture_output=True, text=True, timeout=60, check=False,
        cwd=tmp_path,
    )  # fmt: skip
    assert (run.returncode, run.stderr) == (130, f"{NOTHING}\n")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("frames", "told"), [(3, NOTHING), (80, LOST)], ids=["while opening", "while running"]
)
def test_interrupt_ends_a_run_that_waits_for_a_silent_source(files, tmp_path, frames, told):
    run = process(
        "-", files / "anim.glb", tmp_path / "out.mp4", "--fit", files / "fit.json",
        "--codec", "libx264", stdin=subprocess.PIPE,
    )  # fmt: skip
    pipe = run.stdin
    frame = av.VideoFrame.from_ndarray(shots.plate(), "rgb24").reformat(format="yuv420p")
    with av.open(Quiet(pipe), "w", format="nut") as container:
        stream = container.add_stream("rawvideo", rate=25)
        stream.width, stream.height, stream.pix_fmt = shots.WIDTH, shots.HEIGHT, "yuv420p"
        for number in range(frames):
            frame.pts, frame.time_base = number, Fraction(1, 25)
            container.mux(stream.encode(frame))
        message = stopped(run, tmp_path, signal.SIGINT, patience=5)
    with contextlib.suppress(BrokenPipeError):
        pipe.close()
    assert (run.returncode, message) == (130, told)
    assert not list(tmp_path.iterdir())


class Quiet:
    """A pipe that its writer neither ends nor feeds once its reader has gone."""

    def __init__(self, pipe):
        self.pipe = pipe

    def write(self, data):
        with contextlib.suppress(BrokenPipeError):
            self.pipe.write(data)
            self.pipe.flush()
        return len(data)


@pytest.mark.slow
def test_keep_partial_names_a_playable_file_after_an_interrupt(files, tmp_path):
    run = endless(files, tmp_path / "out.mp4", more=["--keep-partial"])
    message = stopped(run, tmp_path, signal.SIGINT)
    assert run.returncode == 130
    (kept,) = tmp_path.iterdir()
    assert message == f"nlens-video: interrupted; the part written so far is {kept}"
    assert len(shots.read_planes(kept)) > 3


@pytest.mark.slow
def test_closed_reader_of_standard_output_ends_the_run_without_an_error(files):
    run = endless(files, "-", stdout=subprocess.PIPE)
    run.stdout.read(100_000)
    run.stdout.close()
    assert run.wait(timeout=60) == 0
    assert run.stderr.read() == b""
    run.stderr.close()


@pytest.mark.slow
@pytest.mark.parametrize("words", [["--help"], ["doctor"], ["completion", "bash"], ["--plan"]])
def test_closed_pipe_behind_printed_text_is_not_a_failure(files, tmp_path, words):
    if words == ["--plan"]:
        words = [files / "plate.png", files / "anim.glb", tmp_path / "out.png", "--plan"]
    unread, written = os.pipe()
    run = process(*words, stdout=written)
    os.close(unread)
    os.close(written)
    _, err = run.communicate(timeout=120)
    assert (run.returncode, err) == (0, b"")


@pytest.mark.slow
@pytest.mark.parametrize("words", [["-q"], ["--json"], ["--plan"]])
def test_full_disk_behind_standard_output_gives_a_one_line_error(files, tmp_path, words):
    out = tmp_path / "out.png" if words != ["-q"] else "-"
    with Path("/dev/full").open("wb") as full:
        run = process(
            files / "plate.png", files / "anim.glb", out, "--fit", files / "fit.json", *words,
            stdout=full,
        )  # fmt: skip
        _, err = run.communicate(timeout=120)
    assert run.returncode == 6
    assert err.startswith(b"nlens-video: ") and err.count(b"\n") == 1 and b"No space left" in err


@pytest.mark.slow
@pytest.mark.parametrize("closed", [1, 2])
def test_run_succeeds_with_standard_output_or_error_closed(files, tmp_path, closed):
    words = [files / "plate.png", files / "anim.glb", tmp_path / "out.png"]
    command = [sys.executable, "-m", "nlens_video", *words, "--fit", files / "fit.json", "--json"]
    shell = ["sh", "-c", f'exec "$@" {closed}>&-', "sh", *map(str, command)]
    assert subprocess.run(shell, capture_output=True, timeout=120, check=False).returncode == 0
    assert (tmp_path / "out.png").is_file()


@pytest.mark.slow
def test_run_succeeds_when_standard_error_is_a_broken_pipe(files, tmp_path):
    unread, written = os.pipe()
    os.close(unread)
    words = [files / "plate.png", files / "anim.glb", tmp_path / "out.png"]
    command = [sys.executable, "-m", "nlens_video", *map(str, words)]
    run = subprocess.run(
        [*command, "--fit", str(files / "fit.json")], stderr=written, timeout=120, check=False
    )
    os.close(written)
    assert run.returncode == 0
    assert (tmp_path / "out.png").is_file()


def test_help_fits_on_a_screen_and_names_the_complete_help():
    run = process("--help", stdout=subprocess.PIPE)
    out, _ = run.communicate(timeout=30)
    assert run.returncode == 0
    assert b"IN ANIM.glb OUT" in out
    lines = out.decode().splitlines()  # it fits on a screen; the whole is one word away
    assert len(lines) <= 40 and max(map(len, lines)) <= 100
    assert b"nlens-video render --help" in out


@pytest.mark.parametrize(
    ("line", "offered"),
    [
        ("nlens-video in.mp4 a.glb b.mp4 --pres", {"--preset "}),
        ("nlens-video fit in.mp4 a.glb b.json --sav", set()),
        ("nlens-video fit in.mp4 a.glb b.json --track", {"--track-focus "}),
        ("nlens-video a.mp4 a.glb b.mp4 --late ", {"keep", "drop"}),
        ("nlens-video doc", {"doctor "}),
        ("nlens-video completion ", {"bash", "zsh", "fish"}),
    ],
)
def test_shell_completes_commands_options_and_their_values(line, offered, tmp_path):
    answer = tmp_path / "answer"
    asked = {"_ARGCOMPLETE": "1", "COMP_LINE": line, "COMP_POINT": str(len(line)), "IFS": "\013",
             "_ARGCOMPLETE_STDOUT_FILENAME": str(answer)}  # fmt: skip
    run = process(env={**os.environ, **asked}, cwd=tmp_path)
    assert run.wait(timeout=30) == 0
    run.stderr.close()
    words = {word for word in answer.read_text().split("\013") if word}
    assert words >= offered and (offered or not words)
    assert not words & {"fit ", "render "}


@pytest.mark.parametrize("shell", ["bash", "zsh", "fish"])
def test_completion_script_names_the_program(shell):
    run = nlens("completion", shell)
    assert run.returncode == 0 and "nlens-video" in run.stdout


STILL = ["plate.png", "anim.glb", "out.png"]
NOT_FINITE = '{{"slope": 3.0, "intercept": 1.0, "width": 9, "height": 9, "n": {}}}'
REFUSED = {
    "unknown option": (2, [*STILL, "--colour"], "--colour"),
    "missing argument": (2, ["in.mp4", "anim.glb"], "OUT"),
    "range that ends before it begins": (2, [*STILL, "--range", "9:4"], "A:B"),
    "range beyond the end": (2, ["in.mp4", "anim.glb", "o.mp4", "--range", "90:99"], "no such fr"),
    "unknown preset": (2, [*STILL, "--preset", "cinematic"], "standard"),
    "pipeline without a composite": (2, [*STILL, "--preset", "part.toml"], "no node 'composite'"),
    "unknown effect": (2, [*STILL, "--effects", "glitter"], "defocus"),
    "device that is not there": (2, [*STILL, "--device", "cuda"], "cpu"),
    "negative time budget": (2, [*STILL, "--budget-ms", "-3"], "positive"),
    "missing plate": (3, ["none.mp4", "anim.glb", "out.mp4"], "none.mp4"),
    "plate that is not a video": (3, ["text.mp4", "anim.glb", "out.mp4"], "text.mp4"),
    "file that is not glTF": (4, ["plate.png", "bad.glb", "out.png"], "bad.glb"),
    "plate without texture": (5, ["grey.png", "anim.glb", "out.png"], "--fallback constant"),
    "ground plane out of view": (5, [*STILL, "--ground-y", "50"], "--ground-y"),
    "invalid fit file": (5, [*STILL, "--fit", "steep.json"], "slope"),
    "fit file with NaN": (5, [*STILL, "--fit", "NaN.json"], '"n"'),
    "fit file with 1e999": (5, [*STILL, "--fit", "1e999.json"], '"n"'),
    "fit file with -Infinity": (5, [*STILL, "--fit", "-Infinity.json"], '"n"'),
    "missing output folder": (6, ["plate.png", "anim.glb", "no/out.png"], "no"),
    "missing folder of the fit": (6, [*STILL, "--save-fit", "no/fit.json"], "no"),
    "output that is the plate": (6, ["plate.png", "anim.glb", "plate.png"], "plate"),
}


@pytest.fixture(scope="module")
def faulty(files, tmp_path_factory):
    """The files of a run, and unusable ones beside them."""
    folder = tmp_path_factory.mktemp("faulty")
    for name in ("in.mp4", "plate.png", "anim.glb"):
        (folder / name).symlink_to(files / name)
    (folder / "text.mp4").write_text("not a video at all")
    (folder / "bad.glb").write_bytes(b"glTF but not really")
    shots.write_png(folder / "grey.png", shots.grey())
    (folder / "part.toml").write_text('nodes = ["object-bounds", "render", "crop-sharp"]')
    (folder / "steep.json").write_text('{"slope": "steep"}')
    for number in ("NaN", "1e999", "-Infinity"):
        (folder / f"{number}.json").write_text(NOT_FINITE.format(number))
    return folder


class TestExitCodes:
    @pytest.mark.parametrize("case", REFUSED)
    def test_refused_run_has_its_exit_code_and_one_line(self, faulty, monkeypatch, case):
        code, arguments, expected = REFUSED[case]
        monkeypatch.chdir(faulty)
        before = sorted(faulty.iterdir())
        assert expected in one_line(nlens(*arguments), code)
        assert sorted(faulty.iterdir()) == before

    def test_constant_fallback_replaces_a_fit_that_cannot_be_found(self, faulty, tmp_path):
        run = nlens(
            faulty / "grey.png", faulty / "anim.glb", tmp_path / "out.png",
            "--fallback", "constant", "--json",
        )  # fmt: skip
        assert run.returncode == 0, run.stderr
        outcome = json.loads(run.stdout)
        assert outcome["fit"]["slope"] == 0 and outcome["fit"]["sign"] == "assumed"
        assert any("constant CoC" in note for note in outcome["notes"])

    @pytest.mark.parametrize("option", [None, "--save-fit", "--timings"])
    def test_exit_code_6_instead_of_replacing_a_pipe_by_a_file(self, files, tmp_path, option):
        pipe = tmp_path / "pipe.png"
        os.mkfifo(pipe)
        out, more = (pipe, []) if option is None else (tmp_path / "out.png", [option, pipe])
        given = [files / "plate.png", files / "anim.glb", out, "--fit", files / "fit.json"]
        assert "is a device or a pipe; give the name" in one_line(nlens(*given, *more), 6)
        assert list(tmp_path.iterdir()) == [pipe] and pipe.is_fifo()

    @pytest.mark.parametrize(
        ("option", "name", "what"),
        [
            ("--save-fit", "in.mp4", "the plate"),
            ("--save-fit", "./link.mp4", "the plate"),
            ("--timings", "anim.glb", "the scene"),
            ("--timings", "out.mp4", "the result"),
            ("--save-fit", "sky.hdr", "--env-map"),
            ("--timings", "m_0001.png", "--holdout"),
            ("--aov", ".", "--layers"),
            (None, "fog.exr", "--layers"),
        ],
    )
    def test_exit_code_6_for_an_output_that_is_one_of_the_inputs(
        self, files, tmp_path, option, name, what
    ):
        for one in ("in.mp4", "anim.glb", "fit.json", "plate.png"):
            (tmp_path / one).write_bytes((files / one).read_bytes())
        (tmp_path / "link.mp4").symlink_to(tmp_path / "in.mp4")
        for one in ("sky.hdr", "m_0001.png", "fog.exr"):
            (tmp_path / one).write_bytes(b"of somebody's")
        before = {path: path.read_bytes() for path in tmp_path.iterdir()}
        given = {
            "--env-map": ["--env", tmp_path / "sky.hdr"],
            "--holdout": ["--holdout", tmp_path / "m_%04d.png"],
            "--layers": ["--layers", tmp_path / "fog.exr"],
        }.get(what, [])
        written = [] if option is None else [option, tmp_path / name]
        plate, out = ("plate.png", name) if option is None else ("in.mp4", "out.mp4")
        run = nlens(
            tmp_path / plate, tmp_path / "anim.glb", tmp_path / out,
            "--fit", tmp_path / "fit.json", *given, *written,
        )  # fmt: skip
        assert f" {what} as well; give " in one_line(run, 6)
        assert {path: path.read_bytes() for path in tmp_path.iterdir()} == before

    def test_verbose_option_adds_the_traceback(self, files, tmp_path):
        run = nlens(tmp_path / "none.mp4", files / "anim.glb", tmp_path / "o.mp4", "-v")
        assert run.returncode == 3
        assert "Traceback" in run.stderr


def test_failed_run_leaves_no_file(files, tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "layers").mkdir()
    run = nlens(
        files / "in.mp4", files / "anim.glb", tmp_path / "out" / "o.mp4",
        "--layers", tmp_path / "layers" / "%04d.exr", "--timings", tmp_path / "out" / "t.json",
    )  # fmt: skip
    one_line(run, 3)
    assert not list((tmp_path / "out").iterdir())
