"""The fit where F is not sure and the ground's texture tells nothing."""

import cv2
import numpy as np
import pytest
from support.textured_ground import filmed, scene, texture

from nlens_video.core.errors import LensFitError
from nlens_video.core.known_lens import UNKNOWN_LENS, Expected, LensPrior
from nlens_video.core.layers import CocMap
from nlens_video.core.placement import Region
from nlens_video.stages.f_coc import LARGEST_COC_PX
from nlens_video.stages.r_regression import FitLens
from nlens_video.stages.whole_ground.patches import reading_cells

TRUTH = (20.0, -14.0)


def readings(coc_px, sigma_px, luma):
    """What F reads, alike everywhere, off a picture."""
    maps = CocMap(
        coc_px=np.full(luma.shape, coc_px, np.float32),
        sigma_px=np.full(luma.shape, sigma_px, np.float32),
    )
    return CocMap(
        coc_px=maps.coc_px, sigma_px=maps.sigma_px, luma=luma,
        cells=reading_cells(maps, luma.shape[1]),
    )  # fmt: skip


def smooth(seen_by):
    """A ground of which a codec has left no noise."""
    return cv2.GaussianBlur(filmed(texture(1), TRUTH, seen_by), (0, 0), 1.5)


class Network:
    """Takes every ground to be seen through one lens; keeps the patches that it was asked about."""

    def __init__(self, ground, error=0.05):
        there = float(np.median(ground.disparity[ground.mask]))
        coc, slope = TRUTH[0] * there + TRUTH[1], TRUTH[0] * there
        told = (0.9, np.arcsinh(0.5 * coc), np.log(slope), error, error, 0.0)
        self.answer = np.float32([told, (0.1, 0.0, 3.0, 1.0, 1.0, 0.0)])
        self.asked = []

    def __call__(self, patches):
        self.asked.append(patches)
        return self.answer


def fitted(coc, network, **more):
    seen_by, ground = scene()
    known = UNKNOWN_LENS.prior(seen_by.fx, seen_by.width, 1.0)
    return FitLens(network=network, **more)(coc, ground, known=known).fit


def coc_error(fit, ground):
    there = float(np.median(ground.disparity[ground.mask]))
    return abs(fit.slope * there + fit.intercept - (TRUTH[0] * there + TRUTH[1]))


def test_ground_without_noise_is_read_by_the_network():
    seen_by, ground = scene()
    misled = readings(2.5, 4.0, smooth(seen_by))
    alone, both = fitted(misled, None), fitted(misled, Network(ground))
    assert coc_error(alone, ground) > 2.0
    assert coc_error(both, ground) < 0.7
    assert both.method.endswith("with the lens network") and "network" not in alone.method
    there = float(np.median(ground.disparity[ground.mask]))
    assert both.coc_stderr_px(there) < alone.coc_stderr_px(there)


def test_network_stands_for_the_readings():
    """It has seen the same; how sure these are of another lens does not count."""
    seen_by, ground = scene()
    luma = smooth(seen_by)
    one, other = (fitted(readings(2.5, sigma, luma), Network(ground)) for sigma in (1.5, 4.0))
    assert coc_error(one, ground) < 0.7
    assert (one.slope, one.intercept) == pytest.approx((other.slope, other.intercept), abs=1e-6)


def test_lens_that_is_given_counts_beside_the_network():
    seen_by, ground = scene()
    luma, errors = smooth(seen_by), {}
    for slope_error in (0.2, 20.0):
        known = LensPrior(slope=Expected(1.5 * TRUTH[0], slope_error))
        coc, network = readings(2.5, 4.0, luma), Network(ground, error=0.2)
        fit = FitLens(network=network)(coc, ground, known=known).fit
        errors[slope_error] = abs(fit.slope - 1.5 * TRUTH[0])
    assert errors[0.2] < 1.0 < errors[20.0]


@pytest.mark.parametrize("prefer", ["near", "far"])
def test_side_that_is_given_stays(prefer):
    seen_by, ground = scene()
    known = LensPrior(prefer=prefer)
    coc = readings(3.0, 4.0, smooth(seen_by))
    alone, both = (
        FitLens(network=network)(coc, ground, known=known).fit
        for network in (None, Network(ground))
    )
    there = float(np.median(ground.disparity[ground.mask]))
    side, coc = (fit.slope * there + fit.intercept for fit in (alone, both))
    assert alone.sign == both.sign == "assumed"
    assert both.method.endswith("with the lens network")
    assert np.sign(side) == (-1.0 if prefer == "near" else 1.0)
    if prefer == "near":  # the network's first lens focuses before the object, the second on it
        assert coc == pytest.approx(TRUTH[0] * there + TRUTH[1], abs=0.3)
    else:
        assert coc == pytest.approx(0.0, abs=0.1)


def test_other_lens_of_the_network_stays_open():
    seen_by, ground = scene()
    there = float(np.median(ground.disparity[ground.mask]))
    network = Network(ground, error=0.3)
    network.answer = network.answer.copy()
    network.answer[:, :] = network.answer[0]
    network.answer[1, :2] = 0.8, -network.answer[0, 1]
    fit = fitted(readings(2.5, 4.0, smooth(seen_by)), network)
    assert fit.sign == "ambiguous"
    one, other = (slope * there + of for slope, of in ((fit.slope, fit.intercept), fit.other))
    assert one == pytest.approx(-other, abs=0.2)


def test_network_is_not_asked_where_the_readings_are_sure():
    seen_by, ground = scene()
    there = np.abs(TRUTH[0] * ground.disparity + TRUTH[1]).astype(np.float32)
    sure = readings(1.0, 0.2, smooth(seen_by))
    sure = CocMap(coc_px=there, sigma_px=sure.sigma_px, luma=sure.luma, cells=sure.cells)
    network = Network(ground)
    fit = fitted(sure, network)
    assert not network.asked and "network" not in fit.method


def test_network_is_not_asked_where_the_texture_tells_the_lens():
    seen_by, ground = scene()
    network = Network(ground)
    fit = fitted(readings(0.5, 0.7, filmed(texture(1), TRUTH, seen_by)), network)
    assert not network.asked and fit.method.endswith("with the ground's texture")


def test_network_is_not_asked_about_a_plain_ground():
    """F states its largest CoC as the error where a picture has no contrast."""
    seen_by, ground = scene()
    luma = np.full((seen_by.height, seen_by.width), 0.5, np.float32)
    network = Network(ground)
    with pytest.raises(LensFitError):
        fitted(readings(2.5, LARGEST_COC_PX, luma), network)
    assert not network.asked


def test_network_is_not_asked_about_a_ground_that_reads_as_sharp_all_over():
    """As pure noise does; F cannot tell such a blur from the softness of a lens."""
    seen_by, ground = scene()
    network = Network(ground)
    fit = fitted(readings(1.2, 4.0, smooth(seen_by)), network)
    assert not network.asked and "network" not in fit.method


def test_network_sees_the_region_alone():
    seen_by, ground = scene()
    left = Region(((0.0, 0.0), (0.5, 0.0), (0.5, 1.0), (0.0, 1.0)))
    network = Network(ground)
    fitted(readings(2.5, 1.5, smooth(seen_by)), network, region=left)
    (patches,) = network.asked
    assert (patches.places[:, 4] < 0.0).all()


def test_maps_without_cells_are_fitted_by_the_readings():
    seen_by, ground = scene()
    known = readings(2.5, 1.5, smooth(seen_by))
    bare = CocMap(coc_px=known.coc_px, sigma_px=known.sigma_px, luma=known.luma)
    network = Network(ground)
    assert fitted(bare, network) == fitted(known, None)
    assert not network.asked
