"""The focal length that recordings state: EXIF of pictures, tags of files and of tracks."""

import math
import struct

import av
import numpy as np
import PIL.Image
import pytest
from PIL.TiffImagePlugin import IFDRational, ImageFileDirectory_v2

from nlens_video.video.focal_length import tagged_focal
from nlens_video.video.input.source import open_source

FOCAL, EQUIVALENT, ACROSS, DOWN = 37386, 41989, 40962, 40963
PLANE_X, PLANE_UNIT, EXIF, ORIENTATION = 41486, 41488, 34665, 274
CENTIMETRES, MILLIMETRES, SIDEWAYS = 3, 4, 6
KEY = "com.apple.quicktime.camera.focal_length.35mm_equivalent"
DIAGONAL_MM = math.hypot(36.0, 24.0)


def picture(size=(160, 120)):
    rng = np.random.default_rng(3)
    return PIL.Image.fromarray(rng.integers(0, 255, (size[1], size[0], 3), np.uint8))


def photo(path, tags, size=(160, 120), orientation=1):
    """A picture with EXIF."""
    exif = PIL.Image.Exif()
    exif[ORIENTATION] = orientation
    exif.get_ifd(EXIF).update(tags)
    picture(size).save(path, exif=exif)
    return path


def clip(path, tags=None):
    """A clip whose file has tags of the `mdta` kind."""
    with av.open(str(path), "w", options={"movflags": "use_metadata_tags"}) as container:
        container.metadata.update(tags or {})
        stream = container.add_stream("libx264", rate=25)
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
        grey = np.full((48, 64, 3), 119, np.uint8)
        container.mux(stream.encode(av.VideoFrame.from_ndarray(grey, "rgb24")))
        container.mux(stream.encode())
    return path


def box(kind, *parts):
    content = b"".join(parts)
    return struct.pack(">I4s", 8 + len(content), kind) + content


def add_track_tag(path, value, kind, version=b""):
    return add_track_tags(path, [(KEY, value, kind)], version)


def add_track_tags(path, tags, version=b""):
    """Put a `meta` box with tags into the track, as phones do; the samples stay in place."""
    names = [box(b"mdta", name.encode()) for name, _, _ in tags]
    values = [
        box(struct.pack(">I", number), box(b"data", struct.pack(">II", kind, 0), value))
        for number, (_, value, kind) in enumerate(tags, 1)
    ]
    meta = box(
        b"meta", version, box(b"hdlr", bytes(8), b"mdta", bytes(13)),
        box(b"keys", bytes(4), struct.pack(">I", len(names)), *names),
        box(b"ilst", *values),
    )  # fmt: skip
    raw = path.read_bytes()
    moov, trak = raw.index(b"moov") - 4, raw.index(b"trak") - 4
    assert moov > raw.index(b"mdat")
    for at in (moov, trak):
        (size,) = struct.unpack_from(">I", raw, at)
        raw = raw[:at] + struct.pack(">I", size + len(meta)) + raw[at + 4 :]
    end = trak + struct.unpack_from(">I", raw, trak)[0] - len(meta)
    path.write_bytes(raw[:end] + meta + raw[end:])
    return path


def stated(path):
    with open_source(str(path)) as source:
        return tagged_focal(source.info)


@pytest.mark.parametrize("ending", ["jpg", "png", "webp"])
def test_equivalent_of_a_photograph_is_read_from_its_exif(tmp_path, ending):
    found = stated(photo(tmp_path / f"in.{ending}", {EQUIVALENT: 28, FOCAL: 4.2}))
    assert found.equivalent_mm == 28.0
    assert found.tag == "FocalLengthIn35mmFilm"
    assert found.error == pytest.approx(0.03)


def test_equivalent_of_a_tiff_is_read_from_its_exif(tmp_path):
    tags = ImageFileDirectory_v2()
    tags[EXIF] = {EQUIVALENT: 85}
    picture().save(tmp_path / "in.tif", tiffinfo=tags)
    assert stated(tmp_path / "in.tif").equivalent_mm == 85.0


def sensor(size, **more):
    """Tags of a full-frame sensor, 36 mm wide, with 4000 pixels across, behind 50 mm."""
    return {
        FOCAL: IFDRational(50), PLANE_X: IFDRational(4000, 36), PLANE_UNIT: MILLIMETRES,
        ACROSS: size[0], DOWN: size[1], **more,
    }  # fmt: skip


@pytest.mark.parametrize("orientation", [1, SIDEWAYS])
def test_focal_length_follows_from_the_sensors_pixels(tmp_path, orientation):
    tags = sensor((4000, 3000))  # 36 x 27 mm: a diagonal of 45 mm
    found = stated(photo(tmp_path / "in.jpg", tags, orientation=orientation))
    assert found.equivalent_mm == pytest.approx(50.0 * DIAGONAL_MM / 45.0)
    assert found.error == pytest.approx(0.02)
    assert "FocalPlaneXResolution" in found.tag


def test_unit_of_the_sensors_pixels_is_kept(tmp_path):
    tags = sensor((4000, 3000))
    tags |= {PLANE_X: IFDRational(40000, 36), PLANE_UNIT: CENTIMETRES}
    found = stated(photo(tmp_path / "in.jpg", tags))
    assert found.equivalent_mm == pytest.approx(50.0 * DIAGONAL_MM / 45.0)


def test_equivalent_is_believed_where_the_sensors_pixels_contradict_it(tmp_path):
    tags = {**sensor((4000, 3000)), EQUIVALENT: 75}
    assert stated(photo(tmp_path / "in.jpg", tags)).equivalent_mm == 75.0


def test_picture_cut_to_another_shape_is_less_certain(tmp_path):
    tags = {EQUIVALENT: 28, ACROSS: 4000, DOWN: 3000}
    found = stated(photo(tmp_path / "in.jpg", tags, size=(160, 90)))
    assert found.error == pytest.approx(0.15)


@pytest.mark.parametrize(
    ("tags", "focal"),
    [
        ({KEY: "26"}, 26.0),
        ({KEY: "26.50mm"}, 26.5),
        ({KEY: "0"}, None),
        ({"FocalLengthIn35mmFilm": "wide", "title": "26"}, None),
        ({"com.blackmagic-design.camera.lensType": "iPhone 16 Pro 24mm"}, 24.0),
        ({"com.blackmagic-design.camera.lensType": "Canon EF 50mm"}, None),
        ({"com.android.version": "14", "com.android.capture.fps": "30"}, None),
    ],
)
def test_tags_of_a_recording_are_read(tmp_path, tags, focal):
    found = stated(clip(tmp_path / "in.mov", tags))
    assert (None if found is None else found.equivalent_mm) == focal


@pytest.mark.parametrize(
    ("value", "kind", "focal"),
    [
        (struct.pack(">I", 26), 21, 26.0),
        (b"26.00mm", 1, 26.0),
        (struct.pack(">f", 26.5), 23, 26.5),
        (struct.pack(">H", 300), 22, 300.0),
        (b"\xff\xd8", 13, None),  # a picture
    ],
)
@pytest.mark.parametrize("version", [b"", bytes(4)])
def test_tags_of_a_phones_track_are_read(tmp_path, value, kind, focal, version):
    found = stated(add_track_tag(clip(tmp_path / "in.mov"), value, kind, version))
    assert (None if found is None else found.equivalent_mm) == focal
    if found is not None:
        assert found.tag == KEY
        assert found.error == pytest.approx(0.08)


def test_damaged_tags_of_a_track_are_passed_over(tmp_path):
    path = add_track_tag(clip(tmp_path / "in.mov"), struct.pack(">I", 26), 21)
    raw = path.read_bytes()
    at = raw.index(b"ilst")
    path.write_bytes(raw[:at] + b"ilst\xff\xff\xff\xff" + raw[at + 8 :])
    assert stated(path) is None


@pytest.mark.parametrize("kind", [23, 24])
def test_malformed_value_of_a_track_leaves_its_other_tags(tmp_path, kind):
    odd = ("com.apple.quicktime.camera.pitch", b"\0\0\0", kind)  # neither 4 nor 8 bytes
    for number, tags in enumerate(([odd, (KEY, b"26", 1)], [(KEY, b"26", 1), odd])):
        found = stated(add_track_tags(clip(tmp_path / f"in{number}.mov"), tags))
        assert found is not None and found.equivalent_mm == 26.0
