"""Exponential halos around light, by direct convolution, by spectra and on a coarse grid."""

from __future__ import annotations

import math

import cv2
import numpy as np

from nlens_video.core.layers import Float32

_COARSE_LENGTH = 4.0  # decay length on the grid of the quick halo [px]


def halo_of(light: Float32, length_px: float) -> Float32:
    """Light (h, w) or (h, w, C) convolved with an exponential of decay length `length_px` [px]."""
    return np.asarray(cv2.filter2D(light, -1, _kernel(length_px), borderType=cv2.BORDER_CONSTANT))


def halo_by_spectrum(light: Float32, length_px: float) -> Float32:
    """`halo_of` for light (h, w), by Fourier transforms."""
    kernel = _kernel(length_px)
    reach = len(kernel) // 2
    # what reaches farther than across the picture falls outside
    down, across = (min(reach, side - 1) for side in light.shape)
    near = kernel[reach - down : reach + down + 1, reach - across : reach + across + 1]
    # so large that nothing wraps round into the picture
    rows = cv2.getOptimalDFTSize(light.shape[0] + down)
    columns = cv2.getOptimalDFTSize(light.shape[1] + across)
    spectra = []
    for values in (light, near):
        padded = np.zeros((rows, columns), np.float32)
        padded[: values.shape[0], : values.shape[1]] = values
        spectra.append(cv2.dft(padded))
    product = cv2.mulSpectrums(spectra[0], spectra[1], 0)
    halo = cv2.dft(product, flags=cv2.DFT_INVERSE | cv2.DFT_SCALE)
    return np.asarray(halo[down:, across:][: light.shape[0], : light.shape[1]], np.float32)


def _kernel(length_px: float) -> Float32:
    """An exponential of two dimensions whose sum is 1, to where it has fallen to a thousandth."""
    reach = math.ceil(7.0 * length_px)
    away = np.hypot(*np.meshgrid(*2 * [np.arange(reach + 1, dtype=np.float32)]))
    quarter = np.exp(-away / np.float32(length_px))
    kernel = np.pad(quarter, ((reach, 0), (reach, 0)), mode="reflect")
    return np.asarray(kernel / kernel.sum())


def quick_halo(light: Float32, length_px: float, corner: tuple[int, int] = (0, 0)) -> Float32:
    """`halo_of` on a coarse grid of the frame, where `corner` is the light's column and row."""
    step = max(1, int(length_px / _COARSE_LENGTH))
    if step == 1:
        return halo_of(light, length_px)
    (height, width), (left, top) = light.shape[:2], (start % step for start in corner)
    ends = (top, -(top + height) % step), (left, -(left + width) % step), (0, 0)
    padded = np.pad(light, ends)
    size = padded.shape[1], padded.shape[0]
    small = cv2.resize(padded, (size[0] // step, size[1] // step), interpolation=cv2.INTER_AREA)
    halo = halo_of(np.asarray(small, np.float32), length_px / step)
    fine = cv2.resize(halo, size, interpolation=cv2.INTER_CUBIC)
    return np.asarray(fine[top:, left:][:height, :width])
