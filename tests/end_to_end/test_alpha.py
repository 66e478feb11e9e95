"""Alpha of the plate is kept where container and codec support it."""

import av
import numpy as np
import pytest
from support.clips import copy
from support.programs import made

from nlens_video.video.input.source import open_source

pytestmark = pytest.mark.needs_programs("ffmpeg")
RAMP = "testsrc2=s=64x48:r=25:d=0.2,format=rgba,geq=r='r(X,Y)':g='g(X,Y)':b='b(X,Y)':a='X*4'"
PLATES = {
    "vp9.webm": "libvpx-vp9 -pix_fmt yuva420p -metadata:s:v alpha_mode=1",
    "vp8.webm": "libvpx -auto-alt-ref 0 -pix_fmt yuva420p -metadata:s:v alpha_mode=1",
    "prores.mov": "prores_ks -pix_fmt yuva444p10le",
    "qtrle.mov": "qtrle -pix_fmt argb",
    "ffv1.mkv": "ffv1 -pix_fmt bgra",
}


@pytest.fixture(scope="module")
def plates(tmp_path_factory):
    """A clip of each kind whose alpha is a ramp from left to right."""
    folder = tmp_path_factory.mktemp("plates")
    return {
        name: made("-f", "lavfi", "-i", RAMP, "-c:v", *words.split(), folder / name)
        for name, words in PLATES.items()
    }


def alpha(path):
    """Of a row of the first frame, as this program reads it (W,), 0 to 1."""
    with open_source(str(path)) as source:
        frame = next(iter(source)).picture.frame
    return frame.reformat(format="rgba").to_ndarray()[24, :, 3] / 255


@pytest.mark.parametrize(
    ("plate", "ending"),
    [
        ("vp9.webm", "webm"), ("vp9.webm", "mkv"), ("vp9.webm", "mov"), ("vp8.webm", "webm"),
        ("prores.mov", "mov"), ("prores.mov", "mkv"), ("prores.mov", "webm"), ("qtrle.mov", "mov"),
        ("qtrle.mov", "mkv"), ("qtrle.mov", "webm"), ("qtrle.mov", "apng"), ("ffv1.mkv", "mkv"),
    ],
)  # fmt: skip
def test_alpha_of_the_plate_is_written_to_the_result(plate, ending, plates, tmp_path):
    out = tmp_path / f"out.{ending}"
    notes = copy(plates[plate], out)
    if ending == "mov" and plate == "vp9.webm":  # MOV holds no VP9, H.264 has no alpha
        assert any(note.endswith("alpha is left out") for note in notes)
        return
    assert not any("alpha" in note for note in notes)
    np.testing.assert_allclose(alpha(out), np.arange(64) * 4 / 255, atol=0.05)


@pytest.mark.parametrize("plate", [name for name in PLATES if name != "ffv1.mkv"])
def test_loss_of_alpha_in_the_output_format_is_noted(plate, plates, tmp_path):
    notes = copy(plates[plate], tmp_path / "out.mp4")
    assert any(note.endswith("alpha is left out") for note in notes)
    with av.open(str(tmp_path / "out.mp4")) as out:
        assert "alpha_mode" not in out.streams.video[0].metadata
