"""Integrals by importance sampling, against densities whose integrals are known."""

import math

import numpy as np
import pytest

from nlens_video.solve.still.sampling import integrate, nearest_to_all, one_errors

TURN = np.array([[0.8, -0.6], [0.6, 0.8]])
COVARIANCE = TURN @ np.diag([0.3**2, 0.02**2]) @ TURN.T
MIDDLE = np.array([0.2, -0.1])


def log_normal(places):
    off = places - MIDDLE
    return -0.5 * np.einsum("ni,ij,nj->n", off, np.linalg.inv(COVARIANCE), off)


@pytest.mark.parametrize("start", [0.01, 1.0])
def test_normal_density_has_its_integral_and_its_spread(start):
    found = integrate(log_normal, np.zeros(2), start * np.eye(2))
    assert found.weights.sum() == pytest.approx(1.0)
    known = 0.5 * np.linalg.slogdet(2.0 * math.pi * COVARIANCE)[1]
    assert found.log_integral == pytest.approx(known, abs=0.1)
    np.testing.assert_allclose(found.weights @ found.places, MIDDLE, atol=0.04)
    off = found.places - MIDDLE
    np.testing.assert_allclose(off.T @ (found.weights[:, None] * off), COVARIANCE, atol=0.015)


def test_ridge_that_is_flat_at_its_mode_keeps_its_width():
    def log_box(places):
        return -0.5 * (places[:, 1] / 0.05) ** 2 - 30.0 * (abs(places[:, 0]) > 1.0)

    found = integrate(log_box, np.array([0.9, 0.0]), 0.05**2 * np.eye(2))
    spread = math.sqrt(found.weights @ found.places[:, 0] ** 2)
    assert spread == pytest.approx(1.0 / math.sqrt(3.0), rel=0.2)


def test_draws_are_the_same_each_time():
    one, other = (integrate(log_normal, np.zeros(2), np.eye(2)) for _ in range(2))
    np.testing.assert_array_equal(one.places, other.places)


def test_place_nearest_to_all_is_in_the_larger_mode_and_not_between():
    rng = np.random.default_rng(1)
    places = np.concatenate([rng.normal(0.0, 0.1, (120, 2)), rng.normal(5.0, 0.1, (80, 2))])
    candidates = np.array([[2.0, 2.0], [5.0, 5.0], [0.0, 0.0]])
    found = nearest_to_all(candidates, places, np.full(200, 1.0 / 200), np.array([0.3, 0.3]))
    assert np.linalg.norm(found) < 0.2


def test_one_error_holds_as_much_as_a_normal_one():
    off = np.random.default_rng(2).normal(0.0, (1.0, 3.0), (20000, 2))
    np.testing.assert_allclose(one_errors(off, np.full(20000, 1 / 20000)), (1.0, 3.0), rtol=0.03)
