"""A shot over whose ground a card walks in the sun, and what its shadow covers."""

import math

import cv2
import numpy as np
from support import shots

from nlens_video.core.color import transfer
from nlens_video.video.info import SourceFrame
from nlens_video.video.pixels.picture import ArrayPicture

FRAMES, RATE = 48, 24
PLACE = np.array([0.0, 0.0, -2.2])  # of the object
LEFT = 0.45  # share of the ground's light in the card's shadow
_HEIGHT, _WIDTH, _AWAY = 0.9, 0.3, 0.6
_SRGB = transfer("iec61966-2-1")


def direction(azimuth, elevation):
    """To a sun so many degrees right of the view, and up."""
    right, up = math.radians(azimuth), math.radians(elevation)
    return np.array([math.sin(right) * math.cos(up), math.sin(up), -math.cos(right) * math.cos(up)])


def _axes(toward):
    level = np.array([toward[0], 0.0, toward[2]]) / math.hypot(toward[0], toward[2])
    return level, np.array([level[2], 0.0, -level[0]])


def card(toward, index):
    """Where its foot is: it walks past the object on the sun's side."""
    level, side = _axes(toward)
    return PLACE + _AWAY * level + (1.2 - 2.4 * index / (FRAMES - 1)) * side


def blocked(points, toward, index):
    """Whether points (..., 3) lie in the card's shadow."""
    foot, (level, side) = card(toward, index), _axes(toward)
    distance = ((foot - points) @ level) / (toward @ level)
    met = points + distance[..., None] * toward
    beside = np.abs((met - foot) @ side) < _WIDTH / 2
    return (distance > 0.0) & beside & (met[..., 1] > 0.0) & (met[..., 1] < _HEIGHT)


def codes(toward, index):
    """The frame's sRGB codes (h, w, 3)."""
    view = shots.camera()
    columns, rows = np.meshgrid(np.arange(view.width) + 0.5, np.arange(view.height) + 0.5)
    rays = np.stack(
        [(columns - view.cx) / view.fx, (view.cy - rows) / view.fy, -np.ones_like(rows)], axis=-1
    )
    ways = rays @ view.world_from_camera[:3, :3].T
    eye = view.world_from_camera[:3, 3]
    ground = eye - eye[1] / np.minimum(ways[..., 1:2], -1e-6) * ways
    shadow = cv2.GaussianBlur(np.float64(blocked(ground, toward, index)), (0, 0), 0.8)
    light = _SRGB.to_linear(shots.plate() / 255.0) * (1.0 - (1.0 - LEFT) * shadow[..., None])
    picture = 255.0 * _SRGB.to_coded(light)
    foot, (_, side) = card(toward, index), _axes(toward)
    up, half = np.array([0.0, _HEIGHT, 0.0]), 0.5 * _WIDTH * side
    corners = np.array([foot - half, foot + half, foot + half + up, foot - half + up])
    places = view.pixels(view.to_camera(corners)).astype(np.int32)
    cv2.fillPoly(picture, [places], (40, 60, 190))
    grain = np.random.default_rng(index).normal(0.0, 1.0, picture.shape)
    return np.uint8(np.clip(picture + grain, 0, 255))


def frames(toward):
    """The shot's frames."""
    for index in range(FRAMES):
        picture = ArrayPicture(codes(toward, index), "rgb")
        yield SourceFrame(index=index, time_s=index / RATE, picture=picture)
