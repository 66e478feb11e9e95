"""H.264 and HEVC whose cropping begins at the left: no hidden column is shown."""

import av
import numpy as np
import pytest
from av.bitstream import BitStreamFilterContext
from support.clips import copy, noise_frame, planes, write_clip

from nlens_video.core.layers import Box
from nlens_video.video.input.source import open_source

HIDDEN = 8


def cropped(source, target):
    """A file whose parameter sets hide the first columns, which the decoder has to crop."""
    with av.open(str(source)) as given, av.open(str(target), "w") as made:
        video = given.streams.video[0]
        stream = made.add_stream_from_template(video)
        bits = BitStreamFilterContext(f"{video.codec.name}_metadata=crop_left={HIDDEN}", video)
        for packet in given.demux(video):
            for one in bits.filter(packet if packet.size else None):
                one.stream = stream
                made.mux(one)
    return target


@pytest.mark.parametrize(("codec", "option"), [("libx264", "x264"), ("libx265", "x265")])
@pytest.mark.parametrize("pixel_format", ["yuv420p", "yuv444p10le"])
def test_columns_that_are_cropped_at_the_left_stay_hidden(tmp_path, codec, option, pixel_format):
    frames = [noise_frame(72, 48, pixel_format, seed) for seed in range(3)]
    options = {f"{option}-params": "log-level=none"} if option == "x265" else {}
    whole = write_clip(tmp_path / "whole.ts", frames, codec=codec, options=options)
    part = cropped(whole, tmp_path / "in.ts")
    with open_source(str(part)) as source, av.open(str(whole)) as uncropped:
        assert (source.info.width, source.info.height) == (72 - HIDDEN, 48)
        for frame, reference in zip(source, uncropped.decode(video=0), strict=True):
            shown = planes(frame.picture.frame)
            for mine, full in zip(shown, planes(reference), strict=True):
                np.testing.assert_array_equal(mine, full[:, full.shape[1] - mine.shape[1] :])
    copy(part, tmp_path / "out.mkv", box=Box(3, 5, 60, 40), codec="ffv1")
    with av.open(str(tmp_path / "out.mkv")) as result:
        for mine, reference in zip(result.decode(video=0), frames_of(whole), strict=True):
            luma, full = planes(mine)[0], planes(reference)[0]
            np.testing.assert_array_equal(luma[45:], full[45:, -luma.shape[1] :])


def frames_of(path):
    with av.open(str(path)) as source:
        yield from source.decode(video=0)
