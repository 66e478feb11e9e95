import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from nlens_video.stages.whole_ground.network_reading import FEWEST, lenses_of, read_by_network
from nlens_video.stages.whole_ground.patches import Patches


def answer(*lenses):
    return np.float32(lenses)


@given(
    st.floats(-4.0, 4.0), st.floats(-2.0, 5.0), st.floats(0.01, 100.0), st.floats(0.2, 4.0)
)  # fmt: skip
def test_lens_has_the_coc_and_the_slope_of_the_answer(a, b, middle, scale):
    (lens,) = [one.scaled(scale) for one in lenses_of(answer((1.0, a, b, 0.1, 0.1, 0.0)), middle)]
    at_object = lens.slope * middle + lens.intercept
    size = scale * (1.0 + np.exp(abs(a)) + np.exp(b))
    assert at_object == pytest.approx(scale * 2.0 * np.sinh(a), abs=1e-5 * size)
    assert lens.slope * middle == pytest.approx(scale * np.exp(b), rel=1e-5)


def test_likeliest_lens_comes_first():
    shares = [0.2, 0.5, 0.3]
    lenses = lenses_of(answer(*((share, -share, 2, 0.1, 0.1, 0) for share in shares)), 1.0)
    assert [lens.slope + lens.intercept for lens in lenses] == pytest.approx(
        [2.0 * np.sinh(-share) for share in (0.5, 0.3, 0.2)], rel=1e-5
    )
    # twice the logarithm of how many times less likely
    assert [lens.unlikelier for lens in lenses] == pytest.approx(
        [2.0 * np.log(0.5 / share) for share in (0.5, 0.3, 0.2)], abs=1e-5
    )


@pytest.mark.parametrize("correlation", [-0.8, 0.0, 0.6])
def test_errors_are_twice_those_of_lenses_drawn_from_the_answer(correlation):
    a, b, of_a, of_b, middle = 1.2, 2.5, 0.02, 0.03, 0.7
    (lens,) = lenses_of(answer((1.0, a, b, of_a, of_b, correlation)), middle)
    covariance = of_a * of_b * np.array(
        [[of_a / of_b, correlation], [correlation, of_b / of_a]]
    )  # fmt: skip
    drawn = np.random.default_rng(0).multivariate_normal([a, b], covariance, 200_000)
    slope = np.exp(drawn[:, 1]) / middle
    intercept = 2.0 * np.sinh(drawn[:, 0]) - slope * middle
    expected = 4.0 * np.cov(slope, intercept)  # errors are twice those that the network states
    np.testing.assert_allclose(lens.covariance, expected, rtol=0.03)


def patches(count, value=0.0):
    return Patches(
        readings=np.full((count, 3), value, np.float32), places=np.zeros((count, 6), np.float32)
    )


@pytest.mark.parametrize("ground", [patches(FEWEST - 1), patches(FEWEST, np.nan)])
def test_ground_that_is_hardly_seen_or_holds_no_numbers_is_not_read(ground):
    def network(_):
        raise AssertionError("read")

    assert read_by_network(network, ground, 1.0) == ()


def test_ground_is_read_by_the_network():
    told = read_by_network(lambda _: answer((1.0, 0.0, 3.0, 0.1, 0.1, 0.0)), patches(FEWEST), 2.0)
    assert [lens.slope for lens in told] == pytest.approx([np.exp(3.0) / 2.0], rel=1e-5)
