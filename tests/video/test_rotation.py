"""Pictures that lie on their side or are mirrored, as in phones' files, in all kinds of results."""

import subprocess
import sys
from fractions import Fraction

import av
import numpy as np
import PIL.Image
import PIL.ImageOps
import pytest
from av.sidedata.sidedata import Type
from support.clips import copy, read_times, write_clip
from support.folders import TESTS
from support.programs import made

from nlens_video.core.errors import NoteKind, kind_of
from nlens_video.video.input.source import open_source

STORES_IT = ("mp4", "mkv", "mov", "webm")


def gradient(pixel_format):
    """Wider than high, dark at the upper left, bright at the lower right, red at the right."""
    y, x = np.mgrid[:48, :64]
    rgb = np.stack([40 + 2 * x + y, 40 + 3 * y, np.full_like(x, 60)], -1).astype(np.uint8)
    frame = av.VideoFrame.from_ndarray(rgb, "rgb24").reformat(
        format=pixel_format, dst_colorspace="ITU709", dst_color_range="MPEG"
    )
    frame.colorspace, frame.color_range = 1, 1
    return frame


def phone_clip(folder, rotation, mirrored=False):
    frames = [gradient("yuv420p") for _ in range(12)]
    return write_clip(
        folder / "in.mov", frames, codec="libx264", rotation=rotation, mirrored=mirrored,
        time_base=Fraction(1, 600), pts=range(0, 288, 24),
    )  # fmt: skip


def as_shown(path):
    """Luma of the first picture as players show it."""
    with av.open(str(path)) as source:
        frame = next(source.decode(video=0))
        deep = frame.format.components[0].bits > 8
        rows = np.frombuffer(frame.planes[0], np.uint16 if deep else np.uint8)
        luma = rows.reshape(frame.height, -1)[:, : frame.width].astype(int)
        matrix = frame.side_data.get(Type.DISPLAYMATRIX)
    if matrix is None:
        return luma
    # where a step right and a step down of stored pixels lead: right and down, as shown
    a, b, _, c, d = np.sign(np.frombuffer(matrix, np.int32)[:5])
    return luma[::d, ::a] if a else luma.T[::b, ::c]


@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize("rotation", [0, 90, 180, -90])
@pytest.mark.parametrize("ending", [*STORES_IT, "ts", "avi", "nut", "mxf", "flv", "mpg"])
def test_footage_of_a_phone_is_upright_in_every_container(tmp_path, ending, rotation, mirrored):
    clip = phone_clip(tmp_path, rotation, mirrored)
    out = tmp_path / f"out.{ending}"
    notes = " ".join(copy(clip, out))
    shown, wanted = as_shown(out), as_shown(clip)
    assert shown.shape == wanted.shape
    assert np.abs(shown - wanted).max() < 16
    turned = (rotation or mirrored) and ending not in STORES_IT
    assert ("the pictures are turned upright" in notes) == turned
    assert len(read_times(out)) == 12


@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize("rotation", [0, 90, 180, -90])
@pytest.mark.parametrize("pixel_format", ["yuv420p", "yuv422p10le", "yuv444p", "yuv411p", "gray"])
def test_footage_that_lies_on_its_side_keeps_its_codes_when_turned(
    tmp_path, pixel_format, rotation, mirrored
):
    clip = write_clip(
        tmp_path / "in.mkv", [gradient(pixel_format)], codec="ffv1", rotation=rotation,
        mirrored=mirrored,
    )  # fmt: skip
    copy(clip, tmp_path / "out.nut")
    with av.open(str(clip)) as before, av.open(str(tmp_path / "out.nut")) as after:
        stored, upright = (next(one.decode(video=0)) for one in (before, after))
    assert (upright.format.name, upright.rotation) == (pixel_format, 0)
    np.testing.assert_array_equal(as_shown(tmp_path / "out.nut"), as_shown(clip))
    as_rgb = [one.to_ndarray(format="rgb24").astype(int) for one in (stored, upright)]
    shown = np.rot90(as_rgb[0], rotation // 90)
    assert np.abs((shown[:, ::-1] if mirrored else shown) - as_rgb[1]).max() < 24


def test_turned_pixels_have_the_aspect_ratio_of_their_new_side(tmp_path):
    clip = tmp_path / "in.mov"
    with av.open(str(clip), "w") as out:
        stream = out.add_stream("libx264", 25)
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
        stream.codec_context.sample_aspect_ratio = Fraction(4, 3)
        stream.set_display_rotation(90)
        for _ in range(12):
            out.mux(stream.encode(gradient("yuv420p")))
        out.mux(stream.encode(None))
    copy(clip, tmp_path / "out.ts")
    with open_source(str(clip)) as before, open_source(str(tmp_path / "out.ts")) as after:
        assert after.info.sample_aspect_ratio == Fraction(3, 4)
        assert after.info.pixel_aspect == before.info.pixel_aspect
        assert (after.info.width, after.info.height) == (48, 64)


@pytest.mark.parametrize("mirrored", [False, True])
def test_footage_of_a_phone_is_upright_on_standard_output(tmp_path, mirrored):
    clip = phone_clip(tmp_path, 90, mirrored)
    code = "import sys; from support.clips import copy; copy(sys.argv[1], '-')"
    run = subprocess.run(
        [sys.executable, "-c", code, str(clip)], capture_output=True, cwd=TESTS, check=True
    )
    (tmp_path / "out.nut").write_bytes(run.stdout)
    assert np.abs(as_shown(tmp_path / "out.nut") - as_shown(clip)).max() == 0


@pytest.mark.needs_programs("ffmpeg")
@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize("rotation", [0, 90, 180, -90])
@pytest.mark.parametrize("ending", ["mp4", "mkv"])
def test_plate_is_composited_as_the_ffmpeg_program_shows_it(tmp_path, ending, rotation, mirrored):
    clip = write_clip(
        tmp_path / f"in.{ending}", [gradient("yuv444p")], codec="libx264", options={"qp": "0"},
        rotation=rotation, mirrored=mirrored,
    )  # fmt: skip
    made("-i", clip, "-pix_fmt", "yuv444p", "-c:v", "ffv1", tmp_path / "shown.mkv")
    light = []
    for path in (clip, tmp_path / "shown.mkv"):
        with open_source(str(path)) as source:
            light.append(next(iter(source)).picture.srgb())
    np.testing.assert_array_equal(*light)


@pytest.mark.parametrize("orientation", range(1, 9))
@pytest.mark.parametrize("ending", ["jpg", "png", "tif", "webp"])
def test_photograph_is_composited_and_written_as_pillow_shows_it(tmp_path, ending, orientation):
    exif = PIL.Image.Exif()
    exif[274] = orientation
    photograph = PIL.Image.fromarray(gradient("yuv444p").to_ndarray(format="rgb24"))
    photograph.save(tmp_path / f"in.{ending}", exif=exif, quality=95)
    wanted = as_pillow_shows(tmp_path / f"in.{ending}")
    with open_source(str(tmp_path / f"in.{ending}")) as source:
        seen = 255.0 * next(iter(source)).picture.srgb()
    assert seen.shape == wanted.shape
    assert np.abs(seen - wanted).mean() < 6
    copy(tmp_path / f"in.{ending}", tmp_path / f"out.{ending}")
    assert np.abs(as_pillow_shows(tmp_path / f"out.{ending}") - wanted).mean() < 6


def as_pillow_shows(path):
    with PIL.Image.open(path) as picture:
        return np.asarray(PIL.ImageOps.exif_transpose(picture).convert("RGB"), float)


def test_plate_that_is_turned_by_45_degrees_is_taken_as_stored_and_told(tmp_path):
    clip = write_clip(tmp_path / "in.mp4", [gradient("yuv420p")], codec="libx264", rotation=45)
    with open_source(str(clip)) as source:
        assert (source.info.width, source.info.height) == (64, 48)
        (note,) = source.info.notes
    assert "turned by 45 degrees" in note and "ffmpeg -i IN OUT" in note
    assert kind_of(note) is NoteKind.UNCERTAIN
