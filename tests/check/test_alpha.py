"""Alpha of plates: lost, changed beside the object, or changed as a whole."""

from fractions import Fraction

import av
import numpy as np
import pytest
from support import takes

from nlens_video.check.command import compare
from nlens_video.core.settings import SourceSettings

_FRAMES = 6
_VEIL = np.tile(np.linspace(1.0, 0.2, takes.WIDTH, dtype=np.float32), (takes.HEIGHT, 1))


def clip(path, *, composited, alpha):
    """RGB, with straight alpha (H, W) if given, which the object changes too."""
    with av.open(str(path), "w") as out:
        stream = out.add_stream("ffv1", rate=takes.RATE)
        stream.width, stream.height = takes.WIDTH, takes.HEIGHT
        stream.pix_fmt = "bgr0" if alpha is None else "bgra"
        for number in range(_FRAMES):
            picture = takes.plate(number)
            layers = np.dstack([picture, np.zeros_like(_VEIL) if alpha is None else alpha])
            if composited:
                drawn = takes.with_object(picture, number)
                layers[..., :3] = drawn
                if alpha is not None:
                    layers[..., 3:] = takes.with_object(layers[..., [3] * 3], number).max(2)[
                        ..., None
                    ]
            coded = np.round(255 * layers.clip(0, 1)).astype(np.uint8)
            frame = av.VideoFrame.from_ndarray(coded[..., [2, 1, 0, 3]], "bgra")
            frame = frame.reformat(format=stream.pix_fmt)
            frame.pts, frame.time_base = number, Fraction(1, takes.RATE)
            out.mux(stream.encode(frame))
        out.mux(stream.encode())
    return path


@pytest.fixture
def against(tmp_path):
    """Findings on a result of some alpha, whose plate has that of a veil."""
    plate = clip(tmp_path / "in.mkv", composited=False, alpha=_VEIL)

    def run(alpha):
        result = clip(tmp_path / "out.mkv", composited=True, alpha=alpha)
        verdict = compare(str(result), SourceSettings(spec=str(plate))).verdict
        return [one.text for one in verdict.findings]

    return run


def test_alpha_that_only_the_object_changes_has_no_findings(against):
    assert against(_VEIL) == []


def test_alpha_that_the_result_lacks_is_a_plate_change(against):
    (text,) = against(None)
    assert text == "frames 0 to 5: the result has no alpha, and the plate is transparent there"


def test_alpha_that_changed_beside_the_object_is_a_plate_change_and_no_shadow(against):
    changed = _VEIL.copy()
    changed[8:40, 264:304] = 1.0
    (text,) = against(changed)
    assert "40x32 px at 264,8" in text and "away from the object" in text


def test_alpha_that_changed_as_a_whole_is_a_plate_change(against):
    (text,) = against(_VEIL - 0.05)
    assert "of 255 levels less alpha" in text


def test_plate_that_is_opaque_everywhere_needs_no_alpha_in_the_result(tmp_path):
    plate = clip(tmp_path / "in.mkv", composited=False, alpha=np.ones_like(_VEIL))
    result = clip(tmp_path / "out.mkv", composited=True, alpha=None)
    assert compare(str(result), SourceSettings(spec=str(plate))).verdict.fine
