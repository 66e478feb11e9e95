"""Spectra of the ground's texture: power by frequency of patches of the plate.

A patch is a square of the picture in which the ground's depth is about constant. Its power is
averaged in bins of the picture's frequency, by magnitude and direction.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from msgspec import Struct
from numpy.lib.stride_tricks import sliding_window_view

from nlens_video.core.layers import Bool, Float32, Float64
from nlens_video.scene.camera import Camera

SIDE_PX = 48
"""Side of a patch."""
_MAGNITUDES, _DIRECTIONS = 14, 9  # bins of the frequency
_STEP_PX = SIDE_PX // 2
_LOWEST = 1.8 / SIDE_PX  # frequency: below it the window shows its own spectrum [1 / px]
_HIGHEST = 0.5  # [1 / px]
_LEAST_POWER = 1e-6  # of a patch without any contrast [code value^2]
_FINE, _FINEST = (0.27, 0.36), 0.40  # frequencies whose power is compared [1 / px]


class Bins(Struct, frozen=True, kw_only=True, eq=False):
    """Bins of the frequency; all arrays (M,).

    Attributes:
        magnitude: mean over the bin [1 / px].
        direction: its middle, 0 to pi from the columns' axis towards the rows' [rad].
        cells: frequencies in the bin; the window makes neighbours alike.
    """

    magnitude: Float64
    direction: Float64
    cells: Float64

    @property
    def vector(self) -> Float64:
        """Frequencies along columns and rows (M, 2) [1 / px]."""
        across, down = np.cos(self.direction), np.sin(self.direction)
        return np.stack([across, down], axis=1) * self.magnitude[:, None]

    @property
    def log_bias(self) -> Float64:
        """By which the mean of the logarithm lies below the logarithm of the mean (M,)."""
        return np.asarray(0.5 / self.cells)

    @property
    def log_variance(self) -> Float64:
        """Variance of the logarithm of a mean over a bin (M,): the trigamma function."""
        count = self.cells
        return np.asarray(1.0 / count + 0.5 / count**2 + 1.0 / (6.0 * count**3))


class Spectra(Struct, frozen=True, kw_only=True, eq=False):
    """Spectra of places of the ground, P patches or means of several.

    Attributes:
        disparity: at the middle (P,) [1 / scene unit].
        stretch: change of the pixel position by that of the place on the ground (P, 2, 2)
            [px / scene unit].
        log_power: logarithm of the mean power (P, M) [code value^2].
    """

    disparity: Float64
    stretch: Float64
    log_power: Float64


Part = Callable[[Float64, Float64], Bool]
"""Whether places, columns and rows of the same shape [px], lie in a part of the picture."""


def ground_spectra(
    luma: Float32, camera: Camera, ground_y: float, part: Part | None = None
) -> tuple[Bins, Spectra]:
    """Spectra of all patches of a picture that lie below the horizon.

    Args:
        luma: the picture, display-coded [code value, 0 to 1] (H, W).
        camera: of a picture of this size.
        ground_y: height of the ground [scene unit].
        part: in which their corners lie, None for the whole picture.
    """
    bins, cells = _bins()
    height, width = luma.shape
    if min(height, width) < SIDE_PX:
        return bins, Spectra(
            disparity=np.empty(0), stretch=np.empty((0, 2, 2)), log_power=np.empty((0, len(cells)))
        )
    rows = np.arange(0, height - SIDE_PX + 1, _STEP_PX)
    columns = np.arange(0, width - SIDE_PX + 1, _STEP_PX)
    places = [(columns + across, rows + down) for across in (0, SIDE_PX) for down in (0, SIDE_PX)]
    # the plane's disparity is affine in the pixel position: the corners tell whether it is seen
    corners = [camera.disparity_at(1.0 * x, 1.0 * y, ground_y) for x, y in places]
    seen = np.min(corners, axis=0) > 0.0
    if part is not None:
        for x, y in places:
            seen &= part(*np.meshgrid(1.0 * x, 1.0 * y))
    row, column = (grid[seen] for grid in np.meshgrid(rows, columns, indexing="ij"))
    middle = np.stack([column, row], axis=1) + 0.5 * SIDE_PX
    windows = sliding_window_view(luma, (SIDE_PX, SIDE_PX))[row, column]
    return bins, Spectra(
        disparity=np.mean(corners, axis=0)[seen],
        stretch=_stretch(camera, middle, ground_y),
        log_power=np.log(_power(windows) @ cells.T + _LEAST_POWER),
    )


def fall_of_the_finest(bins: Bins, log_power: Float64) -> float:
    """Change of the log power from fine to the finest detail, 0 for white noise [1].

    What a camera, a denoiser or a codec has smoothed falls off there.
    """
    fine = (bins.magnitude > _FINE[0]) & (bins.magnitude < _FINE[1])
    finest = bins.magnitude > _FINEST
    return float(np.median(log_power[:, finest]) - np.median(log_power[:, fine]))


def _power(windows: Float32) -> Float64:
    """Power of patches (P, N, N), without their mean and slope, by cell (P, N * (N / 2 + 1))."""
    count, side = len(windows), SIDE_PX
    ramp = (np.arange(side) - 0.5 * (side - 1)) / side
    ones = np.ones(side)
    pairs = (ones, ones), (ones, ramp), (ramp, ones)
    plane = np.stack([np.outer(down, across).ravel() for down, across in pairs])
    flat = 255.0 * windows.reshape(count, side * side).astype(np.float64)
    flat -= (flat @ np.linalg.pinv(plane)) @ plane
    taper = np.hanning(side + 1)[:-1]
    window = np.outer(taper, taper)
    window /= np.sqrt(np.square(window).sum())
    found = np.fft.rfft2(flat.reshape(count, side, side) * window)
    return np.square(np.abs(found)).reshape(count, found.shape[1] * found.shape[2])


def _bins() -> tuple[Bins, Float64]:
    """The bins, and the share of each cell of the spectrum in each of them (M, cells)."""
    across, down = np.meshgrid(np.fft.rfftfreq(SIDE_PX), np.fft.fftfreq(SIDE_PX))
    magnitude = np.hypot(across, down)
    used = (magnitude >= _LOWEST) & (magnitude < _HIGHEST) & ((across > 0.0) | (down > 0.0))
    edges = np.geomspace(_LOWEST, _HIGHEST, _MAGNITUDES + 1)
    ring = np.searchsorted(edges, magnitude, side="right") - 1
    turn = np.arctan2(down, across) % math.pi / math.pi
    sector = np.floor(turn * _DIRECTIONS).astype(np.int64) % _DIRECTIONS
    number = np.where(used, ring * _DIRECTIONS + sector, -1).ravel()
    present = np.unique(number[number >= 0])
    cells = (number == present[:, None]).astype(np.float64)
    count = cells.sum(axis=1)
    cells /= count[:, None]
    return Bins(
        magnitude=cells @ magnitude.ravel(),
        direction=(present % _DIRECTIONS + 0.5) / _DIRECTIONS * math.pi,
        cells=count,
    ), cells


def _stretch(camera: Camera, middle: Float64, ground_y: float) -> Float64:
    """Change of pixel positions by that of places on the ground, at positions (P, 2): (P, 2, 2)."""
    half = 0.5
    sides = [
        camera.ground_seen_at(middle + np.array(step), ground_y)[0][:, ::2]
        for step in ((-half, 0.0), (half, 0.0), (0.0, -half), (0.0, half))
    ]
    ground_by_pixel = np.stack([sides[1] - sides[0], sides[3] - sides[2]], axis=2)
    return np.asarray(np.linalg.inv(ground_by_pixel), dtype=np.float64)
