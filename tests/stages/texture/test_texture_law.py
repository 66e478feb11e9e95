"""The law of the power that a texture shows."""

import numpy as np
import pytest
from scipy.special import j1
from support.textured_ground import camera, disc

from nlens_video.stages.texture.law import DIRECTIONS, MAGNITUDES, TextureLaw, Unknowns, log_disc
from nlens_video.stages.texture.solver import Bands, TextureSolver
from nlens_video.stages.texture.spectra import ground_spectra


def test_disc_leaves_the_power_of_its_bessel_function():
    cycles = np.linspace(0.01, 8.0, 200)
    x = np.pi * cycles * np.array([0.85, 0.95, 1.05, 1.15])[:, None]
    expected = np.square(2.0 * j1(x) / x).mean(axis=0)
    assert log_disc(cycles) == pytest.approx(np.log(expected + 1e-6), abs=3e-3)  # of a table


def test_disc_leaves_the_power_that_a_drawn_one_leaves():
    kernel = disc(9.0, 16)
    padded = np.zeros((512, 512))
    padded[: len(kernel), : len(kernel)] = kernel
    power = np.square(np.abs(np.fft.rfft2(padded)[0]))
    low = slice(1, int(512 * 0.7 / 9.0))  # before the first zero, which a mean over sizes fills
    frequency = np.arange(len(power))[low] / 512
    assert log_disc(9.0 * frequency) == pytest.approx(np.log(power[low]), abs=0.15)


def test_nothing_is_taken_where_there_is_no_blur():
    assert log_disc(np.zeros(3)) == pytest.approx(0.0, abs=1e-5)


def test_largest_blur_is_within_the_table():
    assert np.isfinite(log_disc(np.array([0.0, 26.9, 27.0, 1e6]))).all()


def places():
    picture = np.float32(0.5 + 0.02 * np.random.default_rng(1).standard_normal((400, 640)))
    bins, patches = ground_spectra(picture, camera(), 0.0)
    return bins, patches


def test_texture_between_knots_is_their_weighted_mean():
    law = TextureLaw(*places())
    knots = np.random.default_rng(2).standard_normal(MAGNITUDES * DIRECTIONS)
    assert law.texture(knots) == pytest.approx(law.design() @ knots)
    assert law.texture(np.ones_like(knots)) == pytest.approx(1.0)


def test_derivative_by_every_unknown_is_that_of_the_power():
    bins, patches = places()
    some = np.linspace(0, len(patches.disparity) - 1, 10).astype(int)
    spectra = type(patches)(
        disparity=patches.disparity[some],
        stretch=patches.stretch[some],
        log_power=patches.log_power[some],
    )
    bands = Bands(
        spectra=spectra, error=np.full_like(spectra.log_power, 0.3), patches=np.full(10, 9.0)
    )
    solver = TextureSolver(bins, bands)
    rng = np.random.default_rng(3)
    vector = solver._begin(30.0, -9.0)
    vector[:-2] += 0.2 * rng.standard_normal(len(vector) - 2)
    seen, whole = solver._power(vector)
    found = solver._jacobian(Unknowns.of(vector), np.exp(seen - whole))
    for one in rng.choice(len(vector), 30, replace=False).tolist() + [len(vector) - 2, -1]:
        step = np.zeros(len(vector))
        step[one] = 1e-4 * max(1.0, abs(vector[one]))
        rise = solver._power(vector + step)[1] - solver._power(vector - step)[1]
        numeric = (rise / (2.0 * step[one])).ravel()
        # that by the lens is a quotient over 0.3 px
        tolerance = 0.05 * np.abs(numeric).max() + 1e-6
        assert np.abs(found[:, one] - numeric).max() <= tolerance, one
