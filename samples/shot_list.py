"""The two shots: camera, lens and light, shared by every script here (needs only numpy).

World of the plates: metres, x right, y away from the camera, z up (Blender). The objects' files
use glTF axes, x right, y up, z towards the camera: (x, y, z) -> (x, z, -y).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

WIDTH, HEIGHT, RATE, SECONDS = 960, 512, 24, 6.0
FRAMES = int(RATE * SECONDS)
SENSOR_MM = 36.0
NOISE_SHARE = 8
"""Rays of a plate by rays of the picture that measures its noise [1]."""
Floats = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True, kw_only=True)
class Shot:
    """One static camera and the key light of its scene.

    Attributes:
        name: scene module that Blender builds, `terrace` or `park`.
        plate: file name of the clip.
        glb: file name of the object.
        focal_mm: focal length [mm].
        f_number: focal length by the diameter of the entrance pupil [1].
        focus_m: distance of the focal plane along the optical axis [m].
        height_m: camera above the ground plane [m].
        pitch_deg: how far the camera looks down [deg].
        sun: direction towards the sun, Blender axes, any length.
        sun_strength: irradiance of a surface that faces the sun [scene-linear].
        sun_colour: its linear RGB, largest 1.
        exposure: scene-linear to plate-linear [1].
        bounces: of light between surfaces [1].
        seed: of everything random in the shot.
    """

    name: str
    plate: str
    glb: str
    focal_mm: float
    f_number: float
    focus_m: float
    height_m: float
    pitch_deg: float
    sun: tuple[float, float, float]
    sun_strength: float
    sun_colour: tuple[float, float, float]
    exposure: float
    bounces: int
    seed: int

    @property
    def focal_px(self) -> float:
        """Focal length [px]."""
        return self.focal_mm / SENSOR_MM * WIDTH

    @property
    def yfov(self) -> float:
        """Vertical field of view [rad]."""
        return 2.0 * math.atan(0.5 * HEIGHT / self.focal_px)

    @property
    def intercept(self) -> float:
        """Signed CoC diameter at infinity, thin lens, never positive [px]."""
        f, aperture = self.focal_mm * 1e-3, self.focal_mm * 1e-3 / self.f_number
        return -aperture * f / (self.focus_m - f) * WIDTH / (SENSOR_MM * 1e-3)

    @property
    def slope(self) -> float:
        """Change of the signed CoC diameter with disparity [px m]."""
        return -self.intercept * self.focus_m

    @property
    def blender_f_number(self) -> float:
        """The f-number that makes Cycles obey the thin lens law.

        Cycles puts the sensor at the focal length, whatever the focus; a thin lens moves it back.
        """
        return self.f_number * (self.focus_m - self.focal_mm * 1e-3) / self.focus_m

    def project(self, points: Floats) -> Floats:
        """Column, row and depth (N, 3) [px, px, m] of points in Blender axes (N, 3) [m]."""
        pitch = math.radians(self.pitch_deg)
        y, z = points[:, 1], points[:, 2] - self.height_m
        depth = y * math.cos(pitch) - z * math.sin(pitch)
        up = y * math.sin(pitch) + z * math.cos(pitch)
        column = 0.5 * WIDTH + self.focal_px * points[:, 0] / depth
        return np.stack([column, 0.5 * HEIGHT - self.focal_px * up / depth, depth], axis=1)

    def coc_px(self, depth: Floats) -> Floats:
        """Signed CoC diameter [px], positive nearer than focus, of camera-space depth [m]."""
        return self.slope / depth + self.intercept


TERRACE = Shot(
    name="terrace",
    plate="in.mp4",
    glb="anim.glb",
    focal_mm=55.0,
    f_number=1.8,
    focus_m=1.3,
    height_m=0.30,
    pitch_deg=8.6,
    sun=(-0.74, -0.42, 0.50),
    sun_strength=2.6,
    sun_colour=(1.0, 0.70, 0.42),
    exposure=1.55,
    bounces=4,
    seed=7,
)
PARK = Shot(
    name="park",
    plate="in2.mp4",
    glb="anim2.glb",
    focal_mm=85.0,
    f_number=2.0,
    focus_m=3.6,
    height_m=0.48,
    pitch_deg=4.0,
    sun=(0.66, -0.40, 0.55),
    sun_strength=3.4,
    sun_colour=(1.0, 0.90, 0.76),
    exposure=1.45,
    bounces=2,
    seed=11,
)
SHOTS = {shot.name: shot for shot in (TERRACE, PARK)}


def bulbs(shot: Shot) -> Floats:
    """Fairy lights of the terrace, none in the park: x, y, z, red, green, blue (N, 6)."""
    if shot.name != "terrace":
        return np.zeros((0, 6))
    rng = np.random.default_rng(shot.seed)
    strings = [
        ((-2.3, 4.6, 0.42), (0.3, 4.2, 0.30), 0.16, 15),
        ((0.1, 4.3, 0.36), (2.4, 5.0, 0.44), 0.20, 14),
        ((-2.6, 6.2, 0.18), (2.8, 5.6, 0.22), 0.34, 22),
    ]
    rows = []
    for start, end, sag, count in strings:
        for t in (np.arange(count) + 0.5 + rng.uniform(-0.15, 0.15, count)) / count:
            x, y, z = (a + t * (b - a) for a, b in zip(start, end, strict=True))
            colour = np.array([1.0, 0.56, 0.20]) * rng.uniform(0.55, 1.15)
            rows.append([x, y, z - 4.0 * sag * t * (1.0 - t), *colour])
    return np.array(rows)
