"""Fits on samples with many outliers or of ambiguous sign."""

import numpy as np
from hard.catalogue import Outcome, at_least, at_most, case, exactly
from hard.drawing import OTHER, OURS, PALE, plot
from support.planes import of_map

from nlens_video.core.errors import LensFitError
from nlens_video.core.layers import CocMap
from nlens_video.stages.p_projection import GroundProjection
from nlens_video.stages.r_regression import FitLens

ROWS, COLUMNS = 128, 240
SLOPE, FOCUS = 40.0, 0.5


def _ground(far: float = 0.0) -> GroundProjection:
    rows = far + (1.0 - far) * (np.arange(ROWS) - 20) / (ROWS - 20)
    disparity = np.repeat(rows[:, None], COLUMNS, axis=1)
    mask = np.zeros((ROWS, COLUMNS), bool)
    mask[70:90, 90:150] = True
    return GroundProjection(mask=mask, disparity_of=of_map(disparity), ground_y=0.0)


def _true(plane: GroundProjection, focus: float = FOCUS) -> np.ndarray:
    return np.abs(SLOPE * (plane.disparity - focus)).astype(np.float32)


def _fit(coc: np.ndarray, plane: GroundProjection):
    return FitLens()(CocMap(coc_px=coc, sigma_px=np.full_like(coc, 0.5)), plane)


def _samples_and_line(regression, wrong: str, *, lens: bool = True):
    fit, samples = regression.fit, regression.samples

    def draw(axes):
        rng = np.random.default_rng(0)
        some = rng.choice(len(samples.coc_px), 1500, replace=False)
        axes.plot(samples.disparity[some], samples.coc_px[some], ".", ms=2, color=PALE, label=wrong)
        x = np.linspace(0, 1, 200)
        if lens:
            axes.plot(x, np.abs(SLOPE * (x - FOCUS)), color=OTHER, lw=3, label="the lens")
        axes.plot(x, np.abs(fit.slope * x + fit.intercept), color=OURS, lw=1, label="the fit")

    return lambda: plot(draw, x="disparity [1 / unit]", y="|CoC| [px]")


@case
def test_random_outliers():
    """With 60 % of the samples anything from 0 to 40 px, the fit is that of the other 40 %."""
    plane, offs = _ground(), []
    for seed in range(5):
        rng = np.random.default_rng(seed)
        coc = _true(plane) + rng.normal(0, 0.3, plane.disparity.shape).astype(np.float32)
        wrong = rng.random(coc.shape) < 0.6
        coc[wrong] = rng.uniform(0, 40, int(wrong.sum()))
        found = _fit(np.abs(coc).astype(np.float32), plane)
        line = found.fit.coc_px(np.array([0.2, 0.8], np.float32))
        offs.append(np.abs(line - SLOPE * (np.array([0.2, 0.8]) - FOCUS)).max())
    return Outcome(
        (
            at_most("CoC at disparities 0.2 and 0.8, off by [px], worst of 5", max(offs), 0.5),
            at_most("share of the samples that it keeps", found.fit.inlier_fraction, 0.5),
        ),
        _samples_and_line(found, "samples, 60 % of them anything"),
    )


@case
def test_consistent_outliers():
    """With 60 % of the plane at the blur of a wall, the ground under the object decides."""
    plane = _ground()
    coc = _true(plane)
    wall = np.random.default_rng(1).random(COLUMNS) < 0.6
    wall[90:150] = False
    wall[:90] = wall[186:] = True
    coc[:, wall] = 22.0
    found = _fit(coc, plane)
    line = found.fit.coc_px(np.array([0.2, 0.8], np.float32))
    off = np.abs(line - SLOPE * (np.array([0.2, 0.8]) - FOCUS)).max()
    return Outcome(
        (
            at_least("share of the plane that is a wall", float(wall.mean()), 0.59),
            at_most("CoC at disparities 0.2 and 0.8, off by [px]", off, 0.6),
        ),
        _samples_and_line(found, "samples, 60 % of them a wall of 22 px"),
    )


@case
def test_ambiguous_sign_of_the_coc():
    """A ground of a tiny span of disparity: the blur is right, the sign is called ambiguous."""
    plane = _ground(far=0.985)
    rng = np.random.default_rng(3)
    offs, signs, margins = [], [], []
    for level in (4.0, 8.0, 20.0):
        coc = np.abs(level + rng.normal(0, 0.4, plane.disparity.shape)).astype(np.float32)
        fit = _fit(coc, plane).fit
        offs.append(abs(abs(fit.slope + fit.intercept) - level))
        signs.append(fit.sign)
        margins.append(fit.sign_margin)

    def draw(axes):
        x = np.linspace(0, 1.05, 100)
        axes.plot(x, np.abs(fit.slope * x + fit.intercept), color=OURS, label="the fit")
        other = 20.0 + fit.slope * (1.0 - x)
        axes.plot(x, np.abs(other), "--", color=OTHER, label="of the other sign")
        axes.axvspan(0.985, 1.0, color=PALE, label="what the ground shows")

    return Outcome(
        (
            at_most("blur of the ground, off by [px], worst of 3", max(offs), 0.5),
            exactly("signs", " and ".join(sorted(set(signs))), "ambiguous"),
            at_most("margin between the signs", max(margins), 0.5),
        ),
        lambda: plot(draw, x="disparity [1 / unit]", y="|CoC| [px]"),
    )


@case
def test_plate_of_constant_blur():
    """A plate with one blur all over, at any depth, gets that blur for the object."""
    plane = _ground()
    coc = np.full(plane.disparity.shape, 6.0, np.float32)
    found = _fit(coc, plane)
    there = abs(float(found.fit.coc_px(np.float32(0.55))))
    return Outcome(
        (
            at_most("CoC under the object, off by [px]", abs(there - 6.0), 0.5),
            at_least("slope [px unit]", found.fit.slope, 0.0),
        ),
        _samples_and_line(found, "samples", lens=False),
    )


@case
def test_focus_in_the_middle_of_the_footprint():
    """A focus that runs through the footprint itself is found, on both arms of the V."""
    plane = _ground()
    offs = []
    for focus in np.linspace(0.47, 0.63, 9):
        rng = np.random.default_rng(2)
        coc = np.abs(_true(plane, focus) + rng.normal(0, 0.4, plane.disparity.shape))
        found = _fit(coc.astype(np.float32), plane)
        offs.append(abs(found.fit.focus_disparity - focus))

    def draw(axes):
        axes.plot(np.linspace(0.47, 0.63, 9), offs, "o-", color=OURS, label="focus, off by")

    return Outcome(
        (at_most("disparity in focus, off by, worst of 9", max(offs), 0.01),),
        lambda: plot(draw, x="disparity in focus [1 / unit]", y="off by [1 / unit]"),
    )


@case
def test_samples_of_extreme_coc():
    """A CoC of 1e30 px, or of infinity, in a tenth of the samples does not affect the fit."""
    plane, figures = _ground(), []
    for wild in (1e4, 1e30, np.inf):
        coc = _true(plane)
        coc[:, ::10] = wild
        try:
            found = _fit(coc, plane)
            off = abs(float(found.fit.coc_px(np.float32(0.8))) - SLOPE * 0.3)
        except LensFitError:
            off = np.inf
        figures.append(at_most(f"CoC, off by [px], a tenth at {wild:g} px", off, 0.3))
    return Outcome(tuple(figures), _samples_and_line(found, "samples, without those at infinity"))
