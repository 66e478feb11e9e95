"""Plates that are coded without loss give results without loss."""

import av
import pytest
from support.clips import copy, noise_frame, planes, write_clip

from nlens_video.video.input.lossless import is_lossless
from nlens_video.video.input.source import open_source

ENCODERS = {
    "libx264": ({"qp": "0"}, {"crf": "1"}),
    "libx265": ({"x265-params": "log-level=error:lossless=1"}, {"x265-params": "log-level=error"}),
}
FORMATS = {
    "libx264": ("yuv420p", "yuv422p10le", "yuv444p", "gray"),
    "libx265": ("yuv420p", "yuv422p10le", "yuv444p"),
}
CASES = [(encoder, name) for encoder, names in FORMATS.items() for name in names]


def plate(folder, encoder, pixel_format, *, lossless, ending="mp4"):
    frames = [noise_frame(64, 48, pixel_format, seed) for seed in range(5)]
    options = ENCODERS[encoder][not lossless]
    return write_clip(folder / f"in.{ending}", frames, codec=encoder, options=options)


def decoded(path):
    with av.open(str(path)) as source:
        return [[part.tobytes() for part in planes(one)] for one in source.decode(video=0)]


@pytest.mark.parametrize("ending", ["mp4", "mkv", "ts"])
@pytest.mark.parametrize(("encoder", "pixel_format"), CASES)
def test_lossless_plate_gives_a_lossless_result(tmp_path, encoder, pixel_format, ending):
    source = plate(tmp_path, encoder, pixel_format, lossless=True, ending=ending)
    out = tmp_path / "out.mp4"
    copy(source, out)
    assert decoded(out) == decoded(source)


@pytest.mark.parametrize(("encoder", "pixel_format"), CASES)
def test_lossy_plate_is_not_taken_for_lossless(tmp_path, encoder, pixel_format):
    with open_source(str(plate(tmp_path, encoder, pixel_format, lossless=False))) as source:
        assert not source.info.lossless


def test_quality_that_is_asked_for_makes_a_lossless_plate_smaller(tmp_path):
    source = plate(tmp_path, "libx264", "yuv420p", lossless=True)
    copy(source, tmp_path / "out.mp4", crf=30)
    assert (tmp_path / "out.mp4").stat().st_size < source.stat().st_size / 2


def test_headers_that_are_cut_short_are_not_lossless(tmp_path):
    for encoder, codec in (("libx264", "h264"), ("libx265", "hevc")):
        with av.open(str(plate(tmp_path, encoder, "yuv420p", lossless=True))) as source:
            header = source.streams.video[0].codec_context.extradata
        for length in range(0, len(header), 7):
            assert is_lossless(codec, header[:length]) in (False, True)
    assert not is_lossless("h264", b"")
