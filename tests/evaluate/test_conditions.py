import numpy as np
import pytest
from support.truth_folder import camera, cube_depth, texture

from nlens_video.core.errors import SceneError
from nlens_video.evaluate.coc.conditions import guess_camera, scaled, through_h264, with_noise

CORNERS = np.array([[x, y, z] for x in (-0.2, 0.2) for y in (0, 0.3) for z in (-1.8, -1.4)])
TRIANGLES = CORNERS[[[0, 1, 2], [1, 2, 3], [4, 5, 6], [5, 6, 7]]].astype(np.float64)


@pytest.fixture(scope="module")
def picture():
    return texture(0)[..., :3] ** (1 / 2.2)


def error_of(changed, picture):
    return float(np.sqrt(np.mean((changed - picture) ** 2)))


def test_h264_error_grows_with_crf(picture):
    fine, coarse = (error_of(through_h264(picture, crf), picture) for crf in (10, 40))
    assert 0.001 < fine < 0.07  # half the chroma samples are gone in any case
    assert coarse > 1.5 * fine


def test_h264_condition_keeps_colours():
    orange = np.full((64, 64, 3), (0.9, 0.5, 0.1), np.float32)
    assert through_h264(orange) == pytest.approx(orange, abs=0.015)


def test_h264_condition_accepts_odd_sizes_and_is_deterministic(picture):
    odd = picture[:101, :77]
    first = through_h264(odd)
    assert first.shape == odd.shape
    assert np.array_equal(first, through_h264(odd))


def test_noise_condition_has_the_stated_deviation_and_is_deterministic():
    grey = np.full((80, 80, 3), 0.5, np.float32)
    noisy = with_noise(grey)
    assert noisy.std() == pytest.approx(0.02, rel=0.05)
    assert np.array_equal(noisy, with_noise(grey))


@pytest.mark.parametrize(("width", "height"), [(160, 90), (640, 360)])
def test_scaling_condition_keeps_shape_and_mean_light(picture, width, height):
    other = scaled(picture, width)
    assert other.shape == (height, width, 3)
    assert other.mean() == pytest.approx(picture.mean(), abs=0.003)


def test_true_field_of_view_changes_nothing():
    view = camera()
    guess = guess_camera(view, TRIANGLES, 0.0, 1.0)
    assert guess.moved(CORNERS) == pytest.approx(CORNERS)
    depth = cube_depth(view)
    seen = depth < 1e9
    assert guess.moved_depth(view, depth)[seen] == pytest.approx(depth[seen])


@pytest.mark.parametrize("ratio", [0.85, 1.15])
def test_wrong_field_of_view_keeps_the_object_at_its_screen_position(ratio):
    view = camera()
    guess = guess_camera(view, TRIANGLES, 0.0, ratio)
    before = view.pixels(view.to_camera(CORNERS))
    after = guess.camera.pixels(guess.camera.to_camera(guess.moved(CORNERS)))
    foot = view.pixels(view.to_camera(guess.foot[None]))
    assert guess.camera.pixels(guess.camera.to_camera(guess.moved_foot[None])) == pytest.approx(
        foot
    )
    assert guess.moved(CORNERS)[:, 1].min() == pytest.approx(0.0, abs=1e-9)  # on the ground
    extent = np.ptp(before, axis=0)
    assert np.ptp(after, axis=0) == pytest.approx(extent, rel=0.05)
    assert np.abs(after - before).max() < 0.05 * extent.max()
    assert guess.size != pytest.approx(1.0, abs=0.02)


def test_depth_of_moved_surface_points_agrees_with_the_moved_object():
    view = camera()
    guess = guess_camera(view, TRIANGLES, 0.0, 1.15)
    ground = view.plane_disparity(0.0)  # take the ground itself for the surface: it stays in place
    use = ground > 0.2
    depth = np.where(use, 1 / np.where(use, ground, 1.0), 1.0)
    moved = guess.moved_depth(view, depth)
    row, column = np.argwhere(use)[len(np.argwhere(use)) // 2]
    ray = np.array([(column + 0.5 - view.cx) / view.fx, -(row + 0.5 - view.cy) / view.fy, -1.0])
    pose = view.world_from_camera
    point = pose[:3, 3] + depth[row, column] * (pose[:3, :3] @ ray)
    assert point[1] == pytest.approx(0.0, abs=1e-9)
    expected = -guess.camera.to_camera(guess.moved(point[None]))[0, 2]
    assert moved[row, column] == pytest.approx(expected)


def test_field_of_view_that_puts_the_contact_point_above_the_horizon_is_refused():
    far = TRIANGLES + np.array([0.0, 0.0, -60.0])
    with pytest.raises(SceneError, match="above the horizon"):
        guess_camera(camera(), far, 0.0, 2.0)


def test_impossible_field_of_view_is_refused():
    with pytest.raises(SceneError, match="no camera sees"):
        guess_camera(camera(), TRIANGLES, 0.0, 5.0)
