"""Lateral chromatic aberration: radial displacement of red and blue against green.

Measured: in each small window the channels of a natural picture are nearly affine in each other;
the residual of red (or blue) after its best affine fit of green and its gradient is a displacement.
A lens displaces along the radius, never across it, and equally in all quadrants; only what passes
these tests counts. Coloured edges and shifted chroma samples do not.

Applied: each channel of the object gets a silhouette of its own, which one alpha cannot express.
The difference of coverage in red and blue is written with the plate's own light, so that the
object's edges fringe over the plate as the plate's edges do.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import cast

import cv2
import numpy as np
from cv2.typing import MatLike

from nlens_video.core.box import from_middle, half_diagonal, square_radius
from nlens_video.core.layers import BlurredLayer, Box, Float32, Float64, Picture
from nlens_video.core.optics import Aberration
from nlens_video.effects.camera.radial_fit import RadialFit, Windows, fit_radial
from nlens_video.effects.measurement import Measurement
from nlens_video.effects.plate_pictures import PlatePictures

EFFECT = "aberration"
THRESHOLD_PX = 0.4
_WORK_WIDTH = 800  # at least twice coarser than the plate, where chroma has its own samples
_WINDOW = 12  # side of a window [px of the work size]
_ROUNDS = 4
_SMOOTHING_PX = 1.0
_LEAST_CONTRAST = 0.02  # deviation of green in a window that shows a displacement
_TRUSTED = 0.75  # quantile of the windows' residual variances that is the least for each
_MS_PER_MEGAPIXEL = 30.0


def measure(pictures: Sequence[Picture]) -> Measurement:
    """Measure it on the first of a shot's pictures."""
    picture = pictures[0]
    step = max(2, math.ceil(picture.width / _WORK_WIDTH))
    planes = _reduced(PlatePictures.of(pictures).codes(), step)
    green = _GreenWindows(planes[1])
    channels, words = {}, []
    for name, at in (("red", 0), ("blue", 2)):
        fit = _displacement(green, planes[at])
        channels[name] = fit
        words.append(f"{name} {fit.at_corner * step:+.2f} px at the corner ({fit.describe()})")
    cost_ms = _MS_PER_MEGAPIXEL * 0.2 * picture.width * picture.height / 1e6
    model = None
    if any(fit.consistent for fit in channels.values()):
        found = [fit if fit.consistent else None for fit in channels.values()]
        red, blue = (
            (0.0, 0.0) if fit is None else (fit.linear * step, fit.cubic * step) for fit in found
        )
        model = Aberration(red=red, blue=blue)
    return Measurement(
        effect=EFFECT,
        value=0.0 if model is None else model.at_corner_px,
        threshold=THRESHOLD_PX,
        unit="px at the corner",
        evidence="edges of red and blue against green: " + ", ".join(words),
        model=model,
        cost_ms=cost_ms,
    )


def _reduced(rgb: Float32, step: int) -> Sequence[Float32]:
    """The channels (h, w), reduced to the work size."""
    height, width = (max(1, side // step) * min(step, side) for side in rgb.shape[:2])
    size = (max(1, width // step), max(1, height // step))
    small = cv2.resize(rgb[:height, :width], size, interpolation=cv2.INTER_AREA)
    return cast("Sequence[Float32]", cv2.split(cv2.GaussianBlur(small, (0, 0), _SMOOTHING_PX)))


def _displacement(green: _GreenWindows, other: Float32) -> RadialFit:
    """Displacement of a channel (H, W) against green [px].

    A codec that drops a window's faint chroma leaves a picture that green explains without any
    displacement. Windows weighted by their residual then pull the strength to zero; windows with
    nearly equal weights let coloured edges in. So the former decide, the latter must agree, and
    give the strength.
    """
    strict = _fitted(green, other, alike_trusted=False)
    return _fitted(green, other, alike_trusted=True) if strict.consistent else strict


def _fitted(green: _GreenWindows, other: Float32, *, alike_trusted: bool) -> RadialFit:
    fit = RadialFit()
    for _ in range(_ROUNDS):
        windows = green.against(_moved_back(other, fit), alike_trusted=alike_trusted)
        fit = fit_radial(windows).after(fit)
    return fit


def _moved_back(plane: Float32, fit: RadialFit) -> Float32:
    """The channel with a displacement undone."""
    if not (fit.linear or fit.cubic):
        return plane
    half = 0.5 * math.hypot(*plane.shape)
    x, y = (_places(side, half) for side in plane.shape[::-1])
    scale = (half + fit.linear) + fit.cubic * (x**2 + y[:, None] ** 2)
    columns = (x * scale + 0.5 * plane.shape[1] - 0.5).astype(np.float32)
    rows = (y[:, None] * scale + 0.5 * plane.shape[0] - 0.5).astype(np.float32)
    return np.asarray(
        cv2.remap(plane, columns, rows, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
    )


def _places(side: int, half: float) -> Float64:
    """Columns or rows from the middle (side,) [half diagonal of `half` px]."""
    return np.asarray((np.arange(side) + 0.5 - 0.5 * side) / half, np.float64)


def _tiles(plane: MatLike) -> Float64:
    """Pixels of a plane (H, W) by window (N, P)."""
    height, width = (side // _WINDOW for side in plane.shape)
    cut = plane[: height * _WINDOW, : width * _WINDOW].astype(np.float64)
    tiles = cut.reshape(height, _WINDOW, width, _WINDOW).transpose(0, 2, 1, 3)
    return np.asarray(tiles.reshape(height * width, _WINDOW**2), np.float64)


class _GreenWindows:
    """Windows of green (H, W) in which a displacement of another channel would show.

    What depends on green alone is computed once: each channel is fitted in several rounds.
    """

    def __init__(self, green: Float32) -> None:
        tiles = _tiles(green)
        deviation = tiles.std(axis=1)
        self._kept = (deviation > _LEAST_CONTRAST) & (tiles.max(axis=1) < 0.98)
        self._deviation = deviation[self._kept]
        half = 0.5 * math.hypot(*green.shape)
        columns, rows = (
            _places(side, half)[_WINDOW // 2 :: _WINDOW][: side // _WINDOW]
            for side in green.shape[::-1]
        )
        self._x, self._y = (part.ravel()[self._kept] for part in np.meshgrid(columns, rows))
        gradient_x = cv2.Sobel(green, cv2.CV_32F, 1, 0, ksize=3, scale=0.125)
        gradient_y = cv2.Sobel(green, cv2.CV_32F, 0, 1, ksize=3, scale=0.125)
        parts = [tiles, np.ones_like(tiles), _tiles(gradient_x), _tiles(gradient_y)]
        self._design = np.stack([part[self._kept] for part in parts], axis=1)
        normal = self._design @ self._design.transpose(0, 2, 1)
        self._inverse = np.linalg.inv(normal + 1e-9 * np.eye(4))

    def against(self, other: Float32, *, alike_trusted: bool) -> Windows:
        """Displacement of a channel (H, W) in each window that shows one.

        With `alike_trusted` the residual variance of a window has a lower bound, so weights are
        alike.
        """
        target = _tiles(other)[self._kept]
        solution = self._inverse @ (self._design @ target[..., None])
        residual = target - (solution.transpose(0, 2, 1) @ self._design)[:, 0]
        left, solution = residual.var(axis=1), solution[..., 0]
        unclipped = (target.max(axis=1) < 0.98) & (target.min(axis=1) > 0.01)
        slope = solution[:, 0]
        good = unclipped & (slope > 0.1) & (slope * self._deviation > 2.0 * np.sqrt(left))
        if alike_trusted and unclipped.any():
            left = np.maximum(left, np.quantile(left[unclipped], _TRUSTED))
        # neighbours share noise through the smoothing: a window is worth a fifth
        variance = (5.0 * left + 1e-7)[good, None, None]
        slope = slope[good]
        return Windows(
            x=self._x[good],
            y=self._y[good],
            moved=-solution[good, 2:] / slope[:, None],
            covariance=variance * self._inverse[good, 2:, 2:] / slope[:, None, None] ** 2,
            trust=np.ones(len(slope)),
        )


def displace_channels(
    layer: BlurredLayer, aberration: Aberration, picture: Picture, frame: Box
) -> BlurredLayer:
    """A layer with red and blue displaced, to be composited over this very plate.

    Args:
        layer: premultiplied, inside the frame.
        aberration: of the lens.
        picture: the plate; unchanged.
        frame: the frame's own box.
    """
    if layer.box.empty:
        return layer
    margin = math.ceil(_most(aberration))
    wide = layer.box.expanded(margin)
    box = wide.intersection(frame)
    source = _grown(layer, margin, frame)
    out = np.ascontiguousarray(source[box.slices_in(wide)])
    alpha = out[..., 3].copy()
    plate = picture.linear(box)
    for channel, (linear, cubic) in ((0, aberration.red), (2, aberration.blue)):
        if not (linear or cubic):
            continue
        pair = np.ascontiguousarray(source[..., (channel, 3)])
        parts = _signs_apart(pair)
        moved = [_moved(part, wide, box, frame, (linear, cubic)) for part in parts]
        light, cover = np.maximum(moved[0][..., 0], 0.0), np.clip(moved[0][..., 1], 0.0, 1.0)
        for one in moved[1:]:
            light += np.minimum(one[..., 0], 0.0)
        out[..., channel] = light + (alpha - cover) * plate[..., channel]
    return BlurredLayer(box=box, rgba=out)


def _signs_apart(pair: Float32) -> list[Float32]:
    """Light and coverage (h, w, 2), after it what light is negative, if any.

    The cubic filter rings at edges, and is to make no light of another sign there. Light of colours
    beyond BT.709 is negative by itself.
    """
    below = np.minimum(pair[..., 0], 0.0)
    if not below.any():
        return [pair]
    above = np.stack([pair[..., 0] - below, pair[..., 1]], axis=2)
    return [above, np.stack([below, np.zeros_like(below)], axis=2)]


def _most(aberration: Aberration) -> float:
    """Largest displacement anywhere on the frame [px]."""
    r = np.linspace(0.0, 1.0, 65)
    both = (aberration.red, aberration.blue)
    return max(float(np.abs(linear * r + cubic * r**3).max()) for linear, cubic in both)


def _grown(layer: BlurredLayer, margin: int, frame: Box) -> Float32:
    """The layer with a margin, extended beyond the border of the frame."""
    held = layer.box
    sides = [(margin, held.y0 == frame.y0, held.y1 == frame.y1),
             (margin, held.x0 == frame.x0, held.x1 == frame.x1)]  # fmt: skip
    grown = layer.rgba
    for axis, (width, before, after) in enumerate(sides):
        for at, cut in ((0, before), (1, after)):
            pad = [(0, 0), (0, 0), (0, 0)]
            pad[axis] = (width, 0) if at == 0 else (0, width)
            grown = np.pad(grown, pad, mode="edge" if cut else "constant")
    return grown


def _moved(pair: Float32, wide: Box, box: Box, frame: Box, parts: tuple[float, float]) -> Float32:
    """Light and coverage of a channel, displaced, on a box."""
    half = half_diagonal(frame)
    columns, rows = from_middle(box, frame)
    square = square_radius(box, frame)
    # r maps to r - d(r) to first order; d changes by a thousandth of a pixel
    scale = np.float32(1.0) - (np.float32(parts[0]) + np.float32(parts[1]) * square) / np.float32(
        half
    )
    middle_x, middle_y = 0.5 * (frame.x0 + frame.x1), 0.5 * (frame.y0 + frame.y1)
    x = columns[None, :] * scale + np.float32(middle_x - wide.x0 - 0.5)
    y = rows[:, None] * scale + np.float32(middle_y - wide.y0 - 0.5)
    return np.asarray(cv2.remap(pair, x, y, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE))
