"""Plates whose pixels are far from square, as wrong metadata makes them: memory stays bounded."""

from fractions import Fraction

import av
import numpy as np
import pytest
from support import shots
from support.command import nlens, one_line

from nlens_video import Compositor
from nlens_video.core.errors import InputError


@pytest.fixture
def words(tmp_path):
    """The words that follow a plate."""
    glb, fit = shots.cube_glb(tmp_path / "anim.glb"), shots.fit_json(tmp_path / "fit.json")
    return [glb, tmp_path / "out.mp4", "--fit", fit, "--no-progress"]


def plate(folder, across):
    """A frame whose pixels are `across` times as wide as high."""
    frame = av.VideoFrame.from_ndarray(shots.plate(), "rgb24")
    with av.open(str(folder / "in.mp4"), "w") as out:
        stream = out.add_stream("libx264", 25)
        stream.width, stream.height, stream.pix_fmt = frame.width, frame.height, "yuv420p"
        stream.codec_context.sample_aspect_ratio = Fraction(across)
        out.mux([*stream.encode(frame), *stream.encode(None)])
    return folder / "in.mp4"


@pytest.mark.parametrize("across", [Fraction(160), Fraction(1, 160)])
@pytest.mark.parametrize("way", [(), ("--plan",)])
def test_pixels_far_from_square_are_refused_in_one_line(words, tmp_path, across, way):
    """Tables and blur of pixels of 178:1 took more than 20 GB."""
    line = one_line(nlens(plate(tmp_path, across), *words, *way), 3)
    assert f"{float(across):.3g} times as wide as high" in line and "setsar=1" in line
    assert not (tmp_path / "out.mp4").exists()


def test_pixels_at_the_limit_are_composited_in(words, tmp_path):
    run = nlens(plate(tmp_path, 8), *words)
    assert run.returncode == 0, run.stderr


def test_compositor_refuses_pixels_far_from_square(words):
    with (
        Compositor(words[0], fps=25, fit=words[3], pixel_aspect=160.0) as lens,
        pytest.raises(InputError, match="160 times as wide as high"),
    ):
        lens.process(np.array(shots.plate()))
