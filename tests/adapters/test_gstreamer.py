"""GStreamer's element in real pipelines: gst-inspect-1.0, gst-launch-1.0, and GStreamer's API."""

import json
import re
import subprocess
from fractions import Fraction

import numpy as np
import pytest
from support.conformance import (
    CASES,
    FRAMES,
    OPTIONS,
    RATE,
    Composited,
    assert_conforms,
    assert_same_errors,
    decoded,
    planes_of,
)
from support.folders import ROOT
from support.programs import made

pytestmark = [
    pytest.mark.slow,
    pytest.mark.needs_gl,
    pytest.mark.needs_programs("gst-launch-1.0"),
    pytest.mark.needs_gstreamer_python,
]
FORMS = {
    "yuv420p": ("I420", "bt709"),
    "yuv444p": ("Y444", "1:3:7:1"),
    "yuv422p10le": ("I422_10LE", "bt2100-pq"),
    "gbrp10le": ("GBR_10LE", "sRGB"),
    "bgr0": ("BGRx", "sRGB"),
}
"""GStreamer's format and colorimetry (range, matrix, transfer, primaries) of the plates."""
PLAYER = ROOT / "tests" / "support" / "gstreamer_player.py"


@pytest.fixture
def player(environment):
    """Runs `gstreamer_player.py`."""

    def run(what, properties, *more):
        line = " ".join(f"{name.replace('_', '-')}={value}" for name, value in properties.items())
        run = subprocess.run(
            ["python", PLAYER, what, line, *map(str, more)], env=environment, capture_output=True,
            text=True, check=False, timeout=120,
        )  # fmt: skip
        if run.returncode:
            raise RuntimeError(run.stderr)
        return json.loads(run.stdout)

    return run


@pytest.fixture
def play(player, plates):
    """Plays what `gstreamer_player.py` calls so."""
    plate = plates("bt709")
    given = {"glb": plate.glb, "fit": plate.fit, **OPTIONS}
    return lambda what, *more: player(what, given, *more)


@pytest.fixture
def adapter(player):
    def composite(plate, options):
        frames = plate.frames()
        form, colour = FORMS[plate.pixel_format]
        given, made = plate.folder / "in.raw", plate.folder / "out.raw"
        raw = b"".join(rows.tobytes() for frame in frames for rows in planes_of(frame))
        given.write_bytes(raw)
        caps = (
            f"video/x-raw,format={form},width=480,height=270,framerate={RATE}/1,"
            f"colorimetry={colour}"
        )
        told = player(
            "file", {"glb": plate.glb, **options}, caps, len(raw) // len(frames), given, made
        )
        if errors := [said for name, said in told["messages"] if name == "error"]:
            raise RuntimeError("\n".join(errors))
        for frame in told["frames"]:
            assert (frame["format"], frame["colorimetry"]) == (form, colour)
            assert frame["duration"] == 40_000_000
        times = [Fraction(frame["pts"], 10**9) for frame in told["frames"]]
        return Composited(_planes(plate, frames), times)

    return composite


def _planes(plate, frames):
    """Planes of the file that the pipeline wrote."""
    samples = np.fromfile(plate.folder / "out.raw", np.uint8)
    found, at = [], 0
    for frame in frames:
        found.append([])
        for rows in planes_of(frame):
            found[-1].append(samples[at : at + rows.nbytes].view(rows.dtype).reshape(rows.shape))
            at += rows.nbytes
    assert at == samples.size
    return found


@pytest.mark.parametrize("case", CASES)
def test_frames_times_and_colorimetry_are_those_of_the_command_line(
    case, adapter, plates, expected
):
    assert_conforms(adapter, plates(case), expected(case))


def test_errors_are_those_of_the_command_line(adapter, plates):
    assert_same_errors(adapter, plates("bt709"), RuntimeError, host_checks_names=True)


DOCUMENTED = re.findall(r"^gst-launch-1\.0 .*", (ROOT / "docs" / "gstreamer.md").read_text(), re.M)
STAND_INS = {
    "v4l2src": "videotestsrc num-buffers=8 ! video/x-raw,width=480,height=270",
    "autovideosink": "fakesink",
}


@pytest.mark.needs_programs("ffmpeg")
@pytest.mark.parametrize(
    "line", [line for line in DOCUMENTED if not re.search("rtsp|pipewire", line)]
)
def test_documented_line_runs_as_written(line, launch, plates):
    folder = plates("bt709").folder
    made(*f"-i {folder}/in.mkv -c:v libvpx -b:v 1M".split(), folder / "in.webm")
    for shown, stand_in in STAND_INS.items():
        line = line.replace(shown, stand_in)
    run = launch(line, folder)
    assert run.returncode == 0 and "Got EOS" in run.stdout, run.stderr
    assert "CRITICAL" not in run.stderr
    if "out.webm" in line:
        assert len(decoded(folder / "out.webm")) == FRAMES


@pytest.mark.needs_programs("ffmpeg")
def test_lens_is_fitted_on_the_stream_where_no_fit_is_given(launch, plates):
    folder = plates("bt709").folder
    raw = ("-c:v", "rawvideo", "-pix_fmt", "yuv420p")
    made("-i", folder / "in.mkv", *raw, folder / "in.avi")
    line = "filesrc location=in.avi ! avidemux ! nlens glb=anim.glb preset=draft ! fakesink"
    run = launch(f"gst-launch-1.0 {line}", folder)
    assert run.returncode == 0 and "Traceback" not in run.stderr, run.stderr


def test_missing_object_is_named(launch, tmp_path):
    run = launch("gst-launch-1.0 videotestsrc num-buffers=2 ! nlens ! fakesink", tmp_path)
    assert run.returncode != 0 and "no object was named; give glb=anim.glb" in run.stderr


def test_element_is_found_with_an_option_for_each_of_the_compositors(launch, tmp_path):
    run = launch("gst-inspect-1.0 nlens", tmp_path)
    assert run.returncode == 0 and not run.stderr, run.stderr
    properties = set(re.findall(r"^  ([a-z-]+) +: ", run.stdout, re.M))
    assert {"glb", "preset", "fit", "at", "shadow-strength", "track-focus", "qos"} <= properties
    today = {"env-map", "footprint-node", "ground-reflectance", "shutter-angle"}
    assert today <= properties and not {"env", "shutter", "shutter-deg"} & properties


def test_end_of_stream_comes_after_all_frames_with_plan_fit_and_timings(play):
    told = play("straight")
    assert [frame["pts"] for frame in told["frames"]] == [n * 40_000_000 for n in range(12)]
    assert {frame["duration"] for frame in told["frames"]} == {40_000_000}
    messages = dict(told["messages"])
    assert "eos" in messages and messages["nlens-timings"]["frames"] == 12
    assert messages["nlens-fit"]["slope"] == 24.0
    assert any("scatter" in line for line in messages["nlens-plan"])


def test_after_a_seek_the_animation_and_the_samples_are_those_of_that_time(play):
    straight = {one["pts"]: one["samples"] for one in play("straight")["frames"]}
    sought = play("seek")
    assert [frame["pts"] for frame in sought["later"]] == [320_000_000, 360_000_000, 400_000_000]
    for frame in (*sought["first"], *sought["later"], *sought["again"]):
        assert frame["samples"] == straight[frame["pts"]]


def test_another_size_is_negotiated_while_the_stream_runs(play):
    told = play("renegotiation")
    widths = [frame["width"] for frame in told["frames"]]
    assert len(widths) == 40 and set(widths) == {480, 320}
    assert [name for name, _ in told["messages"]].count("nlens-fit") == 2
    assert not [said for name, said in told["messages"] if name == "error"]


def test_a_last_row_without_padding_is_composited_as_one_with_it(play):
    whole, short = play("padded", "whole"), play("padded", "short")
    assert whole["came"] and whole["changed"], whole["messages"]
    assert short["came"] and short["samples"] == whole["samples"], short["messages"]


SQUARE = "video/x-raw,framerate=25/1,pixel-aspect-ratio=1/1"
WIDE = "video/x-raw,framerate=25/1,pixel-aspect-ratio=4/3"
UNRATED = "video/x-raw,framerate=0/1,pixel-aspect-ratio=1/1"


def samples_of(told):
    assert not [said for name, said in told["messages"] if name == "error"]
    return [frame["samples"] for frame in told["frames"]]


def test_another_shape_of_pixels_is_negotiated_while_the_stream_runs(play):
    both = samples_of(play("pushed", SQUARE, WIDE))
    assert both == [
        samples_of(play("pushed", form, form))[k] for k, form in enumerate((SQUARE, WIDE))
    ]
    assert samples_of(play("pushed", SQUARE, SQUARE))[1] != both[1]


def test_a_property_that_changes_holds_from_the_next_frame_on(play):
    change = "animation-offset=0.2"
    plain = samples_of(play("pushed", SQUARE, SQUARE))
    changed = samples_of(play("pushed", change, SQUARE, SQUARE))
    assert plain[1] != changed[1]
    assert samples_of(play("pushed", SQUARE, change, SQUARE)) == [plain[0], changed[1]]


def test_buffers_of_a_stream_without_a_rate_tell_how_long_a_frame_lasts(play):
    rated, unrated = (
        samples_of(play("pushed", "effects=defocus,motion-blur", form, form))
        for form in (SQUARE, UNRATED)
    )
    assert rated == unrated


def test_latency_is_that_of_the_source_and_of_a_frame_here(play):
    told = play("latency")
    for here, before in told["told"]:
        assert before >= 40.0  # a frame of the camera
        own = here - before
        timings = [said for name, said in told["messages"] if name == "nlens-timings"]
        assert any(own == pytest.approx(one["p95_ms"], abs=0.01) for one in timings)
    assert "latency" in dict(told["messages"])


def test_frames_that_come_too_late_are_left_out_and_said(play):
    told = play("late")
    assert len(told["frames"]) < 40
    assert "lens" in [said for name, said in told["messages"] if name == "qos"]


def test_frames_of_a_hosts_memory_are_not_kept(plates):
    from nlens_video.adapters import contract

    plate = plates("bt709")
    frame = plate.frames()[0]
    with contract.open(plate.glb, preset="draft", fit=plate.fit) as lens:
        contract.process(lens, contract.Frame(
            pixel_format="yuv420p", width=480, height=270, planes=tuple(planes_of(frame))
        ))  # fmt: skip
        assert "no frame yet" in lens.show()._repr_html_()
