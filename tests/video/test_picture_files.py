"""Pictures and sequences of every kind: the right file format, and the picture read back."""

from fractions import Fraction

import av
import cv2
import numpy as np
import pytest
from support.clips import copy, noise_frame, write_clip

from nlens_video.core.errors import OutputError
from nlens_video.core.layers import Box
from nlens_video.video.exr import read_exr, write_layers
from nlens_video.video.input.source import open_source
from nlens_video.video.output.picture_files import EXTENSIONS
from nlens_video.video.output.sink import check_output

MAGIC = {
    ".bmp": b"BM", ".dpx": b"XPDS", ".exr": b"\x76\x2f\x31\x01", ".j2k": b"\0\0\0\x0cjP",
    ".jls": b"\xff\xd8\xff\xf7", ".jp2": b"\0\0\0\x0cjP", ".jpeg": b"\xff\xd8\xff",
    ".jpg": b"\xff\xd8\xff", ".pam": b"P7", ".pcx": b"\x0a\x05", ".pgm": b"P5",
    ".png": b"\x89PNG", ".ppm": b"P6", ".qoi": b"qoif", ".ras": b"\x59\xa6\x6a\x95",
    ".sgi": b"\x01\xda", ".sun": b"\x59\xa6\x6a\x95", ".tga": b"\0\0\2", ".tif": b"II*\0",
    ".tiff": b"II*\0", ".webp": b"RIFF", ".xwd": b"\0\0\0\x6f\0\0\0\7",
}  # fmt: skip
LOSSY = (".jpg", ".jpeg", ".exr")
"""JPEG, and the one that holds linear light."""


def read(path, pixel_format):
    with av.open(str(path)) as source:
        return next(source.decode(video=0)).reformat(format=pixel_format).to_ndarray()


def smooth_frame(pixel_format, shift=0):
    """Smooth waves over the codes of 16 bits, which no two files of a sequence have alike."""
    y, x = np.mgrid[:48, :64]
    waves = [np.sin(x / 9 + k + shift) * np.cos(y / 7 + k) for k in range(3)]
    codes = np.round(32768 + 20000 * np.stack(waves, -1)).astype(np.uint16)
    return av.VideoFrame.from_ndarray(codes, "rgb48le").reformat(format=pixel_format)


def clip_of(folder, pixel_format, count=2):
    made = [smooth_frame(pixel_format, shift) for shift in range(count)]
    return write_clip(folder / "in.mkv", made)


def test_every_kind_of_picture_has_its_test():
    assert set(MAGIC) == set(EXTENSIONS)


@pytest.mark.parametrize("ending", EXTENSIONS)
@pytest.mark.parametrize("name", ["still", "p_%03d"])
def test_picture_is_of_the_kind_that_its_name_says_and_reads_back(tmp_path, name, ending):
    grey = ending == ".pgm"
    clip = clip_of(tmp_path, "gray" if grey else "bgr0")
    if name == "still":
        copy(clip, tmp_path / "f_%d.png")
        copy(tmp_path / "f_0.png", tmp_path / f"still{ending}")
    else:
        copy(clip, tmp_path / f"{name}{ending}")
    files = sorted(path for path in tmp_path.glob(f"*{ending}") if path.stem[0] != "f")
    assert [path.stem for path in files] == (["still"] if name == "still" else ["p_000", "p_001"])
    for shift, path in enumerate(files):
        assert path.read_bytes().startswith(MAGIC[ending])
        if ending == ".exr":
            continue  # its values have tests of their own
        as_ = "gray" if grey else "rgb24"
        was = smooth_frame("gray" if grey else "bgr0", shift).reformat(format=as_).to_ndarray()
        off = np.abs(read(path, as_).astype(int) - was.astype(int))
        assert off.max() <= (24 if ending in LOSSY else 0), path


@pytest.mark.parametrize(
    ("ending", "source", "kept"),
    [
        (".dpx", "gbrp10le", "gbrp10le"), (".dpx", "gbrp12le", "gbrp12le"),
        (".dpx", "gbrp16le", "rgb48le"), (".dpx", "gray16le", "gray16le"),
        (".ppm", "gbrp16le", "rgb48le"), (".pgm", "gray16le", "gray16le"),
        (".pam", "rgba64le", "rgba64le"), (".sgi", "gbrp16le", "gbrp16be"),
        (".tga", "bgra", "bgra"), (".qoi", "bgra", "rgba"), (".jp2", "gray16le", "gray16le"),
    ],
)  # fmt: skip
def test_samples_of_a_deep_or_transparent_plate_are_kept(tmp_path, ending, source, kept):
    clip = write_clip(tmp_path / "in.nut", [noise_frame(64, 48, source)])
    copy(clip, tmp_path / f"p_%d{ending}")
    with av.open(str(tmp_path / f"p_0{ending}")) as made, av.open(str(clip)) as plate:
        picture, first = next(made.decode(video=0)), next(plate.decode(video=0))
    assert picture.format.name == kept
    alpha = any(one.is_alpha for one in picture.format.components)
    like = "gray16le" if "gray" in kept else "rgba64le" if alpha else "rgb48le"
    one, other = (frame.reformat(format=like).to_ndarray() for frame in (picture, first))
    np.testing.assert_array_equal(one, other)


def test_deep_dpx_plate_becomes_deep_dpx(tmp_path):
    clip = write_clip(tmp_path / "in.mkv", [noise_frame(64, 48, "yuv422p10le", s) for s in (0, 1)])
    copy(clip, tmp_path / "a_%02d.dpx")
    assert copy(tmp_path / "a_%02d.dpx", tmp_path / "b_%02d.dpx") == ()
    for number in (0, 1):
        one, other = (read(tmp_path / f"{name}_{number:02}.dpx", "gbrp10le") for name in "ab")
        np.testing.assert_array_equal(one, other)


def test_deep_jpeg_2000_is_off_by_less_than_an_8_bit_step(tmp_path):
    clip = clip_of(tmp_path, "gbrp16le")
    copy(clip, tmp_path / "p_%d.jp2")
    was = smooth_frame("gbrp16le").reformat(format="rgb48le").to_ndarray()
    off = np.abs(read(tmp_path / "p_0.jp2", "rgb48le").astype(int) - was.astype(int))
    assert off.max() < 32


@pytest.mark.parametrize("ending", ["jp2", "tga", "dpx"])
def test_picture_of_a_yuv_plate_shows_its_colours(tmp_path, ending):
    """JPEG 2000 of limited-range YUV is shown pale by readers that know of full range alone."""
    grey = np.full((48, 64, 3), 235, np.uint8)
    frame = av.VideoFrame.from_ndarray(grey, "rgb24").reformat(
        format="yuv420p", dst_colorspace="ITU709", dst_color_range="MPEG"
    )
    frame.colorspace, frame.color_range = 1, 1
    clip = write_clip(tmp_path / "in.mkv", [frame])
    copy(clip, tmp_path / f"p_%d.{ending}")
    with av.open(str(tmp_path / f"p_0.{ending}")) as made:
        picture = next(made.decode(video=0))
    assert picture.format.is_rgb
    assert np.abs(picture.to_ndarray(format="rgb24").astype(int) - 235).max() <= 1


@pytest.mark.parametrize(
    "name", ["o.jxl", "o_%04d.jxl", "o.hdr", "o.pbm", "o_%04d.y", "o_%04d.avif", "http://a/o.png"]
)
def test_kind_of_picture_that_is_not_written_is_refused_with_those_that_are(tmp_path, name):
    clip = write_clip(tmp_path / "in.mkv", [noise_frame(64, 48, "yuv420p")])
    spec = name if "://" in name else str(tmp_path / name)
    with pytest.raises(OutputError, match=r"end in \.bmp, \.dpx, .*; give one of these") as caught:
        copy(clip, spec)
    assert "\n" not in str(caught.value)
    if "://" not in name:
        with pytest.raises(OutputError, match=r"end in \.bmp"):
            check_output(spec)
    assert [path.name for path in tmp_path.iterdir()] == ["in.mkv"]


def test_colour_in_a_grey_kind_of_picture_is_refused(tmp_path):
    clip = write_clip(tmp_path / "in.mkv", [noise_frame(64, 48, "yuv420p")])
    with pytest.raises(OutputError, match=r"\.pgm: holds grey pictures only.*give \.ppm"):
        copy(clip, tmp_path / "p_%d.pgm")


def test_picture_of_phone_footage_is_upright(tmp_path):
    made = [smooth_frame("yuv420p")]
    clip = write_clip(
        tmp_path / "in.mp4", made, codec="libx264", rotation=90, time_base=Fraction(1, 1000)
    )  # fmt: skip
    copy(clip, tmp_path / "p_%d.tga")
    assert read(tmp_path / "p_0.tga", "rgb24").shape == (64, 48, 3)


@pytest.mark.parametrize(
    ("plate", "name", "lost"),
    [
        ("yuv420p", "p_%d.png", None), ("yuv420p", "p_%d.jpg", None), ("nv12", "p_%d.dpx", None),
        ("yuv420p10le", "p_%d.png", None), ("yuv422p", "p_%d.tif", None), ("gray", "out.mp4", None),
        ("yuv420p10le", "p_%d.jpg", "8 bits for 10"),
        ("yuva444p10le", "p_%d.jpg", "8 bits for 10; alpha is left out"),
        ("yuv444p", "out.webm", None), ("yuv420p", "out.mov", None),
        ("rgb24", "out.mp4", "chroma in 4:2:0"),
        ("rgba64le", "out.mp4", "chroma in 4:2:0; 10 bits for 16; "
         "alpha is left out"),
        ("yuv422p", "out.avi", "chroma in 4:2:0"), ("gbrpf32le", "p_%d.png", "16 bits for float"),
    ],
)  # fmt: skip
def test_pixel_format_is_noted_where_pictures_lose_by_it(tmp_path, plate, name, lost):
    clip = write_clip(tmp_path / "in.nut", [smooth_frame(plate)], codec="rawvideo")
    codecs = {".mp4": "libx264", ".webm": "libvpx-vp9", ".mov": "qtrle", ".avi": "mpeg4"}
    notes = copy(clip, tmp_path / name, codec=codecs.get(name[name.index(".") :]))
    told = [note.partition("; ")[2] for note in notes if "pixel format" in note]
    assert told == ([] if lost is None else [lost])


@pytest.mark.parametrize("name", ["p_%d.png", "p_%d.tif", "p_%d.jpg", "out.mp4", "out.mov"])
@pytest.mark.parametrize("plate", ["in_%d.exr", "in_%d.pfm"])
def test_light_above_white_is_said_to_be_clipped_where_the_result_cannot_hold_it(
    tmp_path, plate, name
):
    light = np.full((48, 64), 6.0, np.float32)
    if plate.endswith(".exr"):
        write_layers(tmp_path / "in_0.exr", dict.fromkeys("RGB", light))
    else:
        assert cv2.imwrite(str(tmp_path / "in_0.pfm"), np.dstack([light] * 3))
    notes = [note for note in copy(tmp_path / plate, tmp_path / name) if "white" in note]
    (note,) = notes
    assert note.startswith("light above white (1.0)") and note.endswith(".exr files do")
    written = next(tmp_path.glob(name.replace("%d", "0")))
    assert read(written, "rgb24").min() >= 253


@pytest.mark.parametrize(
    ("plate", "name"),
    [("in_%d.exr", "p_%d.exr"), ("in_%d.pfm", "p_%d.exr"), ("in_%d.png", "p_%d.jpg")],
)
def test_no_light_is_said_to_be_clipped_where_it_is_held_or_the_plate_has_none(
    tmp_path, plate, name
):
    light = np.full((48, 64), 6.0, np.float32)
    write_layers(tmp_path / "in_0.exr", dict.fromkeys("RGB", light))
    assert cv2.imwrite(str(tmp_path / "in_0.pfm"), np.dstack([light] * 3))
    assert cv2.imwrite(str(tmp_path / "in_0.png"), np.full((48, 64, 3), 65535, np.uint16))
    assert not [note for note in copy(tmp_path / plate, tmp_path / name) if "white" in note]
    if name.endswith(".exr"):
        assert read_exr(tmp_path / "p_0.exr").channels["G"].min() > 5.9


@pytest.mark.parametrize("codec", [None, "rawvideo"])
def test_light_of_a_float_plate_is_read_back_from_nut_as_it_was(tmp_path, codec):
    light = np.full((48, 64), 0.2, np.float32)
    write_layers(tmp_path / "in_0.exr", dict.fromkeys("RGB", light))
    copy(tmp_path / "in_%d.exr", tmp_path / "out.nut", codec=codec)
    with open_source(str(tmp_path / "out.nut")) as source:
        found = next(iter(source)).picture.linear(Box(0, 0, 64, 48))
        assert "f32" not in source.info.pixel_format
    assert np.abs(found - 0.2).max() < 0.002


def test_rows_of_a_pfm_plate_lie_as_the_file_says(tmp_path):
    light = np.linspace(0.1, 0.9, 48 * 64 * 3, dtype=np.float32).reshape(48, 64, 3)
    assert cv2.imwrite(str(tmp_path / "in.pfm"), light[..., ::-1])
    with open_source(str(tmp_path / "in.pfm")) as source:
        picture = next(iter(source)).picture
    assert (picture.linear(Box(0, 0, 64, 48)) == light).all()
    assert (picture.copy().linear(Box(0, 0, 64, 48)) == light).all()


def light_plate(path, *, grey):
    """A picture of light up to 1.5, as its file holds it (48, 64, 3)."""
    y, x = np.mgrid[:48, :64]
    light = np.stack([0.7 + 0.8 * np.sin(x / 9 + k) * np.cos(y / 7 + k) for k in range(3)], -1)
    light = np.maximum(light, 0.0).astype(np.float32)
    assert cv2.imwrite(str(path), light[..., 0] if grey else light)
    found = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    return np.dstack([found] * 3) if grey else found[..., ::-1]


@pytest.mark.parametrize(("ending", "off"), [(".png", 10.0), (".tif", 10.0), (".jpg", 2500.0)])
@pytest.mark.parametrize(
    ("plate", "grey"), [("in.hdr", False), ("in.pfm", False), ("in.pfm", True)]
)
def test_light_of_a_float_plate_becomes_srgb_codes(tmp_path, plate, grey, ending, off):
    light = np.clip(light_plate(tmp_path / plate, grey=grey), 0.0, 1.0)
    copy(tmp_path / plate, tmp_path / f"out{ending}")
    codes = np.where(light < 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)
    found = read(tmp_path / f"out{ending}", "rgb48le")
    assert np.abs(found - 65535.0 * codes).mean() < off


@pytest.mark.parametrize("name", ["out.png", "out.nut", "out.mp4"])
@pytest.mark.parametrize("grey", [False, True])
def test_light_of_a_float_plate_is_read_back_as_it_was_up_to_white(tmp_path, name, grey):
    light = np.clip(light_plate(tmp_path / "in.pfm", grey=grey), 0.0, 1.0)
    copy(tmp_path / "in.pfm", tmp_path / name, codec="rawvideo" if name == "out.nut" else None)
    with open_source(str(tmp_path / name)) as source:
        assert source.info.tags.transfer == "iec61966-2-1"
        found = next(iter(source)).picture.linear(Box(0, 0, 64, 48))
    fine = grey or name != "out.mp4"  # else the waves' colours are finer than its chroma
    assert np.abs(found - light).mean() < (0.015 if fine else 0.04)


def test_grey_pictures_of_16_bits_keep_their_levels_in_video(tmp_path):
    ramp = np.tile(np.linspace(0, 65535, 64).astype(np.uint16), (48, 1))
    assert cv2.imwrite(str(tmp_path / "in.png"), ramp)
    copy(tmp_path / "in.png", tmp_path / "out.mp4")
    assert np.abs(read(tmp_path / "out.mp4", "rgb48le") - ramp[..., None].astype(int)).max() < 1200
