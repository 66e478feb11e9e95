"""What a picture looks like it was taken by: the network's input and its answer as a cue."""

import math

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from nlens_video.networks.camera_network import OnnxCameraNetwork
from nlens_video.networks.model_store import find_model
from nlens_video.solve.still.picture_cue import (
    AREA_PX,
    BINS,
    CHANNELS,
    COLUMNS,
    ROWS,
    PictureCue,
    mirrored,
    picture_cue,
    picture_features,
    reduced,
)
from nlens_video.solve.still.prior import CameraPrior

MIDDLE = np.array([-0.3, 0.02, 0.1])
CUE = PictureCue(MIDDLE, np.diag([20.0, 50.0, 5.0]))


@pytest.fixture(scope="module")
def network():
    return OnnxCameraNetwork(find_model("camera").path)


def striped(turn_deg, size=(240, 128)):
    """Stripes whose brightness changes along a direction."""
    y, x = np.mgrid[: size[1], : size[0]]
    turn = math.radians(turn_deg)
    along = math.cos(turn) * x + math.sin(turn) * y
    return np.repeat(np.uint8(128 + 90 * np.sin(0.5 * along))[..., None], 3, axis=-1)


@pytest.mark.parametrize("turn_deg", [0.0, 45.0, 90.0, 146.25])
def test_direction_of_gradients_is_told_everywhere(turn_deg):
    finest = picture_features(striped(turn_deg))[..., :BINS]
    assert finest.shape == (ROWS, COLUMNS, BINS)
    expected = round(turn_deg / 180.0 * BINS) % BINS
    assert (finest.argmax(axis=-1) == expected).all()
    assert finest[..., expected].min() > 0.5


def test_even_picture_has_no_direction():
    features = picture_features(np.full((128, 240, 3), 90, np.uint8))
    assert features.shape == (ROWS, COLUMNS, CHANNELS)
    assert features[..., :BINS].max() == 0.0
    np.testing.assert_allclose(features[..., -3:], 90 / 255, atol=1e-6)


def test_mirrored_features_are_those_of_the_mirrored_picture():
    rng = np.random.default_rng(0)
    noise = rng.uniform(0, 255, (128, 240, 3))
    picture = np.uint8(
        cv2.normalize(cv2.GaussianBlur(noise, (0, 0), 4), None, 0, 255, cv2.NORM_MINMAX)
    )
    flipped = picture_features(np.ascontiguousarray(picture[:, ::-1]))
    expected = mirrored(picture_features(picture))
    # Cells do not all begin on a whole pixel, and halving a picture is not symmetric.
    assert abs(flipped - expected).mean() < 0.2 * abs(flipped - picture_features(picture)).mean()


def test_features_do_not_go_by_where_arrays_lie_in_memory():
    picture = np.random.default_rng(0).integers(0, 256, (266, 499, 3), np.uint8)
    kept, found = [], set()
    for count in range(24):  # arrays of other sizes between move the next ones
        found.add(picture_features(picture).tobytes())
        kept.append([np.empty(1000 + 4 * count * n, np.uint8) for n in range(8)])
    assert len(found) == 1


@pytest.mark.parametrize("size", [(3840, 2160), (960, 512), (64, 48), (1080, 1920), (241, 127)])
def test_picture_of_any_size_is_read(network, size):
    picture = cv2.resize(np.float32(striped(60.0)) / 255.0, size)
    height, width = reduced(picture).shape[:2]
    assert height * width == pytest.approx(AREA_PX, rel=0.02)
    cue = picture_cue(network, picture)
    assert cue.middle.shape == (3,) and (cue.errors > 0.0).all()
    assert math.radians(-90) < cue.middle[0] < math.radians(45)


def test_reduced_picture_tells_the_same_as_the_large_one(network):
    large = cv2.resize(np.float32(striped(30.0)) / 255.0, (1920, 1024))
    small = cv2.resize(large, (960, 512), interpolation=cv2.INTER_AREA)
    one, other = picture_cue(network, large), picture_cue(network, small)
    np.testing.assert_allclose(one.middle, other.middle, atol=0.02)


def test_mirrored_picture_has_the_opposite_roll(network):
    picture = np.float32(striped(30.0, (224, 128))) / 255.0
    one, other = picture_cue(network, picture), picture_cue(network, picture[:, ::-1].copy())
    assert (abs(other.middle - one.middle * [1.0, -1.0, 1.0]) < 0.25 * one.errors).all()
    np.testing.assert_allclose(other.errors, one.errors, rtol=0.05)


def test_likelihood_is_highest_at_the_middle():
    assert CUE.log(MIDDLE) > CUE.log(MIDDLE + [0.05, 0.0, 0.0])
    assert CUE.log(MIDDLE + [0.05, 0.0, 0.0]) > CUE.log(MIDDLE + [0.2, 0.0, 0.0])
    np.testing.assert_allclose(CUE.errors, [0.05, 0.02, 0.2])


@given(st.floats(-1.5, 1.5), st.floats(-1.5, 1.5), st.floats(-3.0, 3.0))
def test_no_camera_is_ruled_out(pitch, roll, focal):
    log = CUE.log(np.array([[pitch, roll, focal]]))
    assert log.shape == (1,)
    assert CUE.log(np.array([9.0, 9.0, 9.0])) <= log[0] <= CUE.log(MIDDLE)
    assert log[0] > -15.0


def test_prior_holds_the_picture_beside_the_rest():
    cameras = np.array([MIDDLE, MIDDLE + [0.1, 0.0, 0.0]])
    without, beside = CameraPrior().log(cameras), CameraPrior(picture=CUE).log(cameras)
    np.testing.assert_allclose(beside - without, CUE.log(cameras))
