"""`samples/truth/pulls.py`: the lens that it tells is the one that its clips are seen through."""

import cv2
import numpy as np
import pytest
from support.folders import SAMPLES

from nlens_video.scene.scene import Scene


@pytest.fixture(scope="module", autouse=True)
def _samples_on_the_path():
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(SAMPLES))
        yield


@pytest.fixture(scope="module")
def pull(_samples_on_the_path):
    """A clip of a lens that breathes, with everything in view of its camera."""
    from truth.pulls import Pull

    return Pull(seed=1, frames=5)


@pytest.mark.parametrize("name", ["smooth", "rests", "accelerates", "linear", "rack", "steps"])
def test_a_pull_goes_from_its_start_to_its_end_and_never_back(name):
    from truth.pulls import path_of

    way = path_of(name, 37)
    assert way[0] == pytest.approx(0.0, abs=1e-12) and way[-1] == pytest.approx(1.0)
    assert (np.diff(way) >= -1e-12).all()


def test_a_pull_that_returns_ends_where_it_began():
    from truth.pulls import path_of

    way = path_of("returns", 37)
    assert way.argmax() == 18 and way[18] == pytest.approx(1.0)
    np.testing.assert_allclose(way, way[::-1], atol=1e-12)


@pytest.mark.slow
def test_the_lens_focuses_where_the_pull_says(pull):
    lens = pull.lens()
    assert lens[0]["size"] == 1.0 and lens[-1]["size"] != 1.0
    for frame, focus in zip(lens, pull.focus, strict=True):
        assert frame["slope"] * focus + frame["intercept"] == pytest.approx(0.0, abs=1e-9)
        assert frame["slope"] == pytest.approx(frame["size"] * pull.aperture * pull.focal)


@pytest.mark.slow
def test_points_of_the_aperture_see_a_depth_shifted_by_its_circle_of_confusion(pull):
    from truth.pulls import HEIGHT, WIDTH

    half = 0.5 * pull.aperture
    views = [pull.view(right, 0.0, 0).mean(axis=2) for right in (half, -half)]
    right, up, ahead = pull._to_camera(np.array([[pull.place[0], 0.0, pull.place[1]]]))[:, 0]
    column, row = (2 * v for v in (WIDTH / 2 + pull.focal * right / ahead,
                                   HEIGHT / 2 - pull.focal * up / ahead))  # fmt: skip
    part = np.s_[int(row) - 24 : int(row) + 24, int(column) - 96 : int(column) + 96]
    (shift, _), _ = cv2.phaseCorrelate(*(np.ascontiguousarray(v[part], np.float64) for v in views))
    # two samples a pixel; of infinity the shift is nothing, so it is the slope by the depth
    assert shift / 2 == pytest.approx(pull.slope / pull.object_depth, rel=0.1)


@pytest.mark.slow
def test_the_camera_of_the_glb_sees_the_object_at_the_depth_of_the_truth(pull, tmp_path):
    from truth.pulls import write_glb

    write_glb(tmp_path / "object.glb", pull)
    camera = Scene.load(tmp_path / "object.glb").camera(0.0, 960, 512)
    foot = camera.to_camera(np.array([[pull.place[0], 0.0, -pull.place[1]]]))[0]
    assert -foot[2] == pytest.approx(pull.object_depth, rel=1e-6)
    assert camera.fx == pytest.approx(pull.focal, rel=1e-6)


def test_a_clip_is_read_back_as_it_was_drawn(tmp_path):
    from truth.clip_file import read_clip_file, write_clip_file

    ramp = np.linspace(0.1, 0.9, 64)[None, :, None] * np.ones((48, 1, 3))
    drawn = [np.float32(ramp * gain) for gain in (1.0, 0.8, 1.3)]
    for name in ("one.mp4", "other.mp4"):
        write_clip_file(tmp_path / name, drawn, rate=24, crf=4)
    read = list(read_clip_file(tmp_path / "one.mp4"))
    assert len(read) == 3
    for found, codes in zip(read, drawn, strict=True):
        assert np.abs(found - np.clip(codes, 0, 1)).max() < 0.03
    assert (tmp_path / "one.mp4").read_bytes() == (tmp_path / "other.mp4").read_bytes()


def test_a_clip_without_frames_is_refused(tmp_path):
    from truth.clip_file import write_clip_file

    with pytest.raises(ValueError, match="needs a frame"):
        write_clip_file(tmp_path / "none.mp4", iter(()), rate=24, crf=18)
