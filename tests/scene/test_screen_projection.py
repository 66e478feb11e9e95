"""What holds an object on the screen, against whole arrays of points."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from nlens_video.core.layers import Box
from nlens_video.scene import screen_projection, screen_projection_ref
from nlens_video.scene.camera import Camera
from nlens_video.scene.extent import lens_of


def lens(rng):
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    pose = np.eye(4)
    pose[:3, :3] = turn * np.sign(np.linalg.det(turn))
    pose[:3, 3] = rng.normal(size=3)
    camera = Camera.from_yfov(pose, 0.3 + rng.random(), 320, 200, 1.0 + rng.random())
    return lens_of(camera, Box(0, 0, camera.width, camera.height), 0.0)


def points_before(rng, seen, count, far):
    """World points round a place at a depth of some units, beside or inside the picture."""
    spread = 0.02 if far else 3.0
    middle = np.array([*rng.normal(size=2) * 3.0, -rng.uniform(-1.0, 6.0)])
    own = middle + spread * rng.normal(size=(count, 3))
    return np.ascontiguousarray(own @ seen.axes + seen.eye)


@settings(max_examples=300, deadline=None)
@given(seed=st.integers(0, 100_000), count=st.integers(1, 20), far=st.booleans())
def test_what_misses_the_picture_is_told_as_by_whole_arrays(seed, count, far):
    rng = np.random.default_rng(seed)
    seen = lens(rng)
    points = points_before(rng, seen, count, far)
    numbers, box = seen.numbers(), (-20.0, -20.0, 340.0, 220.0)
    assert screen_projection.misses(points, numbers, *box) == screen_projection_ref.misses(
        points, numbers, *box
    )


def test_points_that_are_no_numbers_may_be_seen():
    rng = np.random.default_rng(1)
    numbers, box = lens(rng).numbers(), (0.0, 0.0, 1e-9, 1e-9)
    for wrong in (np.nan, np.inf, -np.inf):
        points = np.full((2, 3), wrong)
        with np.errstate(invalid="ignore"):
            assert not screen_projection.misses(points, numbers, *box)
            assert (
                screen_projection.travel(np.stack([points, points]), np.stack([numbers] * 2))
                == np.inf
            )


@settings(max_examples=200, deadline=None)
@given(
    seed=st.integers(0, 100_000), moments=st.integers(1, 4), count=st.integers(1, 9),
    step=st.sampled_from([0.0, 1e-3, 0.3]),
)  # fmt: skip
def test_the_bound_of_a_way_is_that_of_whole_arrays(seed, moments, count, step):
    rng = np.random.default_rng(seed)
    seen = lens(rng)
    first = points_before(rng, seen, count, far=False)
    points = first + step * rng.normal(size=(moments, count, 3)).cumsum(axis=0)
    lenses = np.stack([seen.numbers()] * moments)
    lenses[:, 9:12] += step * rng.normal(size=(moments, 3))
    expected = screen_projection_ref.travel(points, lenses)
    np.testing.assert_allclose(
        screen_projection.travel(points, lenses), expected, rtol=1e-9, atol=1e-12
    )
