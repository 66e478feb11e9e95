"""Codecs by the names that people and other programs give them."""

import av
import pytest
from support import shots
from support.command import nlens

from nlens_video.video.output.encoders import encoder_called


@pytest.mark.parametrize(
    ("name", "encoder"),
    [("h264", "libx264"), ("h265", "libx265"), ("hevc", "libx265"), ("av1", "libsvtav1"),
     ("vp9", "libvpx-vp9"), ("libx265", "libx265")],
)  # fmt: skip
def test_codec_family_names_its_encoder(name, encoder):
    assert encoder_called(name) == encoder


def test_result_is_encoded_in_the_codec_that_is_named(tmp_path):
    folder = shots.write_shot(tmp_path, 2, still=False)
    run = nlens(
        folder / "in.mp4", folder / "anim.glb", folder / "out.mp4", "--codec", "h265",
        "--preset", "draft", "--fit", folder / "fit.json", "-q",
    )  # fmt: skip
    assert run.returncode == 0, run.stderr
    with av.open(str(folder / "out.mp4")) as result:
        assert result.streams.video[0].codec.name == "hevc"
