"""How an object moves in the world that it shares: curves through keys, and its matrix."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.interpolate import PchipInterpolator

from nlens_video.scene.object_motion import Curve, ObjectMotion, turn_about_up

TIMES = st.lists(st.integers(0, 1000), min_size=2, max_size=8, unique=True).map(
    lambda times: np.array(sorted(times)) / 25.0
)


# Places in a scene; scipy divides by steps between numbers of 1e-300, and overflows.
NUMBERS = st.floats(-100.0, 100.0).map(lambda number: round(number, 9))


def keyed(data, times, width=3):
    values = st.lists(
        st.lists(NUMBERS, min_size=width, max_size=width),
        min_size=len(times), max_size=len(times),
    )  # fmt: skip
    return np.array(data.draw(values))


@given(TIMES, st.data())
def test_smooth_curve_is_scipys_pchip(times, data):
    values = keyed(data, times)
    curve, reference = Curve(times, values), PchipInterpolator(times, values)
    for time_s in np.linspace(times[0], times[-1], 41):
        np.testing.assert_allclose(curve.at(time_s), reference(time_s), rtol=1e-9, atol=1e-9)


@given(TIMES, st.data(), st.booleans())
def test_curve_never_leaves_the_range_of_the_two_keys_that_it_is_between(times, data, smooth):
    values = keyed(data, times)
    curve = Curve(times, values, smooth)
    for at in range(len(times) - 1):
        low, high = np.sort(values[at : at + 2], axis=0)
        for time_s in np.linspace(times[at], times[at + 1], 9):
            seen = curve.at(time_s)
            assert (seen >= low - 1e-9).all() and (seen <= high + 1e-9).all()


@pytest.mark.parametrize("smooth", [True, False])
def test_curve_is_held_before_the_first_key_and_after_the_last(smooth):
    curve = Curve(np.array([1.0, 2.0, 4.0]), np.array([[1.0], [5.0], [3.0]]), smooth)
    assert [curve.at(t)[0] for t in (-9.0, 1.0, 2.0, 4.0, 99.0)] == [1.0, 1.0, 5.0, 3.0, 3.0]


def test_linear_curve_is_halfway_between_keys_and_has_corners():
    curve = Curve(np.array([0.0, 1.0, 2.0]), np.array([[0.0], [2.0], [0.0]]), smooth=False)
    assert [curve.at(t)[0] for t in (0.5, 0.999, 1.001)] == pytest.approx([1.0, 1.998, 1.998])


def test_smooth_curve_has_no_jump_in_its_speed():
    curve = Curve(np.array([0.0, 1.0, 3.0]), np.array([[0.0], [2.0], [3.0]]))
    step = 1e-6
    before = (curve.at(1.0)[0] - curve.at(1.0 - step)[0]) / step
    after = (curve.at(1.0 + step)[0] - curve.at(1.0)[0]) / step
    assert before == pytest.approx(after, rel=1e-4) and before > 0.5


def test_matrix_puts_the_contact_point_on_its_place_turned_and_scaled():
    one = np.zeros(1)
    motion = ObjectMotion(
        contact=np.array([1.0, 2.0, 3.0]), axes=turn_about_up(0.7),
        place=Curve(one, np.array([[4.0, 5.0, 6.0]])), turn=Curve(one, np.full((1, 1), np.pi / 2)),
        scale=Curve(one, np.full((1, 1), 2.0)),
    )  # fmt: skip
    foot = motion.at(0.0) @ [1.0, 2.0, 3.0, 1.0]
    assert foot[:3] == pytest.approx(turn_about_up(0.7) @ [4.0, 5.0, 6.0])
    front = motion.at(0.0) @ [1.0, 2.0, 4.0, 1.0] - foot  # +Z turns to +X seen from above
    assert front[:3] == pytest.approx([2.0, 0.0, 0.0], abs=1e-12)
    assert not motion.moves
