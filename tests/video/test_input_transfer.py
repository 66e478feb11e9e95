"""Plates whose tag says the wrong transfer function."""

import av
import numpy as np
import pytest
from support import shots

from nlens_video.cli.main import main

BT709, SRGB = 1, 13  # FFmpeg's numbers

pytestmark = pytest.mark.needs_gl


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("tags")
    shots.write_video(folder / "in.mkv", codec="ffv1", pix_fmt="yuv420p", frames=2)
    for name, number in (("wrong", BT709), ("right", SRGB)):
        tagged(folder / "in.mkv", folder / f"{name}.mkv", number)
    shots.cube_glb(folder / "anim.glb")
    shots.fit_json(folder / "fit.json")
    return folder


def tagged(source, target, number):
    """The same samples with another transfer function's number."""
    with av.open(str(source)) as before, av.open(str(target), "w") as after:
        frames = list(before.decode(video=0))
        stream = after.add_stream("ffv1", rate=25)
        stream.width, stream.height = frames[0].width, frames[0].height
        stream.pix_fmt, stream.codec_context.color_trc = "yuv420p", number
        for frame in frames:
            frame.color_trc = number
            after.mux(stream.encode(frame))
        after.mux(stream.encode())


def composited(files, out, name, *more):
    words = (files / f"{name}.mkv", files / "anim.glb", out, "--fit", files / "fit.json", "-q")
    assert main([*map(str, words), "--effects", "defocus", "--preset", "draft", *more]) == 0
    with av.open(str(out)) as made:
        assert {frame.color_trc for frame in made.decode(video=0)} == {
            SRGB if name == "right" else BT709
        }
    return [planes[0] for _, planes in shots.read_planes(out)]


def test_input_transfer_option_overrides_the_tag_and_keeps_it_in_the_output(files, tmp_path):
    right = composited(files, tmp_path / "right.mkv", "right")
    said = composited(files, tmp_path / "said.mkv", "wrong", "--input-transfer", "srgb")
    tag = composited(files, tmp_path / "tag.mkv", "wrong")
    assert all(map(np.array_equal, said, right))
    difference = np.abs(tag[0].astype(int) - right[0]).max()
    assert difference > 5, "the tag made no difference: the test shows nothing"


@pytest.mark.parametrize(
    ("plate", "name", "says"),
    [
        ("wrong.mkv", "film", "--input-transfer: 'film': expected one of "),
        ("plate.exr", "srgb", "--input-transfer iec61966-2-1: "),
    ],
)
def test_invalid_input_transfer_is_refused(files, tmp_path, capsys, plate, name, says):
    words = (files / plate, files / "anim.glb", tmp_path / "out.mkv", "--input-transfer", name)
    assert main([str(word) for word in words]) == 2
    err = capsys.readouterr().err
    assert says in err and err.count("\n") == 1, err
    assert list(tmp_path.iterdir()) == []
