"""A ground with one texture all over, seen by a camera through a lens that is known."""

import math

import cv2
import numpy as np

from nlens_video.scene.camera import Camera
from nlens_video.stages.p_projection import project_to_ground

WIDTH, HEIGHT = 640, 400
EYE_M = 1.2
TEXEL_M = 0.002


def camera(pitch_degrees=30.0, width=WIDTH, height=HEIGHT, unit_m=1.0):
    """A level camera that looks down, in a scene of some unit [m]."""
    pitch = math.radians(-pitch_degrees)
    pose = np.eye(4)
    pose[1:3, 1:3] = [[math.cos(pitch), -math.sin(pitch)], [math.sin(pitch), math.cos(pitch)]]
    pose[1, 3] = EYE_M / unit_m
    return Camera.from_yfov(pose, 0.5, width, height)


def scene():
    """A camera, and the footprint of a box in the middle of its frame."""
    seen_by = camera()
    at = np.array([[0.5 * seen_by.width, 0.5 * seen_by.height]])
    place = seen_by.ground_seen_at(at, 0.0)[0][0]
    corners = place + 0.15 * np.array([[-1, 0, -1], [1, 0, -1], [1, 0, 1], [-1, 0, 1]])
    return seen_by, project_to_ground(corners[[[0, 1, 2], [0, 2, 3]]], seen_by, 0.0)


def texture(seed, finest_m=0.0, roughness=1.0, side=2048):
    """A tile of noise (N, N) of mean 0 and deviation 1, without detail finer than a length.

    `roughness` is the exponent of its amplitude by frequency: 0 is white.
    """
    rng = np.random.default_rng(seed)
    across, down = np.meshgrid(np.fft.rfftfreq(side), np.fft.fftfreq(side))
    frequency = np.hypot(across, down)
    spectrum = np.fft.rfft2(rng.standard_normal((side, side)))
    spectrum *= np.maximum(frequency, 1.0 / side) ** -roughness * (frequency > 8.0 / side)
    spectrum *= np.exp(-0.5 * (2.0 * math.pi * frequency * finest_m / TEXEL_M) ** 2)
    tile = np.fft.irfft2(spectrum, s=(side, side))
    return np.float32((tile - tile.mean()) / tile.std())


def sharp_view(tile, seen_by, contrast=0.06, supersampling=3):
    """The ground as a pinhole sees it, mean over each pixel, display-coded (H, W)."""
    fine = seen_by.resized(seen_by.width * supersampling, seen_by.height * supersampling)
    points = fine.plane_points(0.0)
    columns, rows = (np.float32(points[..., axis] / TEXEL_M % len(tile)) for axis in (0, 2))
    padded = cv2.copyMakeBorder(tile, 0, 1, 0, 1, cv2.BORDER_WRAP)
    seen = cv2.remap(padded, columns, rows, cv2.INTER_LINEAR)
    size = seen_by.width, seen_by.height
    return 0.5 + contrast * cv2.resize(seen, size, interpolation=cv2.INTER_AREA)


def blurred(sharp, coc_px):
    """A view whose rows are blurred by discs, by the unsigned CoC of each row (H,) [px]."""
    whole = np.empty_like(sharp)
    for row, diameter in enumerate(coc_px):
        reach = math.ceil(0.5 * diameter) + 1
        band = np.clip(np.arange(row - reach, row + reach + 1), 0, len(sharp) - 1)
        whole[row] = cv2.filter2D(sharp[band], -1, disc(diameter, reach), borderType=4)[reach]
    return whole


def disc(diameter, reach):
    """Its coverage of pixels (2 reach + 1, 2 reach + 1), of sum 1."""
    parts = (np.arange(8) + 0.5) / 8 - 0.5
    places = (np.arange(-reach, reach + 1)[:, None] + parts).ravel()
    inside = np.hypot(*np.meshgrid(places, places)) <= max(0.5 * diameter, 0.1)
    side = 2 * reach + 1
    kernel = inside.reshape(side, 8, side, 8).mean(axis=(1, 3))
    return np.float32(kernel / kernel.sum())


def filmed(tile, lens, seen_by, noise=0.01, seed=0, contrast=0.06):
    """The ground through a lens with a slope and an intercept, with white noise (H, W)."""
    rows = np.arange(seen_by.height) + 0.5
    middle = np.array([0.5 * seen_by.width])
    coc = np.abs(lens[0] * seen_by.disparity_at(middle, rows, 0.0)[:, 0] + lens[1])
    whole = blurred(sharp_view(tile, seen_by, contrast), coc)
    grain = noise * np.random.default_rng(seed).standard_normal(whole.shape)
    return np.float32(np.clip(whole + grain, 0.0, 1.0))
