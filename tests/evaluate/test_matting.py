import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from nlens_video.evaluate.coc.matting import matting_laplacian, spread_by_matting


def plain_laplacian(rgb, regularisation=1e-5):
    """Equation 12 of Levin et al. (2008), window by window and pair by pair."""
    height, width = rgb.shape[:2]
    result = np.zeros((height * width, height * width))
    for y in range(1, height - 1):
        for x in range(1, width - 1):
            at = [(y + j) * width + x + i for j in (-1, 0, 1) for i in (-1, 0, 1)]
            colours = rgb[y - 1 : y + 2, x - 1 : x + 2].reshape(9, 3).astype(np.float64)
            mean = colours.mean(0)
            covariance = (colours - mean).T @ (colours - mean) / 9
            inverse = np.linalg.inv(covariance + regularisation / 9 * np.eye(3))
            for i in range(9):
                for j in range(9):
                    likeness = (colours[i] - mean) @ inverse @ (colours[j] - mean)
                    result[at[i], at[j]] += (i == j) - (1 + likeness) / 9
    return result


def test_matting_laplacian_agrees_with_the_formula_pair_by_pair():
    rgb = np.random.default_rng(0).random((6, 8, 3), dtype=np.float32)
    np.testing.assert_allclose(matting_laplacian(rgb).toarray(), plain_laplacian(rgb), atol=1e-9)


pictures = arrays.arrays(
    np.float32, st.tuples(st.integers(3, 7), st.integers(3, 7), st.just(3)),
    elements=st.floats(0, 1, width=32),
)  # fmt: skip


@settings(deadline=None)
@given(pictures)
def test_matting_laplacian_is_symmetric_positive_and_blind_to_a_constant(rgb):
    dense = matting_laplacian(rgb).toarray()
    np.testing.assert_allclose(dense, dense.T, atol=1e-8)
    np.testing.assert_allclose(dense.sum(1), 0, atol=1e-8)
    assert np.linalg.eigvalsh((dense + dense.T) / 2).min() > -1e-8


def two_halves(scale=1, points=100):
    """A dark and a bright half, a little grain, and a value known at few pixels of each."""
    rng = np.random.default_rng(1)
    height, width = 60 * scale, 80 * scale
    right = np.arange(width) >= width // 2
    rgb = np.broadcast_to(np.where(right, 0.8, 0.2)[:, None], (height, width, 3))
    rgb = rgb + 0.001 * rng.standard_normal((height, width, 3))
    known = np.zeros((height, width), bool)
    known[rng.integers(0, height, points), rng.integers(0, width, points)] = True
    values = np.where(known, np.where(right, 7.0, 2.0), 99.0)
    return rgb.astype(np.float32), values.astype(np.float32), known


# A picture of 960x720 px is spread at a third of the size.
@pytest.mark.parametrize(
    ("scale", "points"), [(1, 100), pytest.param(12, 4000, marks=pytest.mark.slow)]
)
def test_known_values_spread_up_to_the_border_of_a_colour(scale, points):
    rgb, values, known = two_halves(scale, points)
    spread = spread_by_matting(rgb, values, known)
    middle, border = 40 * scale, 3 * scale
    assert spread.shape == known.shape
    assert np.abs(spread[:, : middle - border] - 2).max() < 0.3
    assert np.abs(spread[:, middle + border :] - 7).max() < 0.3


def test_values_known_everywhere_alike_stay_what_they_are():
    rgb = np.random.default_rng(2).random((30, 40, 3), dtype=np.float32)
    known = np.ones((30, 40), bool)
    spread = spread_by_matting(rgb, np.full((30, 40), 3.5, np.float32), known)
    np.testing.assert_allclose(spread, 3.5, atol=1e-5)
