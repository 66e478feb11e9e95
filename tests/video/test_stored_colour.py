"""Colour of results: a reader takes them for the plate's, or is told what is lost."""

import av
import numpy as np
import pytest
from support.clips import copy, noise_frame, planes, write_clip

from nlens_video.video.info import FrameTags
from nlens_video.video.input.source import open_source
from nlens_video.video.output.containers import read_tags

LIMITED = "full range becomes limited"
LOST = "colour tags are left out"
PQ = FrameTags(colorspace=9, color_range=1, color_primaries=9, color_trc=16)


def patches(pixel_format="yuv420p"):
    """A frame of sixteen patches from black to white, some of them coloured."""
    frame = av.VideoFrame(256, 128, pixel_format)
    levels = np.linspace(0, 255, 16)
    chroma = 128 + 60 * np.sin(np.arange(16))
    chroma[:4] = chroma[-4:] = 128  # what is nearly black or white has no room for colour
    for plane, values in zip(frame.planes, (levels, chroma, 256 - chroma), strict=True):
        rows = np.zeros((plane.height, plane.line_size), np.uint8)
        row = np.repeat(values, plane.width // 16)
        rows[:, : plane.width] = np.rint(row)
        plane.update(rows.tobytes())
    for name, value in {
        "color_range": 2,
        "colorspace": 6,
        "color_primaries": 1,
        "color_trc": 1,
    }.items():
        setattr(frame, name, value)
    return frame


def seen(path):
    """What a reader sees of the first frame, apart from the borders of the patches."""
    with open_source(str(path), input_transfer="bt709") as source:  # pictures are taken for sRGB
        shown = next(iter(source)).picture.srgb()
    return shown[8::16, 8::16]


def full_range_plate(folder, **words):
    return write_clip(folder / "in.mkv", [patches() for _ in range(3)], **words)


@pytest.mark.parametrize(
    ("name", "codec"),
    [
        ("out.mov", "prores_ks"), ("out.mxf", "prores_ks"), ("out.mov", "v210"),
        ("out.mov", "cfhd"), ("out.mpg", "mpeg2video"),
        ("out.avi", "huffyuv"), ("out.avi", "utvideo"), ("out.avi", "ffv1"), ("out.nut", "ffv1"),
        ("out.nut", "rawvideo"), ("out.avi", "mpeg4"),
    ],
)  # fmt: skip
def test_full_range_becomes_limited_where_readers_take_it_for_limited(tmp_path, name, codec):
    plate = full_range_plate(tmp_path)
    notes = copy(plate, tmp_path / name, codec=codec)
    assert len([note for note in notes if note.startswith(LIMITED)]) == 1
    with open_source(str(tmp_path / name)) as source:
        assert not source.info.tags.full_range
    np.testing.assert_allclose(seen(tmp_path / name), seen(plate), atol=0.03)


@pytest.mark.parametrize(
    ("name", "codec"),
    [
        ("out.mp4", "libx264"), ("out.mkv", "libx265"), ("out.webm", "libvpx-vp9"),
        ("out.mxf", "jpeg2000"), ("out.mp4", "mpeg4"), ("out.avi", "mjpeg"),
    ],
)  # fmt: skip
def test_full_range_stays_where_it_is_read_as_such(tmp_path, name, codec):
    plate = full_range_plate(tmp_path)
    notes = copy(plate, tmp_path / name, codec=codec)
    assert not [note for note in notes if note.startswith(LIMITED)]
    with open_source(str(tmp_path / name)) as source:
        assert source.info.tags.full_range
    np.testing.assert_allclose(seen(tmp_path / name), seen(plate), atol=0.03)


def test_full_range_samples_keep_their_bits_in_ffv1_in_matroska(tmp_path):
    plate, out = full_range_plate(tmp_path), tmp_path / "out.mkv"
    assert copy(plate, out, codec="ffv1") == ()
    with open_source(str(plate)) as source, open_source(str(out)) as result:
        for one, other in zip(source, result, strict=True):
            for was, has in zip(
                planes(one.picture.frame), planes(other.picture.frame), strict=True
            ):
                assert (was == has).all()


def test_jpeg_pictures_become_limited_in_prores(tmp_path):
    copy(full_range_plate(tmp_path), tmp_path / "p_%d.jpg")
    notes = copy(tmp_path / "p_%d.jpg", tmp_path / "out.mov", codec="prores_ks")
    assert [note for note in notes if note.startswith(LIMITED)]
    np.testing.assert_allclose(seen(tmp_path / "out.mov"), seen(tmp_path / "p_%d.jpg"), atol=0.03)


def test_rotated_full_range_becomes_limited_where_it_is_turned_upright(tmp_path):
    plate = full_range_plate(tmp_path, rotation=90)
    notes = copy(plate, tmp_path / "out.avi", codec="ffv1")
    assert [note for note in notes if note.startswith(LIMITED)]
    with open_source(str(plate)) as source, open_source(str(tmp_path / "out.avi")) as result:
        was, has = (next(iter(one)).picture.srgb() for one in (source, result))
    np.testing.assert_allclose(has[8::16, 8::16], was[8::16, 8::16], atol=0.03)


@pytest.mark.parametrize("name", ["out.avi", "out.nut"])
def test_loss_of_the_colour_tags_of_hdr_is_told(tmp_path, name):
    plate = write_clip(tmp_path / "in.mkv", [tagged(PQ, "yuv420p10le")])
    (note,) = copy(plate, tmp_path / name, codec="ffv1")
    assert note.startswith(f"{LOST} (matrix bt2020nc, transfer smpte2084, primaries bt2020)")
    assert ".mkv" in note


@pytest.mark.parametrize(
    ("name", "codec"), [("out.mkv", "ffv1"), ("out.mov", "prores_ks"), ("out.mp4", "libx265")]
)
def test_colour_tags_of_hdr_that_are_kept_are_not_noted(tmp_path, name, codec):
    plate = write_clip(tmp_path / "in.mkv", [tagged(PQ, "yuv422p10le")])
    notes = copy(plate, tmp_path / name, codec=codec)
    assert not [note for note in notes if note.startswith(LOST)]
    with open_source(str(tmp_path / name)) as source:
        assert source.info.frame_tags == PQ


@pytest.mark.parametrize(("primaries", "curve"), [(1, 1), (9, 16), (9, 18), (12, 1), (1, 13)])
def test_rgb_that_becomes_yuv_keeps_the_meaning_of_its_codes(tmp_path, primaries, curve):
    codes = np.linspace(100, 900, 3 * 16 * 12).reshape(16, 12, 3).repeat(8, 0).repeat(8, 1)
    frame = av.VideoFrame.from_ndarray((codes / 1023 * 65535).astype(np.uint16), "rgb48le")
    frame = frame.reformat(format="gbrp10le")
    tags = FrameTags(colorspace=0, color_range=2, color_primaries=primaries, color_trc=curve)
    for name in FrameTags.__struct_fields__:
        setattr(frame, name, getattr(tags, name))
    plate, out = write_clip(tmp_path / "in.mkv", [frame]), tmp_path / "out.mkv"
    assert copy(plate, out, codec="ffv1", pix_fmt="yuv444p10le") == ()
    with open_source(str(plate)) as source, open_source(str(out)) as result:
        assert result.info.tags.transfer == source.info.tags.transfer
        assert result.info.tags.primaries == source.info.tags.primaries
        assert result.info.tags.matrix == ("bt2020nc" if primaries == 9 else "bt709")
        was, has = (next(iter(one)).picture.srgb() for one in (source, result))
    np.testing.assert_allclose(has, was, atol=0.02)  # PQ is steep


def test_tags_that_readers_assume_are_not_noted_where_they_are_left_out(tmp_path):
    usual = FrameTags(colorspace=6, color_range=1, color_primaries=1, color_trc=1)
    plate = write_clip(tmp_path / "in.mkv", [tagged(usual, "yuv420p")])
    assert copy(plate, tmp_path / "out.avi", codec="ffv1") == ()


def test_usual_pairs_need_no_trial():
    """A trial of a pixel format that does not exist would find nothing."""
    assert read_tags("mp4", "libx264", "none", PQ) == PQ
    assert read_tags("nut", "rawvideo", "none", PQ) == FrameTags()
    assert read_tags("matroska", "ffv1", "none", PQ) == FrameTags()


def tagged(tags, pixel_format):
    frame = noise_frame(64, 48, pixel_format)
    for name in FrameTags.__struct_fields__:
        setattr(frame, name, getattr(tags, name))
    return frame
