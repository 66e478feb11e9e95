"""Clips of `turning` through a camera that travels: held by hand, sideways, ahead, or walking.

PYTHONPATH=.:samples python -m truth.travelling --out DIR [--clips 8] [--frames 60] [--first 0]

What stands behind the object shifts against the ground by up to a tenth of the frame's width. The
camera of each frame is in the clip's GLB, as a solved one would be. A seed names a clip.
"""

from __future__ import annotations

import math

import numpy as np

from truth.turning import MovingClip
from truth.walkers import STILL, Pose, clip_arguments, write_clip

_EYE, _PITCH = STILL.eye[1], STILL.pitch
_STEPS = 3.6  # of somebody who walks with the camera, in the clip


class TravellingClip(MovingClip):
    """A clip of a seed whose camera travels; two figures stand behind the object all the time."""

    paths = ("hand", "side", "ahead", "walk")

    def __init__(self, seed: int, frames: int) -> None:
        draw = np.random.default_rng([seed, 2])
        self._aside = float(draw.uniform(0.3, 0.9)) * float(draw.choice([-1, 1]))
        self._ahead = float(draw.uniform(0.4, 1.0))
        self._sways = draw.uniform(0.0, 2.0 * math.pi, (6, 3))
        super().__init__(seed, frames)

    def pose(self, index: float) -> Pose:
        """The camera of a frame."""
        part = index / (self.frames - 1)
        eased = 0.5 - 0.5 * math.cos(math.pi * part)
        speeds = np.array([3.0, 7.0, 19.0])
        x, y, z, yaw, pitch, roll = np.sin(self._sways + part * speeds).sum(axis=1).tolist()
        if self.path == "side":  # the object stays about where it is in the frame
            away = self._aside * (eased - 0.5)
            return Pose(eye=(away, _EYE, 0.0), yaw=-0.8 * away / self.place[1])
        if self.path == "ahead":
            return Pose(eye=(0.0, _EYE, self._ahead * eased))
        yaw, pitch, roll = 0.008 * yaw, _PITCH + 0.006 * pitch, 0.004 * roll
        if self.path == "hand":
            return Pose((0.03 * x, _EYE + 0.015 * y, 0.02 * z), yaw, pitch, roll)
        bob = 0.02 * math.sin(2.0 * math.pi * _STEPS * part)
        return Pose((0.02 * x, _EYE + bob, self._ahead * part), yaw, pitch, roll)


def main() -> None:
    """Write the clips."""
    given = clip_arguments("truth.travelling", __doc__.splitlines()[0], clips=8)
    for seed in range(given.first, given.first + given.clips):
        clip = TravellingClip(seed, given.frames)
        write_clip(given.out / f"{seed:02d}_{clip.path}_{clip.kind}", clip)


if __name__ == "__main__":
    main()
