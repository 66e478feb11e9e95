"""Clips of `walkers` through a camera that turns, is held by hand, or travels.

PYTHONPATH=.:samples python -m truth.turning --out DIR [--clips 6] [--frames 60] [--first 0]

The camera of each frame is in the clip's GLB, as a solved one would be. The shutter is so short
that the camera's own motion does not blur. A seed names a clip.
"""

from __future__ import annotations

import math

import cv2
import numpy as np

from truth.figures import Look
from truth.walkers import (
    FOCAL,
    HEIGHT,
    STILL,
    WALL,
    WIDTH,
    Array,
    Clip,
    Pose,
    View,
    Walker,
    clip_arguments,
    write_clip,
)

_EYE, _PITCH = STILL.eye[1], STILL.pitch
_FINE = 2  # samples of a pixel, each way
_REACH = 12.0  # half of the textures' width [m]
_NEAR, _TALL = 2.2, 6.0  # where the floor's texture begins, and how high the wall's is [m]


class MovingClip(Clip):
    """A clip of a seed whose camera moves; two figures stand behind the object all the time."""

    paths: tuple[str, ...] = ("turn", "turn", "hand", "turn", "travel")

    def __init__(self, seed: int, frames: int) -> None:
        draw = np.random.default_rng([seed, 1])
        self.path = self.paths[seed % len(self.paths)]
        self._swing = math.radians(float(draw.uniform(12.0, 30.0))) * float(draw.choice([-1, 1]))
        self._nod = math.radians(float(draw.uniform(-2.0, 2.0)))
        self._travel = float(draw.uniform(0.3, 0.8)) * float(draw.choice([-1, 1]))
        self._phases = draw.uniform(0.0, 2.0 * math.pi, (5, 3))
        self._views: dict[int, View] = {}
        super().__init__(seed, frames)
        for side in (-1.0, 1.0):
            x = self.place[0] + side * float(draw.uniform(0.2, 2.0))
            place = x, self.place[1] * float(draw.uniform(1.15, 1.55))
            self.walkers.append(Walker(Look.drawn(draw), place, place, (-1.0, frames + 1.0)))

    def pose(self, index: float) -> Pose:
        """The camera of a frame."""
        part = index / (self.frames - 1)
        eased = 0.5 - 0.5 * math.cos(math.pi * part) - 0.5
        if self.path == "turn":
            nod = self._nod * math.sin(math.pi * part)
            return Pose(yaw=self._swing * eased, pitch=_PITCH + nod)
        if self.path == "travel":
            return Pose(eye=(self._travel * eased, _EYE, 0.0))
        speeds = np.array([3.0, 7.0, 19.0])
        sway = np.sin(self._phases + part * speeds).sum(axis=1).tolist()
        return Pose(
            eye=(0.02 * sway[0], _EYE + 0.01 * sway[1], 0.0),
            yaw=0.008 * sway[2], pitch=_PITCH + 0.006 * sway[3], roll=0.004 * sway[4],
        )  # fmt: skip

    def seen(self, index: int) -> View:
        """What a frame shows without the walkers."""
        if index not in self._views:
            self._views = {index: self.view(self.pose(index))}
        return self._views[index]

    def sharp(self, pose: Pose) -> tuple[Array, Array]:
        """The scene without its lens, in linear light (H, W, 3); its depth [m]."""
        columns = (np.arange(WIDTH * _FINE) + 0.5) / _FINE
        rows = (np.arange(HEIGHT * _FINE) + 0.5) / _FINE
        x, y = (columns - WIDTH / 2) / FOCAL, (HEIGHT / 2 - rows) / FOCAL
        rays = np.stack(np.broadcast_arrays(x[None, :], y[:, None], 1.0), axis=-1) @ pose.axes
        floor = -pose.eye[1] / np.minimum(rays[..., 1], -1e-6)
        wall = (WALL - pose.eye[2]) / np.maximum(rays[..., 2], 1e-6)
        depth = np.minimum(floor, wall)
        points = np.asarray(pose.eye) + depth[..., None] * rays
        across = (points[..., 0] / (2.0 * _REACH) + 0.5) * self.floor.shape[1]
        ground = _painted(
            self.floor, across, (WALL - points[..., 2]) / (WALL - _NEAR) * self.floor.shape[0]
        )
        upright = _painted(self.wall, across, (1.0 - points[..., 1] / _TALL) * self.wall.shape[0])
        fine = np.where((wall < floor)[..., None], upright, ground)
        size = WIDTH, HEIGHT
        picture = cv2.resize(fine, size, interpolation=cv2.INTER_AREA)
        return (
            np.asarray(picture, np.float32),
            np.asarray(cv2.resize(depth, size, interpolation=cv2.INTER_AREA), np.float32),
        )


def _painted(texture: Array, columns: np.ndarray, rows: np.ndarray) -> Array:
    places = (columns - 0.5).astype(np.float32), (rows - 0.5).astype(np.float32)
    found = cv2.remap(texture, *places, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT_101)
    return np.asarray(found, np.float32)


def main() -> None:
    """Write the clips."""
    given = clip_arguments("truth.turning", __doc__.splitlines()[0], clips=6)
    for seed in range(given.first, given.first + given.clips):
        clip = MovingClip(seed, given.frames)
        write_clip(given.out / f"{seed:02d}_{clip.path}_{clip.kind}", clip)


if __name__ == "__main__":
    main()
