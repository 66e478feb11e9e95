"""Small shots with known effects of the camera, made by the tests."""

from __future__ import annotations

import cv2
import numpy as np

from nlens_video.effects.camera.grain import to_code, to_linear
from nlens_video.effects.motion_blur import line_kernel
from nlens_video.video.pixels.picture import ArrayPicture

WIDTH, HEIGHT = 480, 270
_MARGIN = 100  # of a scene, for a camera that pans


def scene(seed=0, slope=1.2, contrast=0.22, soft_px=0.0):
    """Scene-linear RGB (H, W, 3): noise of a spectral slope, some cards with straight edges."""
    rng = np.random.default_rng(seed)
    fy, fx = np.fft.fftfreq(HEIGHT)[:, None], np.fft.fftfreq(WIDTH)[None]
    fall = np.maximum(np.hypot(fy, fx), 1 / WIDTH) ** -slope
    field = np.fft.ifft2(np.fft.fft2(rng.standard_normal((HEIGHT, WIDTH))) * fall).real
    field = (field - field.mean()) / field.std()
    tint = 1 + 0.15 * rng.standard_normal(3)
    code = 0.45 + contrast * field[..., None] * tint * 0.6
    code = code + 0.25 * np.linspace(-1, 1, WIDTH)[None, :, None]
    for _ in range(9):
        corners = np.float32(rng.uniform(0, 1, 2) * [WIDTH, HEIGHT]) + np.float32(
            rng.uniform(-60, 60, (4, 2))
        )
        shade = rng.uniform(0.08, 0.9, 3).tolist()
        hull = cv2.convexHull(corners).astype(np.int32)
        card = np.zeros((4 * HEIGHT, 4 * WIDTH), np.uint8)
        cv2.fillConvexPoly(card, 4 * hull, 255)
        share = cv2.resize(card, (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA)[..., None] / 255
        code = code * (1 - share) + share * shade
    linear = to_linear(np.clip(code, 0.02, 0.97).astype(np.float32))
    return cv2.GaussianBlur(linear, (0, 0), soft_px) if soft_px else linear


def noise(seed, frames, deviation, *, tint=0.0, spread_px=0.0, persistence=0.0):
    """Noise in code values (frames, H, W, 3) of unit level; grey to `tint`-coloured."""
    rng = np.random.default_rng(seed)
    out = []
    before = None
    for _ in range(frames):
        fresh = rng.standard_normal((HEIGHT, WIDTH, 3))
        fresh = tint * fresh + (1 - tint) * fresh[..., :1]
        if spread_px:
            fresh = cv2.GaussianBlur(fresh, (0, 0), spread_px)
        fresh /= fresh.std()
        if before is not None:
            fresh = persistence * before + np.sqrt(1 - persistence**2) * fresh
        before = fresh
        out.append(deviation * fresh)
    return np.stack(out).astype(np.float32)


def pictures(linear, frames=4, grain=None):
    """8-bit pictures of a still camera; `grain` (frames, H, W, 3) in code values."""
    code = to_code(np.asarray(linear, np.float32))
    shots = [code if grain is None else code + grain[at] for at in range(frames)]
    return [ArrayPicture(np.uint8(np.clip(np.round(255 * shot), 0, 255)), "rgb") for shot in shots]


def panned(base, way_px, share, frames=3):
    """Pictures of a camera that pans evenly, its shutter open for a share of the time."""
    wide = cv2.copyMakeBorder(base, *[_MARGIN] * 4, cv2.BORDER_REFLECT)
    rng = np.random.default_rng(0)
    shot = []
    for at in range(frames):
        shift = np.float32([[1, 0, at * way_px[0]], [0, 1, at * way_px[1]]])
        view = cv2.warpAffine(
            wide, shift, wide.shape[1::-1], flags=cv2.INTER_CUBIC, borderMode=cv2.BORDER_REFLECT
        )
        if share:
            view = cv2.filter2D(view, -1, line_kernel(share * np.asarray(way_px)))
        view = np.maximum(view[_MARGIN:-_MARGIN, _MARGIN:-_MARGIN], 0)
        shot += pictures(view, 1, rng.normal(0, 1 / 255, (1, *view.shape)))
    return shot
