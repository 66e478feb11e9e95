"""Interlaced pictures stay interlaced, or are said to become whole frames."""

import subprocess

import pytest
from support.clips import copy
from support.programs import made

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


@pytest.mark.parametrize(
    ("name", "codec"), [("out.mov", "dnxhd"), ("out.mkv", "libx265"), ("out.nut", "rawvideo")]
)
def test_interlaced_pictures_that_become_whole_frames_are_noted(plate, name, codec):
    notes = copy(plate, plate.with_name(name), codec=codec, pix_fmt="yuv422p")
    said = f"interlaced pictures become whole frames: {codec} does not mark their fields"
    assert said in notes
    assert {interlaced for interlaced, _ in fields(plate.with_name(name))} == {"0"}
