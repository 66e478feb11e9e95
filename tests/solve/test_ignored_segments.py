import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from nlens_video.solve.still.segments import NO_SEGMENTS, Segments

WIDTH = 1000
points = st.tuples(st.floats(0, WIDTH), st.floats(0, 600))
lines = st.tuples(points, points)


def segments(*ends):
    return Segments(np.array(ends, float).reshape(-1, 2, 2), np.ones(len(ends)))


def far_by_steps(end, first, last):
    """Distance of a point from a segment, by many points on it."""
    shares = np.linspace(0.0, 1.0, 2001)[:, None]
    on = np.array(first) + shares * (np.array(last) - first)
    return np.linalg.norm(on - end, axis=1).min()


@given(one=lines, other=lines)
def test_segment_along_another_is_left_out(one, other):
    far = max(far_by_steps(end, *other) for end in one)
    left = segments(one).without(np.array([other]), WIDTH)
    if abs(far - 0.01 * WIDTH) > 1.0:
        assert len(left.ends) == (far > 0.01 * WIDTH)


def test_segments_that_cross_it_or_go_on_beyond_it_stay():
    along, crossing, beyond = ((10, 10), (90, 12)), ((50, -40), (50, 60)), ((60, 10), (300, 10))
    found = segments(along, crossing, beyond).without(np.array([((0, 10), (100, 10))]), WIDTH)
    np.testing.assert_array_equal(found.ends, np.array([crossing, beyond], float))
    assert found.error_px.shape == (2,)


def test_nothing_is_left_out_by_nothing():
    one = segments(((0, 0), (50, 50)))
    np.testing.assert_array_equal(one.without(np.zeros((0, 2, 2)), WIDTH).ends, one.ends)
    assert len(NO_SEGMENTS.without(one.ends, WIDTH).ends) == 0
