"""Interlaced pictures stay interlaced, or are said to become whole frames."""

import re
import subprocess

import pytest
from support.clips import copy
from support.programs import made

from nlens_video.video.input.source import open_source

pytestmark = pytest.mark.needs_programs("ffmpeg", "ffprobe")
FIELDS = ("-vf", "interlace=scan={order},format=yuv422p10le", "-flags", "+ildct+ilme")


@pytest.fixture(params=["tff", "bff"])
def plate(request, tmp_path):
    words = [word.format(order=request.param) for word in FIELDS]
    pictures = ("-f", "lavfi", "-i", "testsrc2=s=720x576:r=50", "-frames:v", 6)
    return made(*pictures, *words, "-c:v", "prores_ks", tmp_path / "in.mov")


def fields(path):
    """Whether each frame is interlaced, and which field comes first, as ffprobe says."""
    command = ["ffprobe", "-v", "error", "-select_streams", "v", "-show_entries"]
    entries = ["frame=interlaced_frame,top_field_first", "-of", "csv=p=0", path]
    run = subprocess.run([*command, *entries], capture_output=True, text=True, check=True)
    return [line.strip(",").split(",")[:2] for line in run.stdout.split()]


@pytest.mark.parametrize(
    ("name", "codec"),
    [("out.mov", None), ("out.mkv", "ffv1"), ("out.mp4", "h264"), ("out.mpg", "mpeg2video"),
     ("out.avi", "mpeg4")],
)  # fmt: skip
def test_interlaced_pictures_keep_their_fields(plate, name, codec):
    notes = copy(plate, plate.with_name(name), codec=codec)
    assert fields(plate.with_name(name)) == fields(plate)
    assert fields(plate)[0][0] == "1"
    assert "interlaced" not in " ".join(notes)


def test_fields_stay_marked_where_samples_become_rgb(plate):
    copy(plate, plate.with_name("out.mkv"), codec="ffv1", pix_fmt="gbrp10le")
    assert fields(plate.with_name("out.mkv")) == fields(plate)


@pytest.mark.parametrize(
    ("name", "codec"), [("out.mov", "dnxhd"), ("out.mkv", "libx265"), ("out.nut", "rawvideo")]
)
def test_interlaced_pictures_that_become_whole_frames_are_noted(plate, name, codec):
    notes = copy(plate, plate.with_name(name), codec=codec, pix_fmt="yuv422p")
    said = f"interlaced pictures become whole frames: {codec} does not mark their fields"
    assert said in notes
    assert {interlaced for interlaced, _ in fields(plate.with_name(name))} == {"0"}


def field_order(path):
    """As ffprobe reads it from the header."""
    command = ["ffprobe", "-v", "error", "-select_streams", "v", "-show_entries"]
    entries = ["stream=field_order", "-of", "csv=p=0", path]
    return subprocess.run([*command, *entries], capture_output=True, text=True).stdout.split()[0]


@pytest.mark.parametrize(("name", "codec"), [("out.mov", None), ("out.mkv", "ffv1")])
def test_containers_state_the_field_order_of_the_plate(plate, name, codec):
    copy(plate, plate.with_name(name), codec=codec)
    assert field_order(plate.with_name(name)) == field_order(plate)


def test_h264_states_in_its_messages_which_field_is_shown_first(plate):
    out = plate.with_name("out.mp4")
    copy(plate, out, codec="h264")
    trace = ["ffmpeg", "-v", "verbose", "-i", out, "-c", "copy", "-bsf:v", "trace_headers"]
    run = subprocess.run([*trace, "-f", "null", "-"], capture_output=True, text=True, check=True)
    structures = set(re.findall(r"pic_struct .* = (\d+)", run.stderr))
    assert structures == {"3" if fields(plate)[0][1] == "1" else "4"}


def test_interlaced_frames_after_progressive_ones_are_noted(tmp_path):
    pictures = ("-f", "lavfi", "-i", "testsrc2=s=160x96:r=25", "-frames:v", 30, "-c:v", "libx264")
    whole = made(*pictures, tmp_path / "whole.ts")
    halves = made(*pictures, "-x264-params", "tff=1", tmp_path / "fields.ts")
    joined = tmp_path / "in.ts"
    joined.write_bytes(whole.read_bytes() + halves.read_bytes())
    with open_source(str(joined)) as source:
        assert len(list(source)) == 60
        noted = "30 frames from frame 30 on are interlaced, the first is not"
        assert any(note.startswith(noted) for note in source.warnings())
