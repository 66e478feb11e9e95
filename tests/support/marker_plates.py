"""Plates of ArUco markers on a textured ground, as a camera with a known pose sees them."""

from __future__ import annotations

import math

import cv2
import numpy as np
from scipy.spatial.transform import Rotation

from nlens_video.cameras.solved import CameraErrors, CameraKey, SolvedCamera

WIDTH, HEIGHT = 960, 512
_FINE = 5  # samples along a pixel's side
_CELL, _BORDER = 20, 20
_HALF = np.array([[1, 0, 0.5], [0, 1, 0.5], [0, 0, 1]])  # OpenCV's pixels to those at +0.5


def marker(number, dictionary=cv2.aruco.DICT_5X5_250):
    """A marker with a white border (H, W); 140 of 180 pixels are its side."""
    known = cv2.aruco.getPredefinedDictionary(dictionary)
    drawn = cv2.aruco.generateImageMarker(known, number, 7 * _CELL)
    return cv2.copyMakeBorder(drawn, *[_BORDER] * 4, cv2.BORDER_CONSTANT, value=255)


def placed(number, side, x, z, turn_deg=0.0, dictionary=cv2.aruco.DICT_5X5_250):
    """A marker on the ground: picture, width with border, middle, turn [m, m, deg]."""
    return marker(number, dictionary), side * 180 / 140, x, z, turn_deg


def board(square, x, z, turn_deg=0.0):
    """A ChArUco board of 7 by 5 squares; its markers' sides are 0.75 squares."""
    known = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_5X5_250)
    made = cv2.aruco.CharucoBoard((7, 5), 0.04, 0.03, known).generateImage((7 * 80, 5 * 80))
    drawn = cv2.copyMakeBorder(made, *[_BORDER] * 4, cv2.BORDER_CONSTANT, value=255)
    return drawn, 7 * square * 600 / 560, x, z, turn_deg


def pose(pitch_deg, roll_deg, height, yaw_deg=0.0, x=0.0, z=0.0):
    """World-from-camera matrix (4, 4)."""
    matrix = np.eye(4)
    turns = Rotation.from_euler("YXZ", [yaw_deg, pitch_deg, roll_deg], degrees=True)
    matrix[:3, :3], matrix[:3, 3] = turns.as_matrix(), (x, height, z)
    return matrix


def plate(things, camera, fov_deg, blur_px=0.6, texture=12):
    """What a camera sees of things on a ground (H, W)."""
    rng = np.random.default_rng(7)
    ground = cv2.resize(
        rng.integers(128 - texture, 128 + texture, (120, 120), np.uint8), (1200, 1200),
        interpolation=cv2.INTER_CUBIC,
    )  # fmt: skip
    seen = np.full((HEIGHT * _FINE, WIDTH * _FINE), 128, np.uint8)
    size = seen.shape[::-1]
    laid = [(ground, 12.0, 0.0, -5.5, 0.0), *things]
    for number, (picture, width, x, z, turn_deg) in enumerate(laid):
        how = cv2.INTER_NEAREST if number else cv2.INTER_LINEAR
        to_frame = _homography(picture.shape, width, x, z, turn_deg, camera, fov_deg)
        cv2.warpPerspective(picture, to_frame, size, seen, how, cv2.BORDER_TRANSPARENT)
    small = cv2.resize(seen, (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA)
    return cv2.GaussianBlur(small, (0, 0), blur_px)


def _homography(shape, width, x, z, turn_deg, camera, fov_deg):
    focal = 0.5 * WIDTH / math.tan(math.radians(fov_deg) / 2)
    lens = np.array([[focal, 0, -WIDTH / 2], [0, -focal, -HEIGHT / 2], [0, 0, -1.0]])
    rows, columns = shape
    scale, turn = width / columns, math.radians(turn_deg)
    c, s = scale * math.cos(turn), scale * math.sin(turn)
    lies = np.array([[c, -s, x], [0, 0, 0], [s, c, z]])
    middle = np.array([[1, 0, -columns / 2], [0, 1, -rows / 2], [0, 0, 1]])
    seen = lens @ camera[:3, :3].T @ (lies @ middle - np.outer(camera[:3, 3], (0, 0, 1)))
    fine = np.diag([_FINE, _FINE, 1.0])
    return np.linalg.inv(_HALF) @ fine @ seen @ _HALF


def rough(fov_deg=50.0, fov_error_deg=18.0, pitch_deg=-15.0):
    """What a solve without markers knows of a still camera: little."""
    key = CameraKey(
        index=0, pts_s=0.0, world_to_camera=np.linalg.inv(pose(pitch_deg, 0.0, 1.6)),
        fov_x_deg=fov_deg,
    )  # fmt: skip
    errors = CameraErrors(fov_deg=fov_error_deg, pitch_deg=12.0, roll_deg=3.0)
    return SolvedCamera(width=WIDTH, height=HEIGHT, keys=(key,), errors=errors)
