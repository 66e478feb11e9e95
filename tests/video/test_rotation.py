"""Pictures that lie on their side, as in phones' files, in every kind of result."""

import subprocess
import sys
from fractions import Fraction

import av
import numpy as np
import pytest
from support.clips import copy, read_times, write_clip
from support.folders import TESTS

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


def phone_clip(folder, rotation, *, pixel_format="yuv420p", codec="libx264"):
    made = [gradient(pixel_format) for _ in range(12)]
    return write_clip(
        folder / "in.mov", made, codec=codec, rotation=rotation, time_base=Fraction(1, 600),
        pts=range(0, 288, 24),
    )  # fmt: skip


def as_shown(path):
    """Luma of the first picture as players show it."""
    with av.open(str(path)) as source:
        frame = next(source.decode(video=0))
        deep = frame.format.components[0].bits > 8
        rows = np.frombuffer(frame.planes[0], np.uint16 if deep else np.uint8)
        luma = rows.reshape(frame.height, -1)[:, : frame.width].astype(int)
        return np.rot90(luma, round(frame.rotation / 90))


@pytest.mark.parametrize("rotation", [90, 180, -90])
@pytest.mark.parametrize("ending", [*STORES_IT, "ts", "avi", "nut", "mxf", "flv", "mpg"])
def test_footage_of_a_phone_is_upright_in_every_container(tmp_path, ending, rotation):
    clip = phone_clip(tmp_path, rotation)
    out = tmp_path / f"out.{ending}"
    notes = " ".join(copy(clip, out))
    shown, wanted = as_shown(out), as_shown(clip)
    assert shown.shape == wanted.shape
    assert np.abs(shown - wanted).max() < 16
    assert ("the pictures are turned upright" in notes) == (ending not in STORES_IT)
    assert len(read_times(out)) == 12


@pytest.mark.parametrize("rotation", [90, 180, -90])
@pytest.mark.parametrize("pixel_format", ["yuv420p", "yuv422p10le", "yuv444p", "yuv411p", "gray"])
def test_footage_that_lies_on_its_side_keeps_its_codes_when_turned(
    tmp_path, pixel_format, rotation
):
    clip = write_clip(
        tmp_path / "in.mkv", [gradient(pixel_format)], codec="ffv1", rotation=rotation
    )  # fmt: skip
    copy(clip, tmp_path / "out.nut")
    with av.open(str(clip)) as before, av.open(str(tmp_path / "out.nut")) as after:
        stored, upright = (next(one.decode(video=0)) for one in (before, after))
    assert (upright.format.name, upright.rotation) == (pixel_format, 0)
    np.testing.assert_array_equal(as_shown(tmp_path / "out.nut"), as_shown(clip))
    as_rgb = [one.to_ndarray(format="rgb24").astype(int) for one in (stored, upright)]
    assert np.abs(np.rot90(as_rgb[0], rotation // 90) - as_rgb[1]).max() < 24


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


def test_footage_of_a_phone_is_upright_on_standard_output(tmp_path):
    clip = phone_clip(tmp_path, 90)
    code = "import sys; from support.clips import copy; copy(sys.argv[1], '-')"
    run = subprocess.run(
        [sys.executable, "-c", code, str(clip)], capture_output=True, cwd=TESTS, check=True
    )
    (tmp_path / "out.nut").write_bytes(run.stdout)
    assert np.abs(as_shown(tmp_path / "out.nut") - as_shown(clip)).max() == 0
