"""What the texture of the ground tells of the lens, and how sure.

F reads the blur place by place. It takes a pattern that is soft in itself for a blurred one, fine
grain for a sharp one, and noise on a plain ground for sharpness. But a ground shows much the same
texture everywhere: where it is nearer the pattern is larger, by a law that the camera tells, and
where it is farther from the focal plane it is blurrier, by the lens model. So the whole plane tells
one spectrum and one lens (`law`). Noise that is white, as that of a sensor, is told from texture;
what a codec or a denoiser left is not, and such a picture is not read.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from msgspec.structs import replace

from nlens_video.core.layers import Float32, Float64
from nlens_video.scene.camera import Camera
from nlens_video.stages.texture.candidates import Candidate, Lens, find_candidates
from nlens_video.stages.texture.ground_lens import GroundLens
from nlens_video.stages.texture.solver import SOFTNESS, USUAL_SOFTNESS_PX
from nlens_video.stages.texture.spectra import Part, fall_of_the_finest, ground_spectra

_FEWEST = 40  # patches
_PLAIN = 0.01  # power of a picture without noise or texture, below that of rounding [code value^2]
_NOISE_BANDS, _FLAT_BANDS = 8, 3  # parts of the ground, by disparity; those that show the noise
_LEAST_FALL = -0.15  # of the finest detail in which noise is white
# measured on rendered plates (docs/evaluation/lens-fit.md)
_ALIKE = 8.0  # squared errors of patches that count as one: patches overlap, and err alike
_READINGS = 1.5  # errors by those that the solver states
_FLAT, _FLAT_T2 = 28.0, 4.0  # their variance grows by a / (b + t^2), t: the slope by its error
_LEAST_ERROR_PX, _RELATIVE_ERROR = 0.075, 0.07  # of a ground that is alike everywhere
_FINE_COST = 0.25  # of such a ground, by the number of values
_MOST_UNEVEN = (
    0.9  # deviation of the gains, beyond which other things are seen, such as in a mirror
)
_GUESS_PX, _GUESS = 2.5, 0.1  # error of a guess, by itself or by the CoC
_GAIN, _SOFTNESS = 0.07, 2.5  # of the gains, and of the softness in its own, that as much again
_LEVER = 0.5  # change of the disparity, by itself, over which the CoC errs by as much again


def read_texture(
    luma: Float32, camera: Camera, ground_y: float, middle: float, begin: Sequence[Lens] = (),
    part: Part | None = None,
) -> tuple[GroundLens, ...]:  # fmt: skip
    """Lenses by which the texture of the ground may have been seen, the likeliest first.

    None where the picture shows little ground, contrasts that differ as those of a mirror do, noise
    that is not white, or values that are no numbers.

    Args:
        luma: the picture, display-coded [code value, 0 to 1] (H, W).
        camera: of a picture of this size.
        ground_y: height of the ground [scene unit].
        middle: disparity of the ground where the object stands, > 0 [1 / scene unit].
        begin: lenses that are looked at beside a grid.
        part: of the picture that is looked at, None for all of it.
    """
    if not np.isfinite(luma).all():
        return ()
    bins, patches = ground_spectra(luma, camera, ground_y, part)
    if len(patches.disparity) < _FEWEST:
        return ()
    if np.exp(patches.log_power.mean(axis=0).max()) < _PLAIN:
        return ()
    parts = np.array_split(np.argsort(patches.disparity, kind="stable"), _NOISE_BANDS)
    falls = sorted(fall_of_the_finest(bins, patches.log_power[part]) for part in parts)
    if falls[-_FLAT_BANDS] < _LEAST_FALL:
        return ()
    # in units of the object's distance: none of the numbers below depends on the scene's
    patches = replace(
        patches, disparity=patches.disparity / middle, stretch=patches.stretch / middle
    )
    # the farther the ground, the likelier it is no longer the plane on which the object stands
    near = np.minimum(patches.disparity, 1.0) ** 2
    found = find_candidates(
        bins, patches, near, [(slope * middle, intercept) for slope, intercept in begin]
    )
    if _gain_deviation(found[0]) > _MOST_UNEVEN or not _tells(found[0]):
        return ()
    to_scene = np.diag([1.0 / middle, 1.0])
    return tuple(
        GroundLens(
            slope=one.solution.unknown.slope / middle,
            intercept=one.solution.unknown.intercept,
            covariance=to_scene @ _stated_covariance(one) @ to_scene,
            unlikelier=(one.off - found[0].off) / _ALIKE,
        )
        for one in found
    )


def _tells(candidate: Candidate) -> bool:
    """Whether the CoC at the object is told to better than what a guess errs by."""
    lens = candidate.solution.unknown
    error = math.sqrt(float(_stated_covariance(candidate).sum()))
    return error <= max(_GUESS_PX, _GUESS * abs(lens.slope + lens.intercept))


def _gain_deviation(candidate: Candidate) -> float:
    """Standard deviation of the logarithm of the contrast along the ground."""
    gain, patches = candidate.solution.unknown.gain, candidate.solver.patches
    mean = np.average(gain, weights=patches)
    return math.sqrt(float(np.average(np.square(gain - mean), weights=patches)))


def _stated_covariance(candidate: Candidate) -> Float64:
    """Covariance of slope and intercept with what a ground that is not alike everywhere adds.

    In units in which the disparity is 1 where the object stands.

    Such a ground shows: values are off, contrasts differ, or the softness is unusual.
    """
    solver, found = candidate.solver, candidate.solution
    unknown, own = found.unknown, found.covariance
    gain = _gain_deviation(candidate) / _GAIN
    soft = (unknown.softness - math.log(USUAL_SOFTNESS_PX)) / SOFTNESS / _SOFTNESS
    misfit = max(1.0, found.cost / solver.size / _FINE_COST) ** 0.7
    error = _LEAST_ERROR_PX * misfit * math.sqrt(1.0 + gain**2 + soft**2)
    error = math.hypot(error, _RELATIVE_ERROR * (unknown.slope + unknown.intercept))
    flat = 1.0 + _FLAT / (_FLAT_T2 + unknown.slope**2 / max(own[0, 0], 1e-300))
    # errors of the slope and of the CoC at the object, apart
    to_intercept = np.array([[1.0, 0.0], [-1.0, 1.0]])
    of_law = np.diag([(error / _LEVER) ** 2, error**2])
    return np.asarray(_READINGS**2 * flat * own + to_intercept @ of_law @ to_intercept.T)
