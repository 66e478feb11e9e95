"""Where chroma lies: read from the plate, kept in the result, and minded by the blend."""

import numpy as np
import pytest
from support.clips import copy, noise_frame, planes, write_clip
from support.programs import streams

from nlens_video.core.layers import Box
from nlens_video.video.input.source import open_source
from nlens_video.video.pixels.picture import AvPicture


def plate(folder, siting, codec="libx265", pixel_format="yuv420p10le", **words):
    options = {"chroma_sample_location": siting, "x265-params": "log-level=none"}
    if codec != "libx265":
        del options["x265-params"]
    frames = [noise_frame(64, 48, pixel_format, seed) for seed in range(3)]
    return write_clip(folder / "in.mkv", frames, codec=codec, options=options, **words)


def siting_of(path):
    with open_source(str(path)) as source:
        return source.info.chroma_siting


def told(path):
    """What the ffprobe program says."""
    return next(one for one in streams(path) if one["codec_type"] == "video")["chroma_location"]


@pytest.mark.parametrize("siting", ["topleft", "left", "center", "top"])
@pytest.mark.parametrize(("name", "codec"), [("out.mp4", None), ("out.mkv", "ffv1")])
def test_chroma_siting_is_kept(tmp_path, siting, name, codec):
    source = plate(tmp_path, siting)
    assert told(source) == siting_of(source) == siting
    assert copy(source, tmp_path / name, codec=codec) == ()
    assert siting_of(tmp_path / name) in ({siting} if siting != "left" else {"left", ""})


@pytest.mark.parametrize(
    ("siting", "mark"), [("topleft", b"420paldv"), ("left", b"420mpeg2"), ("center", b"420jpeg")]
)
def test_y4m_names_the_siting_of_the_plate(tmp_path, siting, mark):
    source = plate(tmp_path, siting, codec="libx264", pixel_format="yuv420p")
    copy(source, tmp_path / "out.y4m")
    header = (tmp_path / "out.y4m").read_bytes().split(b"\n")[0].split()
    assert b"C" + mark in header


def test_y4m_of_a_plate_that_does_not_tell_says_what_readers_assume(tmp_path):
    source = write_clip(tmp_path / "in.mkv", [noise_frame(64, 48, "yuv420p")] * 3)
    assert siting_of(source) == ""
    copy(source, tmp_path / "out.y4m")
    assert b"C420mpeg2" in (tmp_path / "out.y4m").read_bytes()[:100]


@pytest.mark.parametrize("siting", ["left", "topleft", "center"])
def test_siting_of_a_y4m_plate_is_read_and_kept(tmp_path, siting):
    source = plate(tmp_path, siting, codec="libx264", pixel_format="yuv420p")
    copy(source, tmp_path / "in.y4m")
    assert siting_of(tmp_path / "in.y4m") == siting
    copy(tmp_path / "in.y4m", tmp_path / "out.y4m")
    assert siting_of(tmp_path / "out.y4m") == siting


def test_jpeg_pictures_say_in_h264_that_their_chroma_is_centred(tmp_path):
    copy(plate(tmp_path, "left"), tmp_path / "p_%d.jpg")
    copy(tmp_path / "p_%d.jpg", tmp_path / "out.mp4")
    assert told(tmp_path / "out.mp4") == "center"


def test_siting_is_not_told_of_pictures_that_are_turned_upright(tmp_path):
    source = plate(tmp_path, "topleft", codec="libx264", pixel_format="yuv420p", rotation=90)
    copy(source, tmp_path / "out.ts")
    assert told(tmp_path / "out.ts") == "left"


def test_siting_is_not_told_where_chroma_is_interpolated_anew(tmp_path):
    copy(plate(tmp_path, "topleft"), tmp_path / "out.mkv", codec="ffv1", pix_fmt="yuv444p10le")
    assert siting_of(tmp_path / "out.mkv") == ""


@pytest.mark.parametrize(
    ("siting", "below", "right"),
    [("left", 1.0, 0.75), ("topleft", 0.75, 0.75), ("center", 1.0, 1.0), ("top", 0.75, 1.0)],
)
def test_layer_colours_chroma_by_how_much_of_its_luma_it_covers(siting, below, right):
    """Beside an upper and a left edge on even pixels; the codes have one slope: no transfer."""
    shares = []
    for box in (Box(0, 8, 16, 16), Box(8, 0, 16, 16)):
        frame = noise_frame(16, 16, "yuv420p")
        for plane in frame.planes:
            plane.update(bytes([128]) * plane.buffer_size)
        frame.colorspace, frame.color_trc = 1, 8
        rgba = np.zeros((box.height, box.width, 4), np.float32)
        rgba[..., 0], rgba[..., 3] = 0.5, 1.0
        AvPicture(frame, chroma_siting=siting).composite_over(box, rgba)
        chroma = planes(frame)[2].astype(float) - 128
        shares.append(chroma[4, 2] / chroma[7, 7] if box.y0 else chroma[2, 4] / chroma[7, 7])
    assert shares == pytest.approx([below, right], abs=0.03)
