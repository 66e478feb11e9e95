"""The shape of pixels that are not square: in the result, or told to be lost."""

import zlib
from fractions import Fraction

import av
import pytest
from support.clips import copy, planes
from support.programs import complaints, made, streams

from nlens_video.video.input.source import open_source
from nlens_video.video.matroska_aspect import write_display_size

SHAPE = Fraction(16, 11)
TRACKS = b"\x16\x54\xae\x6b"
LOST = "pixels of 16:11 become square"


def clip(folder, *words, pixel_format="yuv420p", size="176x144"):
    """A clip of FFV1 with sound, of pixels of 16:11."""
    return made(
        "-f", "lavfi", "-i", f"testsrc2=s={size}:r=25:d=0.4", "-f", "lavfi", "-i", "sine=d=0.4",
        "-vf", f"setsar=16/11,format={pixel_format}", "-c:v", "ffv1", "-c:a", "aac", *words,
        folder / "in.mkv",
    )  # fmt: skip


def shape(path):
    with open_source(str(path)) as source:
        return source.info.sample_aspect_ratio


@pytest.mark.parametrize(
    ("name", "codec"),
    [
        ("out.mkv", "ffv1"), ("out.mkv", "prores_ks"), ("out.mkv", "libx264"),
        ("out.mkv", "rawvideo"), ("out.webm", "libvpx-vp9"), ("out.webm", "libsvtav1"),
        ("out.mov", "prores_ks"), ("out.mp4", "libx264"),
    ],
)  # fmt: skip
def test_shape_of_pixels_is_kept(tmp_path, name, codec):
    out = tmp_path / name
    notes = copy(clip(tmp_path), out, codec=codec)
    assert shape(out) == SHAPE
    assert next(one for one in streams(out) if one["codec_type"] == "video")[
        "sample_aspect_ratio"
    ] == "16:11"  # fmt: skip
    assert not [note for note in notes if note.startswith(LOST)]
    assert complaints(out) == ""


@pytest.mark.parametrize(
    ("size", "name", "codec", "off"),
    [
        ("176x144", "out.mkv", "ffv1", 0), ("180x144", "out.mkv", "ffv1", 0),
        ("180x144", "out.mkv", "rawvideo", 0), ("720x576", "out.mkv", "prores_ks", 0),
        ("720x576", "out.webm", "libvpx-vp9", 0.5 / 1047), ("64x30", "out.mkv", "ffv1", 0.5 / 93),
    ],
)  # fmt: skip
def test_shape_is_exact_where_the_header_has_room(tmp_path, size, name, codec, off):
    copy(clip(tmp_path, size=size), tmp_path / name, codec=codec)
    assert float(shape(tmp_path / name)) == pytest.approx(float(SHAPE), rel=off, abs=1e-12)


@pytest.mark.parametrize("keep", [False, True])
def test_header_of_matroska_is_changed_in_place_and_all_else_stays(tmp_path, keep):
    plate, out = clip(tmp_path), tmp_path / "out.mkv"
    copy(plate, out, codec="ffv1", keep_partial=keep)
    with open_source(str(plate)) as source, open_source(str(out)) as result:
        for one, other in zip(source, result, strict=True):
            for was, has in zip(
                planes(one.picture.frame), planes(other.picture.frame), strict=True
            ):
                assert (was == has).all()
    with av.open(str(out)) as result:  # by the index at the end
        result.seek(300000)
        assert next(result.decode(video=0)).pts is not None
        assert result.streams.audio[0].codec.name == "aac"
    data = out.read_bytes()
    at = data.index(TRACKS, data.index(TRACKS) + 4) + 4  # the index at the beginning names them
    digits = 9 - data[at].bit_length()
    length = int.from_bytes(data[at : at + digits], "big") & ((1 << 7 * digits) - 1)
    tracks = data[at + digits : at + digits + length]
    assert tracks[:2] == b"\xbf\x84"
    assert zlib.crc32(tracks[6:]).to_bytes(4, "little") == tracks[2:6]


@pytest.mark.parametrize("data", [b"", b"no Matroska" * 20, b"\x1a\x45\xdf\xa3\x80" + bytes(40)])
def test_file_without_such_a_header_is_left_as_it_is(tmp_path, data):
    path = tmp_path / "a.mkv"
    path.write_bytes(data)
    assert not write_display_size(path, (64, 48), SHAPE)
    assert path.read_bytes() == data


def test_header_without_room_is_left_as_it_is(tmp_path):
    out = tmp_path / "out.mkv"
    copy(clip(tmp_path), out, codec="ffv1")
    before = out.read_bytes()
    assert not write_display_size(out, (1 << 200, 1), SHAPE)
    assert out.read_bytes() == before


@pytest.mark.parametrize("name", ["out.nut", "out.avi"])
def test_loss_of_the_shape_of_pixels_is_told(tmp_path, name):
    notes = copy(clip(tmp_path), tmp_path / name, codec="ffv1")
    assert [note for note in notes if note.startswith(LOST)]
    assert shape(tmp_path / name) is None


@pytest.mark.parametrize("ending", ["png", "jpg", "tif", "dpx", "pcx"])
def test_pictures_keep_the_shape_of_pixels(tmp_path, ending):
    notes = copy(clip(tmp_path), tmp_path / f"p_%d.{ending}")
    assert not [note for note in notes if note.startswith(LOST)]
    assert shape(tmp_path / f"p_%d.{ending}") == SHAPE


@pytest.mark.parametrize("ending", ["bmp", "exr", "webp"])
def test_loss_of_the_shape_of_pixels_in_pictures_is_told(tmp_path, ending):
    notes = copy(clip(tmp_path), tmp_path / f"p_%d.{ending}")
    assert f"{LOST}: .{ending} has no place for their shape" in notes


def test_nothing_is_told_of_square_pixels(tmp_path):
    plain = made("-i", clip(tmp_path), "-vf", "setsar=1", "-c:v", "ffv1", tmp_path / "plain.mkv")
    assert not [
        note for note in copy(plain, tmp_path / "out.avi", codec="ffv1") if "square" in note
    ]
