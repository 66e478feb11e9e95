"""What a seed decides before anything is built: setting, camera, lens, the object's place.

World: metres, x right, y away from the camera, z up (Blender's axes); the object stands on z = 0
and the camera above the origin. glTF's axes are (x, z, -y). Needs only numpy.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import numpy.typing as npt

Floats = npt.NDArray[np.float64]
WIDTH, HEIGHT, SENSOR_MM = 960, 512, 36.0
FOCUSES = ("front", "mid", "back")
FRONT, BACK = 0.86, 1.33
"""Focus distance by the object's nearest and by its farthest depth [1]."""
MAX_COC_PX = 40.0
FASTEST = 0.7
"""Smallest f-number; a scene that would need a faster lens gets smaller discs instead."""
NEAREST = 0.85
"""Depth that nothing may come nearer than, by the depth of the ground at the lower border [1]."""
DISTANCES = {"table": (0.5, 1.3), "room": (1.1, 2.8), "yard": (1.8, 6.0)}
OBJECT_M = (0.1, 1.5)
FOCALS_MM = {
    "usual": (28.0, 100.0),
    "wild": (24.0, 85.0),
    "built": (24.0, 85.0),
    "hard": (24.0, 85.0),
    "backed": (28.0, 100.0),
}
PITCHES_DEG = {
    "usual": (8.0, 40.0),
    "wild": (3.0, 50.0),
    "built": (3.0, 35.0),
    "hard": (3.0, 45.0),
    "backed": (8.0, 30.0),
}
ROLL_DEG = {"usual": 0.0, "wild": 4.0, "built": 2.0, "hard": 3.0, "backed": 0.0}
BARE_EVERY = 3
"""Of the scenes with wild cameras: every third has little to hold on to."""
HARD_GROUNDS = {
    "grass": ("yard",),
    "gravel": ("yard",),
    "snow": ("yard",),
    "plaster": ("table", "room"),
    "polished": ("room",),
    "wet": ("yard",),
    "sand": ("yard",),
    "terrazzo": ("table", "room"),
    "fabric": ("table", "room"),
    "soft": ("table", "room"),
    "fractal": ("table", "room", "yard"),
    "brushed": ("table",),
}
"""Grounds whose blur is hard to read, in the order of the seeds, and where they are found."""
BACKS = ("wall", "step", "box")
"""What stands close behind the object of a backed scene, in the order of the seeds."""
HARD_COC_PX = (6.0, 39.0)
"""Largest CoC of scenes on hard ground, from deep focus to a portrait [px]."""
HARD_F_NUMBERS = (1.2, 22.0)
POINT_RADIUS_PX = 2.0
"""Of the "points" of light of --point: much smaller ones are hit by too few rays."""


@dataclass(frozen=True, slots=True, kw_only=True)
class View:
    """A static camera and the place before it where the object stands.

    Attributes:
        seed: names the scene.
        setting: `table`, `room` or `yard`.
        focal_mm: focal length [mm].
        pitch_deg: how far the camera looks down [deg].
        height_m: camera above the object's ground [m].
        place: x and y of the object's foot [m].
        size_m: largest extent of the object across the view [m].
        roll_deg: turn about the optical axis, positive where the world's up leans right [deg].
        bare: few things about, on a ground without lines.
        built: a street, a room or a table that people have made.
        ground: kind of hard ground, empty for any other.
        back: what stands close behind the object and catches its shadow, empty for nothing.
    """

    seed: int
    setting: str
    focal_mm: float
    pitch_deg: float
    height_m: float
    place: tuple[float, float]
    size_m: float
    roll_deg: float = 0.0
    bare: bool = False
    built: bool = False
    ground: str = ""
    back: str = ""

    @property
    def focal_px(self) -> float:
        """Focal length [px]."""
        return self.focal_mm / SENSOR_MM * WIDTH

    @property
    def yfov(self) -> float:
        """Vertical field of view [rad]."""
        return 2.0 * math.atan(0.5 * HEIGHT / self.focal_px)

    @property
    def nearest_m(self) -> float:
        """Depth that nothing comes nearer than [m]."""
        pitch = math.radians(self.pitch_deg)
        fall = math.sin(pitch) + math.cos(pitch) * self._reach_px / self.focal_px
        return NEAREST * self.height_m / fall

    @property
    def farthest_m(self) -> float:
        """Depth of the ground at the upper border with room to spare, or infinite [m]."""
        pitch = math.radians(self.pitch_deg)
        fall = math.sin(pitch) - math.cos(pitch) * self._reach_px / self.focal_px
        return math.inf if fall <= 0.0 or self.setting == "table" else 1.3 * self.height_m / fall

    @property
    def _reach_px(self) -> float:
        """From the frame's middle to its lowest corner, along the fall of the ground [px]."""
        roll = math.radians(self.roll_deg)
        return 0.5 * (HEIGHT * math.cos(roll) + WIDTH * abs(math.sin(roll)))

    def project(self, points: Floats) -> Floats:
        """Column, row and depth (N, 3) [px, px, m] of points (N, 3) [m]."""
        pitch, roll = math.radians(self.pitch_deg), math.radians(self.roll_deg)
        x, y, z = points[:, 0], points[:, 1], points[:, 2] - self.height_m
        depth = y * math.cos(pitch) - z * math.sin(pitch)
        up = y * math.sin(pitch) + z * math.cos(pitch)
        right = x * math.cos(roll) + up * math.sin(roll)
        up = up * math.cos(roll) - x * math.sin(roll)
        scale = self.focal_px / np.maximum(depth, 1e-6)
        return np.stack([0.5 * WIDTH + scale * right, 0.5 * HEIGHT - scale * up, depth], axis=1)

    def on_ground(self, column: float, depth: float, level: float = 0.0) -> tuple[float, float]:
        """X and y of the point of the plane z = level at a depth [m], in a column [px]."""
        pitch, roll = math.radians(self.pitch_deg), math.radians(self.roll_deg)
        y = (depth - (self.height_m - level) * math.sin(pitch)) / math.cos(pitch)
        up = y * math.sin(pitch) - (self.height_m - level) * math.cos(pitch)
        right = depth * (column - 0.5 * WIDTH) / self.focal_px
        return (right - up * math.sin(roll)) / math.cos(roll), y


@dataclass(frozen=True, slots=True, kw_only=True)
class Lens:
    """A thin lens.

    Attributes:
        focal_mm: focal length [mm].
        f_number: focal length by the diameter of the entrance pupil [1].
        focus_m: distance of the focal plane along the optical axis [m].
        blades: of the aperture, which keeps the area of the round one; 0: round.
        turn_deg: of the blades about the optical axis [deg].
        cat_eye: in the frame's corners, how far the front of the barrel has moved over the
            aperture, by the aperture's radius: 0 nowhere, 1 up to its middle [1].
    """

    focal_mm: float
    f_number: float
    focus_m: float
    blades: int = 0
    turn_deg: float = 0.0
    cat_eye: float = 0.0

    @property
    def coc_at_infinity_px(self) -> float:
        """CoC diameter of what is infinitely far, in pixels of a picture WIDTH wide [px]."""
        f = self.focal_mm * 1e-3
        return f / self.f_number * f / (self.focus_m - f) * WIDTH / (SENSOR_MM * 1e-3)

    @property
    def blender_f_number(self) -> float:
        """The f-number that makes Cycles, whose sensor stays at f, obey the thin lens's law.

        The corners of a bladed aperture lie on Cycles' circle, which is larger for that.
        """
        bare = self.f_number * (self.focus_m - self.focal_mm * 1e-3) / self.focus_m
        if self.blades == 0:
            return bare
        area = 0.5 * self.blades * math.sin(2.0 * math.pi / self.blades)
        return bare * math.sqrt(area / math.pi)

    def coc_px(self, depth: npt.ArrayLike) -> Floats:
        """Signed CoC diameter [px], positive nearer than the focal plane, of a depth [m]."""
        return self.coc_at_infinity_px * (self.focus_m / np.asarray(depth, np.float64) - 1.0)


def draw_view(seed: int, camera: str = "usual") -> View:
    """The camera of a scene, looking past the place where the object stands.

    Args:
        seed: names the scene.
        camera: `usual`; `wild`: more pitches, wider lenses, roll, and bare scenes; `built`;
            `hard`: a ground whose blur is hard to read; or `backed`: the object's shadow falls on
            what stands behind it.
    """
    rng = np.random.default_rng([seed, 0])
    setting = str(rng.choice(list(DISTANCES)))
    ground = ""
    if camera == "hard":
        ground = list(HARD_GROUNDS)[seed % len(HARD_GROUNDS)]
        setting = str(rng.choice(HARD_GROUNDS[ground]))
    low, high = DISTANCES[setting]
    distance = math.exp(rng.uniform(math.log(low), math.log(high)))
    focal = math.exp(rng.uniform(*np.log(FOCALS_MM[camera])))
    focal_px = focal / SENSOR_MM * WIDTH
    pitch = rng.uniform(*PITCHES_DEG[camera])
    column, row = rng.uniform(-0.22, 0.22) * WIDTH, rng.uniform(-0.02, 0.28) * HEIGHT
    size = rng.uniform(0.14, 0.36) * WIDTH * distance / focal_px
    slope = math.radians(pitch)
    down = distance * row / focal_px
    roll = np.random.default_rng([seed, 7]).uniform(-1.0, 1.0) * ROLL_DEG[camera]
    return View(
        seed=seed,
        setting=setting,
        focal_mm=round(focal, 1),
        pitch_deg=round(pitch, 2),
        height_m=distance * math.sin(slope) + down * math.cos(slope),
        place=(
            distance * column / focal_px,
            distance * math.cos(slope) - down * math.sin(slope),
        ),
        size_m=float(np.clip(size, *OBJECT_M)),
        roll_deg=round(roll, 2) + 0.0,
        bare=camera == "wild" and seed % BARE_EVERY == 0,
        built=camera == "built",
        ground=ground,
        back=BACKS[seed % len(BACKS)] if camera == "backed" else "",
    )


def kept_unseen(seed: int) -> bool:
    """Whether a scene on hard ground is one of the third that nobody looks at or tunes on."""
    return seed // len(HARD_GROUNDS) % 3 == 2


def draw_lens(view: View, focus: str, depths_m: tuple[float, float, float]) -> Lens:
    """The lens of one picture: its largest CoC is drawn, its f-number follows.

    Args:
        view: camera.
        focus: `front`, `mid` or `back` of the object.
        depths_m: the object's nearest, median and farthest depth [m].
    """
    near, middle, far = depths_m
    focus_m = {"front": FRONT * near, "mid": middle, "back": BACK * far}[focus]
    focus_m = max(focus_m, 3.0e-3 * view.focal_mm)
    rng = np.random.default_rng([view.seed, 1 + FOCUSES.index(focus)])
    smallest, most = HARD_COC_PX if view.ground else (16.0, 0.98 * MAX_COC_PX)
    largest = math.exp(rng.uniform(math.log(smallest), math.log(most)))
    ends = focus_m / view.nearest_m - 1.0, 1.0 - focus_m / view.farthest_m
    infinity = largest / max(ends)
    unit = Lens(focal_mm=view.focal_mm, f_number=1.0, focus_m=focus_m)
    f_number = max(FASTEST, math.ceil(100.0 * unit.coc_at_infinity_px / infinity) / 100.0)
    lens = Lens(focal_mm=view.focal_mm, f_number=f_number, focus_m=focus_m)
    return _real_lens(lens, rng) if view.ground else lens


def _real_lens(lens: Lens, rng: np.random.Generator) -> Lens:
    """With an f-number that is sold, two in three with blades, two in three with a cat's eye."""
    blades = int(rng.choice([0, 5, 6, 7]))
    return replace(
        lens,
        f_number=float(np.clip(lens.f_number, *HARD_F_NUMBERS)),
        blades=blades if rng.random() < 0.89 else 0,
        turn_deg=round(rng.uniform(0.0, 360.0), 1),
        cat_eye=round(max(0.0, rng.uniform(-0.4, 0.8)), 2),
    )


def matrices(view: View, near_m: float = 0.05, far_m: float = 2000.0) -> dict[str, Any]:
    """Camera matrices for params.json, row by row: world to camera in both worlds, projection."""
    pitch, roll = math.radians(view.pitch_deg), math.radians(view.roll_deg)
    c, s, h = math.cos(pitch), math.sin(pitch), view.height_m
    turn = np.eye(4)
    turn[:2, :2] = [[math.cos(roll), math.sin(roll)], [-math.sin(roll), math.cos(roll)]]
    blender = turn @ [[1, 0, 0, 0], [0, s, c, -c * h], [0, -c, s, -s * h], [0, 0, 0, 1]]
    gltf = turn @ [[1, 0, 0, 0], [0, c, -s, -c * h], [0, s, c, -s * h], [0, 0, 0, 1]]
    x, y = 2.0 * view.focal_px / WIDTH, 2.0 * view.focal_px / HEIGHT
    a = (far_m + near_m) / (near_m - far_m)
    b = 2.0 * far_m * near_m / (near_m - far_m)
    return {
        "view_matrix_blender": blender.tolist(),
        "view_matrix_gltf": gltf.tolist(),
        "projection_matrix_opengl": [[x, 0, 0, 0], [0, y, 0, 0], [0, 0, a, b], [0, 0, -1, 0]],
        "near": near_m,
        "far": far_m,
    }
