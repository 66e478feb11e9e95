"""Frames in another form than the first are converted to it, and what cannot be is told."""

from fractions import Fraction

import av
import numpy as np
import pytest

from nlens_video.core.color import ColorTags
from nlens_video.video.input.source import open_source
from nlens_video.video.pixels.samples import Coding

BT709, BT601, BT470, NONE = 1, 6, 5, 2
LIMITED, FULL = 1, 2
NAMES = {BT709: "bt709", BT601: "smpte170m", BT470: "bt470bg", NONE: "bt709"}
RGB = np.array([0.8, 0.3, 0.2])


def flat(matrix, range_):
    """A frame of one colour in the codes of a matrix and range."""
    tags = ColorTags(
        matrix=NAMES[matrix], transfer="bt709", primaries="bt709", full_range=range_ == FULL
    )
    affine = Coding("yuv", tags, 8).rgb_from_codes
    codes = np.linalg.solve(affine[:, :3], RGB - affine[:, 3])
    frame = av.VideoFrame(64, 48, "yuv420p")
    for plane, code in zip(frame.planes, np.rint(codes), strict=True):
        plane.update(bytes([int(code)]) * plane.buffer_size)
    return frame


def recording(path, matrix=BT709, range_=LIMITED, primaries=BT709, curve=BT709, aspect=1, start=0):
    """Three frames of one colour."""
    with av.open(str(path), "w") as out:
        stream = out.add_stream("libx264", 25, {"crf": "1", "preset": "veryfast", "bf": "0"})
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
        context = stream.codec_context
        context.colorspace, context.color_range = matrix, range_
        context.color_primaries, context.color_trc = primaries, curve
        context.sample_aspect_ratio = Fraction(aspect)
        for index in range(3):
            frame = flat(matrix, range_)
            frame.pts, frame.time_base = start + index, Fraction(1, 25)
            out.mux(stream.encode(frame))
        out.mux(stream.encode(None))
    return path.read_bytes()


def joined(folder, first, then):
    """Two recordings in one file, the second with other properties."""
    path = folder / "joined.ts"
    parts = [recording(folder / "0.ts", **first), recording(folder / "1.ts", **then, start=3)]
    path.write_bytes(b"".join(parts))
    return path


def seen(path):
    """The mean sRGB colour of each frame, their formats and tags, and the warnings."""
    with open_source(str(path)) as source:
        frames = [frame.picture for frame in source]
        colours = [picture.srgb().mean((0, 1)) for picture in frames]
        forms = {
            (one.frame.format.name, one.frame.colorspace, one.frame.color_range) for one in frames
        }
        return colours, forms, source.warnings()


@pytest.mark.parametrize(
    ("first", "then", "words"),
    [
        ({}, {"matrix": BT601}, "of smpte170m) and were converted to 64x48 yuv420p of bt709"),
        ({"matrix": BT601}, {}, "of bt709) and were converted to 64x48 yuv420p of smpte170m"),
        ({}, {"range_": FULL}, "full range) and were converted to 64x48 yuv420p of limited range"),
        ({"range_": FULL}, {}, "limited range) and were converted to 64x48 yuvj420p of full range"),
        ({}, {"matrix": BT601, "range_": FULL}, "of smpte170m, full range) and were converted"),
    ],
)
def test_frames_of_another_matrix_or_range_keep_their_colour(tmp_path, first, then, words):
    colours, forms, warnings = seen(joined(tmp_path, first, then))
    assert len(colours) == 6 and len(forms) == 1
    np.testing.assert_allclose(colours, [colours[0]] * 6, atol=0.014)
    (said,) = warnings
    assert said.startswith("3 frames had another form (from frame 3 on") and words in said


@pytest.mark.parametrize(
    ("first", "then"),
    [
        ({"matrix": BT470}, {"matrix": BT601}),
        ({}, {"matrix": NONE, "primaries": NONE, "curve": NONE}),
        ({}, {"curve": BT601}),
    ],
    ids=["two names of a matrix", "no tags", "two names of a curve"],
)
def test_frames_that_mean_the_same_by_other_tags_stay_as_they_are(tmp_path, first, then):
    colours, forms, warnings = seen(joined(tmp_path, first, then))
    assert len(forms) == 1 and warnings == ()
    np.testing.assert_allclose(colours, [colours[0]] * 6, atol=0.005)


def test_another_shape_of_pixels_is_told_once(tmp_path):
    path = joined(tmp_path, {"aspect": "16/15"}, {"aspect": "64/45"})
    _, _, (said,) = seen(path)
    assert said.startswith("from frame 3 on the picture is 1.9 times as wide as high, before 1.42")


def test_other_primaries_and_transfer_functions_are_told_once(tmp_path):
    _, _, (said,) = seen(joined(tmp_path, {}, {"primaries": 9, "curve": 16}))
    assert "transfer function smpte2084, before bt709; primaries bt2020, before bt709" in said


def test_palette_pictures_of_a_sequence_of_rgb_are_converted(tmp_path):
    for number, name in enumerate(("rgb24", "pal8")):
        rgb = av.VideoFrame.from_ndarray(np.full((48, 64, 3), 90, np.uint8), "rgb24")
        with av.open(str(tmp_path / f"p.{number}.png"), "w", format="image2") as out:
            stream = out.add_stream("png", 25, {"update": "1"})
            stream.width, stream.height, stream.pix_fmt = 64, 48, name
            frame = rgb if name == "rgb24" else palette_frame(90)
            out.mux([*stream.encode(frame), *stream.encode(None)])
    colours, _, (said,) = seen(tmp_path / "p.%d.png")
    np.testing.assert_allclose(colours, [colours[0]] * 2, atol=0.005)
    assert "pal8" in said


def palette_frame(level):
    """A picture whose one colour is the third of its palette."""
    frame = av.VideoFrame(64, 48, "pal8")
    frame.planes[0].update(b"\2" * frame.planes[0].buffer_size)
    frame.planes[1].update(bytes([level, level, level, 255]) * 256)
    return frame
