"""Light above diffuse white: HDR video and OpenEXR are compared there too."""

from fractions import Fraction

import av
import numpy as np
import OpenEXR
import pytest
from support import takes

from nlens_video.check.command import compare
from nlens_video.core.settings import SourceSettings

_PQ, _BT2020, _BT2020_NCL = 16, 9, 9
_FRAMES = 8
_PATCH = np.s_[8:40, 264:304]  # away from the object


def texts(result, plate):
    return [
        one.text for one in compare(str(result), SourceSettings(spec=str(plate))).verdict.findings
    ]


def exr_sequence(folder, highlight, *, composited):
    """Scene-linear pictures whose patch is that many times as bright as diffuse white."""
    folder.mkdir()
    for number in range(_FRAMES):
        picture = takes.plate(number)
        if composited:
            picture = takes.with_object(picture, number)
        light = (picture**2.2).astype(np.float32)
        light[_PATCH] = highlight
        header = {"type": OpenEXR.scanlineimage}
        OpenEXR.File(header, {"RGB": light}).write(str(folder / f"{number:04d}.exr"))
    return folder / "%04d.exr"


@pytest.mark.slow
@pytest.mark.parametrize("highlight", [1.0, 60.0])
def test_highlight_of_openexr_that_was_clipped_or_raised_is_a_plate_change(tmp_path, highlight):
    plate = exr_sequence(tmp_path / "plate", 6.0, composited=False)
    assert texts(exr_sequence(tmp_path / "clean", 6.0, composited=True), plate) == []
    (text,) = texts(exr_sequence(tmp_path / "made", highlight, composited=True), plate)
    assert "40x32 px at 264,8" in text and "away from the object" in text


def pq_video(path, code, codec, options, *, composited):
    """Ten-bit PQ whose patch has a code of luma; its texture lies below diffuse white."""
    with av.open(str(path), "w") as out:
        stream = out.add_stream(codec, rate=takes.RATE)
        stream.width, stream.height = takes.WIDTH, takes.HEIGHT
        stream.pix_fmt, stream.options = "yuv420p10le", options
        coding = stream.codec_context
        coding.color_trc, coding.color_primaries, coding.colorspace = _PQ, _BT2020, _BT2020_NCL
        for number in range(_FRAMES):
            picture = takes.plate(number)
            if composited:
                picture = takes.with_object(picture, number)
            luma = np.round(64 + 450 * picture.mean(axis=2)).astype(np.uint16)
            luma[_PATCH] = code
            grey = np.full((takes.HEIGHT, takes.WIDTH // 2), 512, np.uint16)  # of both chromas
            frame = av.VideoFrame.from_ndarray(
                np.concatenate([luma, grey.reshape(-1, takes.WIDTH)]), "yuv420p10le"
            )
            frame.pts, frame.time_base = number, Fraction(1, takes.RATE)
            out.mux(stream.encode(frame))
        out.mux(stream.encode())
    return path


@pytest.mark.slow
@pytest.mark.parametrize(
    ("codec", "options"),
    [
        ("ffv1", {}),
        ("libx264", {"crf": "18"}),
        ("libx265", {"crf": "20", "x265-params": "log-level=none"}),
    ],
)
def test_highlight_of_pq_is_compared_in_every_codec(tmp_path, codec, options):
    plate = pq_video(tmp_path / "in.mkv", 640, "ffv1", {}, composited=False)
    clean = pq_video(tmp_path / "clean.mkv", 640, codec, options, composited=True)
    raised = pq_video(tmp_path / "raised.mkv", 920, codec, options, composited=True)
    assert texts(clean, plate) == []
    (text,) = texts(raised, plate)
    assert "264,8" in text and "away from the object" in text
