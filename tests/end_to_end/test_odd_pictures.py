"""Odd frame sizes, rates and pixel formats: the result is readable by ffmpeg."""

from fractions import Fraction

import av
import pytest
from support.clips import copy
from support.programs import codecs, complaints, made, streams

from nlens_video.core.errors import OutputError

pytestmark = pytest.mark.needs_programs("ffmpeg", "ffprobe")


def clip(path, codec, pixel_format, *words, size="64x48", rate="25"):
    source = f"testsrc=s={size}:r={rate}"
    return made(
        "-f", "lavfi", "-i", source, "-frames:v", 6, *words, "-c:v", codec, "-pix_fmt",
        pixel_format, path,
    )  # fmt: skip


def count(path):
    with av.open(str(path)) as source:
        return sum(1 for _ in source.decode(video=0))


@pytest.mark.parametrize("size", ["63x47", "64x49"])
@pytest.mark.parametrize(
    ("codec", "pixel_format"),
    [
        ("libx264", "yuv444p"), ("libx265", "yuv444p"), ("libvpx-vp9", "yuv420p"),
        ("mpeg2video", "yuv420p"), ("mpeg4", "yuv420p"), ("mjpeg", "yuvj420p"), ("ffv1", "yuv420p"),
    ],
)  # fmt: skip
def test_odd_sizes_keep_codec_and_size(codec, pixel_format, size, tmp_path):
    plate = clip(tmp_path / "in.mkv", codec, pixel_format, size=size)
    copy(plate, tmp_path / "out.mp4")
    assert codecs(tmp_path / "out.mp4") == codecs(plate)
    found = streams(tmp_path / "out.mp4")[0]
    assert f"{found['width']}x{found['height']}" == size
    assert complaints(tmp_path / "out.mp4") == ""


@pytest.mark.parametrize("codec", ["libx264", "libx265"])
def test_odd_sizes_use_full_chroma_for_encoders_that_need_even_sizes(codec, tmp_path):
    plate = clip(tmp_path / "in.mkv", "ffv1", "yuv420p", size="63x47")
    notes = " ".join(copy(plate, tmp_path / "out.mp4", codec=codec))
    assert f"pixel format yuv444p instead of yuv420p: nearest that {codec} takes" in notes
    assert complaints(tmp_path / "out.mp4") == ""


@pytest.mark.parametrize("ending", ["mov", "mkv", "avi"])
@pytest.mark.parametrize("pixel_format", ["nv12", "uyvy422", "bgr24"])
def test_raw_video_stays_raw_only_in_widely_readable_pixel_formats(pixel_format, ending, tmp_path):
    plate = clip(tmp_path / "in.nut", "rawvideo", pixel_format)
    out = tmp_path / f"out.{ending}"
    notes = " ".join(copy(plate, out))
    assert complaints(out) == ""
    found = streams(out)[0]
    if found["codec_name"] == "rawvideo":
        worked = {"nv12": "yuv420p", "uyvy422": "yuv422p"}.get(pixel_format, pixel_format)
        assert found["pix_fmt"] == worked
    else:
        assert "instead of the source's rawvideo" in notes


@pytest.mark.parametrize("ending", ["mkv", "mp4"])
@pytest.mark.parametrize("rate", ["30000/1001", "12"])
def test_avi_output_keeps_the_frame_rate(rate, ending, tmp_path):
    plate = clip(tmp_path / f"in.{ending}", "libx264", "yuv420p", rate=rate)
    copy(plate, tmp_path / "out.avi")
    found = streams(tmp_path / "out.avi")[0]
    assert (Fraction(found["r_frame_rate"]), found["nb_frames"]) == (
        pytest.approx(Fraction(rate)),
        "6",
    )
    assert count(tmp_path / "out.avi") == 6


@pytest.mark.parametrize("ending", ["mpg", "mxf"])
def test_frame_rate_unsupported_by_the_container_is_refused_before_writing(ending, tmp_path):
    plate = clip(tmp_path / "in.mkv", "libx264", "yuv420p", rate="15")
    with pytest.raises(OutputError, match="at 15 frames per second"):
        copy(plate, tmp_path / f"out.{ending}")


def test_mpeg2_at_an_unsupported_rate_suggests_another_codec(tmp_path):
    plate = clip(tmp_path / "in.mov", "mpeg2video", "yuv420p", "-strict", "-2", rate="15")
    notes = " ".join(copy(plate, tmp_path / "out.mov"))
    assert "mpeg2video instead of the source's mpeg2video" not in notes
    assert "instead of the source's mpeg2video: its encoder refuses such pictures" in notes
