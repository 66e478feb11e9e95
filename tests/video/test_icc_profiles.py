"""ICC profiles of pictures: known colours are followed, others are noted, results keep them."""

import struct

import av
import cv2
import numpy as np
import PIL.Image
import pytest
from support.clips import copy
from support.icc_profiles import ADOBE_RGB, BT2020, parametric, profile, sampled

from nlens_video.core.layers import Box
from nlens_video.video.info import FrameTags
from nlens_video.video.input.source import open_source
from nlens_video.video.output.sink import open_sink
from nlens_video.video.stills.icc import profile_colour

NOT_FOLLOWED, LEFT_OUT = "is not followed", "left out"
P3 = (12, 13)
TIFF_PROFILE = 34675
RED_IN_P3 = (234, 51, 35)
EXACT = {"jpg": {"quality": 98, "subsampling": 0}, "webp": {"lossless": True}}


def plate(path, icc=None, **options):
    colour = np.full((48, 64, 3), (150, 120, 100), np.uint8)
    options = EXACT.get(path.suffix[1:], {}) | options
    PIL.Image.fromarray(colour).save(path, icc_profile=icc or profile(), **options)
    return path


def red_square(spec, target, **options):
    """Copy a plate with pure red of BT.709 on its middle; gives the notes of source and sink."""
    red = np.zeros((24, 24, 4), np.float32)
    red[...] = (1, 0, 0, 1)
    with open_source(str(spec)) as source, open_sink(str(target), source.info, **options) as sink:
        for frame in source:
            frame.picture.composite_over(Box(12, 12, 36, 36), red)
            sink.write(frame)
        sink.commit()
        return [*source.info.notes, *sink.notes]


def middle(path):
    with PIL.Image.open(path) as picture:
        return np.asarray(picture.convert("RGB"), int)[24, 24]


def kept(path):
    with PIL.Image.open(path) as picture:
        return picture.info.get("icc_profile")


@pytest.mark.parametrize("ending", ["jpg", "png", "tif", "webp"])
def test_light_is_in_the_colours_of_the_profile(tmp_path, ending):
    """Pure red of BT.709 is (234, 51, 35) in Display P3, by the colours' own chromaticities."""
    out = tmp_path / f"out.{ending}"
    notes = red_square(plate(tmp_path / f"in.{ending}"), out, one_frame=True)
    assert np.abs(middle(out) - RED_IN_P3).max() <= (3 if ending == "jpg" else 1)
    keeps = ending in ("jpg", "png")
    assert (kept(out) == profile()) == keeps
    assert any("primaries smpte432" in note for note in notes) != keeps


def test_numbered_pictures_follow_the_profile_of_the_first(tmp_path):
    for number in (1, 2):
        plate(tmp_path / f"in_{number}.png")
    notes = red_square(tmp_path / "in_%d.png", tmp_path / "out_%d.png")
    assert not [note for note in notes if LEFT_OUT in note]
    for number in (1, 2):
        assert np.abs(middle(tmp_path / f"out_{number}.png") - RED_IN_P3).max() <= 1


def test_deep_tiff_follows_its_profile(tmp_path):
    """Pillow writes no TIFF of 16 bits a colour: OpenCV's gets a new table with the profile."""
    cv2.imwrite(str(tmp_path / "in.tif"), np.full((48, 64, 3), 30000, np.uint16))
    data, icc = (tmp_path / "in.tif").read_bytes(), profile()
    (start,) = struct.unpack_from("<I", data, 4)
    (count,) = struct.unpack_from("<H", data, start)
    table = struct.pack("<H", count + 1) + data[start + 2 : start + 2 + 12 * count]
    end = len(data) + len(table) + 12 + 4
    table += struct.pack("<HHIII", TIFF_PROFILE, 7, len(icc), end, 0)
    made = data[:4] + struct.pack("<I", len(data)) + data[8:] + table + icc
    (tmp_path / "in.tif").write_bytes(made)
    with open_source(str(tmp_path / "in.tif")) as source:
        assert source.info.tags.primaries == "smpte432"
        assert source.info.icc_profile == icc


@pytest.mark.parametrize("ending", ["jpg", "png"])
def test_photograph_that_is_turned_keeps_its_colours(tmp_path, ending):
    exif = PIL.Image.Exif()
    exif[274] = 6
    notes = red_square(
        plate(tmp_path / "in.jpg", exif=exif), tmp_path / f"out.{ending}", one_frame=True
    )
    assert not [note for note in notes if LEFT_OUT in note]
    if ending == "jpg":
        assert kept(tmp_path / "out.jpg") == profile()
    with open_source(str(tmp_path / f"out.{ending}")) as source:
        assert source.info.tags.primaries == "smpte432"
        assert (source.info.width, source.info.height) == (48, 64)


@pytest.mark.parametrize("ending", ["png", "jpg", "tif"])
def test_profile_of_other_colours_is_noted_once_and_kept_where_it_can_be(tmp_path, ending):
    icc, out = profile(ADOBE_RGB, parametric(2.19921875)), tmp_path / f"out.{ending}"
    notes = red_square(plate(tmp_path / "in.png", icc), out, one_frame=True)
    assert len([note for note in notes if NOT_FOLLOWED in note]) == 1
    lost = [note for note in notes if "ICC profile is left out" in note]
    assert (kept(out) == icc, len(lost)) == ((False, 1) if ending == "tif" else (True, 0))


def test_damaged_profile_is_noted(tmp_path):
    notes = red_square(plate(tmp_path / "in.jpg", b"no profile" * 50), tmp_path / "out.jpg")
    assert len([note for note in notes if NOT_FOLLOWED in note]) == 1


def test_profile_of_a_picture_becomes_tags_of_a_video(tmp_path):
    for number in (1, 2):
        plate(tmp_path / f"in_{number}.png")
    for name in ("out.mkv", "out.mp4"):
        copy(tmp_path / "in_%d.png", tmp_path / name, codec="libx264", pix_fmt="yuv420p")
        with av.open(str(tmp_path / name)) as made:
            tags = FrameTags.of(next(made.decode(video=0)))
            assert (tags.color_primaries, tags.color_trc) == P3


CODES = np.linspace(0, 1, 1024)
SRGB_LIGHT = np.where(CODES <= 0.04045, CODES / 12.92, ((CODES + 0.055) / 1.055) ** 2.4)


@pytest.mark.parametrize(
    ("icc", "found"),
    [
        (profile(), P3),
        (profile(BT2020), (9, 13)),
        (profile(curve=sampled(SRGB_LIGHT)), P3),
        (profile(curve=sampled([])), (12, 8)),
        (profile(curve=parametric(2.2)), (12, 4)),
        (profile(curve=parametric(1.8)), None),
        (profile(ADOBE_RGB), None),
        (profile(curve=parametric(2.2), space=b"GRAY"), (1, 4)),
        (profile(space=b"CMYK"), None),
        (profile()[:300], None),
        (b"", None),
    ],
)
def test_profile_is_compared_with_known_primaries_and_transfer_functions(icc, found):
    assert profile_colour(icc) == found


def test_profile_of_many_segments_is_put_together(tmp_path):
    """Profiles are longer than a segment of JPEG: they come in parts."""
    icc = profile() + bytes(200_000)
    with open_source(str(plate(tmp_path / "in.jpg", icc))) as source:
        assert source.info.icc_profile == icc
        assert source.info.tags.primaries == "smpte432"
