"""Colours of picture files: other readers show them alike, or a note says what they lack."""

import av
import numpy as np
import PIL.Image
import pytest
from support.clips import copy, write_clip

from nlens_video.video.exr import write_layers
from nlens_video.video.info import FrameTags
from nlens_video.video.input.source import open_source
from nlens_video.video.output.picture_files import EXTENSIONS

BT709 = FrameTags(colorspace=1, color_range=1, color_primaries=1, color_trc=1)
FULL = FrameTags(colorspace=1, color_range=2, color_primaries=1, color_trc=1)
PQ = FrameTags(colorspace=9, color_range=1, color_primaries=9, color_trc=16)
SRGB = FrameTags(colorspace=1, color_range=1, color_primaries=1, color_trc=13)
HLG = FrameTags(colorspace=9, color_range=1, color_primaries=9, color_trc=18)
LOST = "colour tags are left out"
COLOURS = ((255, 0, 0), (0, 255, 0), (0, 0, 255), (255, 255, 0), (0, 255, 255), (255, 0, 255))


def bars(pixel_format, tags=BT709):
    """A frame of saturated bars."""
    row = np.repeat(np.array((*COLOURS, (255, 255, 255), (90, 90, 90)), np.uint8), 16, 0)
    rgb = av.VideoFrame.from_ndarray(np.tile(row, (64, 1, 1)), "rgb24")
    if av.VideoFormat(pixel_format).is_rgb or "gray" in pixel_format:
        return rgb.reformat(format=pixel_format)
    frame = rgb.reformat(
        format=pixel_format, dst_colorspace=tags.colorspace, dst_color_range=tags.color_range
    )
    for name in FrameTags.__struct_fields__:
        setattr(frame, name, getattr(tags, name))
    return frame


def plate(folder, pixel_format, tags=BT709, count=1):
    name, codec = ("in.mov", "prores_ks") if pixel_format == "yuv422p10le" else ("in.mkv", "ffv1")
    return write_clip(folder / name, [bars(pixel_format, tags) for _ in range(count)], codec=codec)


def shown(path):
    """What Pillow shows in the middle of each bar, (8, 3)."""
    with PIL.Image.open(path) as picture:
        return np.asarray(picture.convert("RGB"), int)[32, 8::16]


def decoded_format(path):
    with av.open(str(path)) as source:
        return next(source.decode(video=0)).format.name


@pytest.mark.parametrize("ending", ["tif", "tiff", "webp"])
@pytest.mark.parametrize(
    ("pixel_format", "tags"),
    [
        ("yuv420p", BT709), ("yuv444p", BT709), ("yuv422p10le", BT709), ("yuv420p10le", BT709),
        ("yuva444p", BT709), ("yuv420p", FULL),
    ],
)  # fmt: skip
def test_pictures_that_hold_yuv_show_the_colours_of_png(tmp_path, pixel_format, tags, ending):
    clip = plate(tmp_path, pixel_format, tags, count=2)
    for name in ("png", ending):
        notes = copy(clip, tmp_path / f"p_%d.{name}")
    for number in (0, 1):
        ours, wanted = (shown(tmp_path / f"p_{number}.{name}") for name in (ending, "png"))
        assert np.abs(ours - wanted).max() <= 1
    assert not [note for note in notes if "range" in note or LOST in note]


@pytest.mark.parametrize("ending", ["tif", "webp"])
def test_single_picture_shows_the_colours_of_png(tmp_path, ending):
    clip = plate(tmp_path, "yuv420p")
    for name in ("png", ending):
        copy(clip, tmp_path / f"still.{name}", one_frame=True)
    ours, wanted = (shown(tmp_path / f"still.{name}") for name in (ending, "png"))
    assert np.abs(ours - wanted).max() <= 1


@pytest.mark.parametrize(
    ("ending", "pix_fmt"),
    [("tif", "yuv420p"), ("tif", "yuv444p"), ("webp", "yuv420p"), ("webp", "yuva420p")],
)
@pytest.mark.parametrize(
    ("pixel_format", "tags"), [("yuv420p", BT709), ("yuva444p", FULL), ("bgr0", BT709)]
)
def test_yuv_that_is_asked_for_has_the_matrix_that_readers_assume(
    tmp_path, pixel_format, tags, ending, pix_fmt
):
    clip = plate(tmp_path, pixel_format, tags)
    copy(clip, tmp_path / "p_%d.png")
    copy(clip, tmp_path / f"p_%d.{ending}", pix_fmt=pix_fmt)
    if ending == "tif":
        assert decoded_format(tmp_path / "p_0.tif") == pix_fmt
    ours, wanted = (shown(tmp_path / f"p_0.{name}") for name in (ending, "png"))
    assert np.abs(ours - wanted).max() <= 4


@pytest.mark.parametrize("ending", ["tif", "webp"])
def test_full_range_becomes_limited_with_a_note_in_yuv_that_is_asked_for(tmp_path, ending):
    notes = copy(plate(tmp_path, "yuv420p", FULL), tmp_path / f"p_%d.{ending}", pix_fmt="yuv420p")
    assert len([note for note in notes if note.startswith("full range becomes limited")]) == 1


def test_alpha_stays_in_webp_of_yuv_that_is_asked_for(tmp_path):
    clear = bars("yuva444p")
    clear.planes[3].update(bytes([100]) * clear.planes[3].buffer_size)
    clip = write_clip(tmp_path / "in.mkv", [clear])
    copy(clip, tmp_path / "p_%d.webp", pix_fmt="yuva420p")
    with PIL.Image.open(tmp_path / "p_0.webp") as picture:
        assert (np.asarray(picture)[..., 3] == 100).all()


def test_animated_webp_shows_the_colours_of_png(tmp_path):
    clip = plate(tmp_path, "yuv420p", count=2)
    notes = copy(clip, tmp_path / "out.webp")
    copy(clip, tmp_path / "p_%d.png")
    assert np.abs(shown(tmp_path / "out.webp") - shown(tmp_path / "p_0.png")).max() <= 12
    assert not [note for note in notes if LOST in note]


@pytest.mark.parametrize(
    ("pixel_format", "kept"),
    [
        ("yuv420p10le", "rgb48le"), ("yuva444p10le", "rgba64le"), ("yuv422p", "rgb24"),
        ("yuva420p", "rgba"), ("gray16le", "gray16le"), ("gray", "gray"),
    ],
)  # fmt: skip
def test_tiff_keeps_the_bits_and_the_alpha_of_a_plate(tmp_path, pixel_format, kept):
    clip = plate(tmp_path, pixel_format)
    notes = copy(clip, tmp_path / "p_%d.tif")
    assert decoded_format(tmp_path / "p_0.tif") == kept
    assert not [note for note in notes if "pixel format" in note]


@pytest.mark.parametrize("ending", [one for one in EXTENSIONS if one not in (".exr", ".pgm")])
@pytest.mark.parametrize(("tags", "curve"), [(PQ, "smpte2084"), (HLG, "arib-std-b67")])
def test_lost_colour_tags_of_hdr_are_told_of_pictures(tmp_path, tags, curve, ending):
    clip = plate(tmp_path, "yuv420p10le", tags)
    told = [] if ending == ".png" else [f"{LOST} (transfer {curve}, primaries bt2020): {ending}"]
    for name, words in ((f"p_%d{ending}", {}), (f"still{ending}", {"one_frame": True})):
        notes = [note for note in copy(clip, tmp_path / name, **words) if LOST in note]
        assert [note.partition(" does not hold")[0] for note in notes] == told


@pytest.mark.parametrize("ending", [one for one in EXTENSIONS if one != ".pgm"])
@pytest.mark.parametrize("tags", [BT709, FULL, FrameTags(), SRGB])
def test_usual_colour_tags_are_not_noted_of_pictures(tmp_path, tags, ending):
    clip = plate(tmp_path, "yuv420p", tags)
    assert not [note for note in copy(clip, tmp_path / f"p_%d{ending}") if "colour" in note]


def test_hdr_is_read_back_from_png(tmp_path):
    clip = plate(tmp_path, "yuv420p10le", PQ)
    copy(clip, tmp_path / "p_%d.png")
    with open_source(str(tmp_path / "p_%d.png")) as source:
        assert (source.info.tags.transfer, source.info.tags.primaries) == ("smpte2084", "bt2020")


@pytest.mark.parametrize("pix_fmt", ["yuv420p", "rgb48le"])
def test_lost_colour_tags_are_told_where_the_pixel_format_is_asked_for(tmp_path, pix_fmt):
    notes = copy(plate(tmp_path, "yuv420p10le", PQ), tmp_path / "p_%d.tif", pix_fmt=pix_fmt)
    assert len([note for note in notes if LOST in note and "matrix" not in note]) == 1


def test_no_colour_tags_are_told_of_light_that_becomes_srgb(tmp_path):
    light = np.full((48, 64), 0.2, np.float32)
    write_layers(tmp_path / "in_0.exr", dict.fromkeys("RGB", light))
    notes = copy(tmp_path / "in_%d.exr", tmp_path / "p_%d.jpg")
    assert not [note for note in notes if LOST in note]


@pytest.mark.parametrize("ending", ["tif", "webp"])
@pytest.mark.parametrize("name", ["p_%d", "still"])
def test_large_yuv_picture_is_read_as_other_readers_show_it(tmp_path, name, ending):
    """Video of this size without tags would be of BT.709."""
    frame = bars("yuv420p").reformat(width=1280, height=720)
    for tag in FrameTags.__struct_fields__:
        setattr(frame, tag, getattr(BT709, tag))
    clip, out = write_clip(tmp_path / "in.mkv", [frame]), tmp_path / f"{name}.{ending}"
    copy(clip, out, pix_fmt="yuv420p", one_frame=True)
    with PIL.Image.open(str(out).replace("%d", "0")) as picture:
        wanted = np.asarray(picture.convert("RGB"), int)[360, 80::160]
    copy(out, tmp_path / "again.mkv", codec="ffv1")
    for path in (out, tmp_path / "again.mkv"):
        with open_source(str(path), input_transfer="iec61966-2-1") as source:
            found = 255 * next(iter(source)).picture.srgb()[360, 80::160]
        assert np.abs(found - wanted).max() <= 4
