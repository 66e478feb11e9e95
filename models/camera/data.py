"""Pictures with known cameras, from rendered views: crops of them, photographed in many ways.

    python -m models.camera.data --views /tmp/views --out /tmp/camera.npz --crops 5

`--views` is a folder that `render.py` filled. Every view gives crops as if the camera had been
turned and zoomed in, of six aspects; then exposure, white balance, contrast,
blur, noise and JPEG change. One scene in ten is kept apart.
"""

from __future__ import annotations

import argparse
import json
import math
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt
import OpenEXR
from scipy.spatial.transform import Rotation

from nlens_video.core.color import transfer
from nlens_video.core.layers import Float64, UInt8
from nlens_video.solve.still.picture_cue import AREA_PX, picture_features, size_of_area

ASPECTS, SHARES = (1.875, 16 / 9, 1.5, 4 / 3, 0.75, 9 / 16), (0.4, 0.3, 0.1, 0.1, 0.06, 0.04)
SENSOR_MM = 36.0
APART = 10
"""One scene in so many is kept apart."""
_ZOOM, _SLIGHT, _TURNS_DEG = 0.6, 0.06, (2.0, 2.0, 3.0)
_SHARE = 0.9  # pixels of a crop, by AREA_PX
_TRIES = 12
_FLAT = 6.0  # deviation of code values below which a picture shows nothing
_WHITE = 0.45  # light that the brightest tenth is exposed to
_AFTER_ZOOM = 0.35  # deviation of the blur before a reduction [px of the result]


@dataclass(frozen=True, slots=True)
class Camera:
    """Pitch, roll [rad] and focal length [px] of a picture."""

    pitch: float
    roll: float
    focal_px: float


@dataclass(frozen=True, slots=True)
class View:
    """A rendered picture, sRGB (H, W, 3), its camera and its scene's number."""

    rgb: UInt8
    camera: Camera
    scene: int


def load_view(path: Path) -> View | None:
    """Read a view by its JSON file; None where it shows nothing."""
    truth = json.loads(path.read_text())
    light = np.asarray(OpenEXR.File(str(path.with_suffix(".exr"))).channels()["RGB"].pixels)
    scene = int(path.stem.split("_")[0])
    exposure = _WHITE * math.exp(np.random.default_rng([scene, 6]).normal(0.0, 0.25))
    light = light.astype(np.float32) * exposure / max(np.percentile(light.mean(axis=2), 90), 1e-6)
    code = transfer("iec61966-2-1").to_coded(np.clip(light, 0.0, 1.0))
    rgb = np.uint8(255.0 * code + 0.5)
    focal_px = truth["focal_mm"] / SENSOR_MM * rgb.shape[1]
    camera = Camera(-math.radians(truth["pitch_deg"]), math.radians(truth["roll_deg"]), focal_px)
    return None if rgb.std() < _FLAT else View(rgb, camera, scene)


def draw_crop(rng: np.random.Generator, view: View) -> tuple[UInt8, Camera]:
    """What a camera turned and zoomed from the view's sees."""
    size = size_of_area(_SHARE * AREA_PX, float(rng.choice(ASPECTS, p=SHARES)))
    height, width = view.rgb.shape[:2]
    fit = min(width / size[0], height / size[1])
    old = view.camera
    for attempt in range(_TRIES + 1):  # smaller turns until the crop lies inside the view
        share = 1.0 - attempt / _TRIES
        pitch, roll, yaw = share * np.radians(rng.normal(0.0, _TURNS_DEG))
        zoom = abs(rng.normal(0.0, _SLIGHT)) if rng.random() < 0.5 else rng.uniform(0.0, _ZOOM)
        zoom = 1.0 + share * zoom
        new = Camera(old.pitch + pitch, old.roll + roll, old.focal_px / fit * zoom)
        turned = _attitude(old, 0.0).T @ _attitude(new, yaw)
        to_view = _matrix(old.focal_px, (width, height)) @ turned
        to_view = to_view @ np.linalg.inv(_matrix(new.focal_px, size))
        corners = np.array([[x, y, 1.0] for x in (0, size[0] - 1) for y in (0, size[1] - 1)])
        ends = corners @ to_view.T
        ends = ends[:, :2] / ends[:, 2:]
        if ends.min() >= -1.0 and (ends.max(axis=0) <= (width, height)).all():
            break
    rgb = view.rgb
    if fit / zoom > 1.3:
        rgb = cv2.GaussianBlur(rgb, (0, 0), _AFTER_ZOOM * fit / zoom)
    rgb = cv2.warpPerspective(
        rgb, to_view, size, flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
        borderMode=cv2.BORDER_REFLECT_101,
    )  # fmt: skip
    return np.asarray(rgb, np.uint8), new


def _attitude(camera: Camera, yaw: float) -> Float64:
    angles = [yaw, camera.pitch, camera.roll]
    return np.asarray(Rotation.from_euler("YXZ", angles).as_matrix())


def _matrix(focal_px: float, size: tuple[int, int]) -> Float64:
    """Camera coordinates (x right, y up, looking along -z) to pixels."""
    x, y = 0.5 * size[0] - 0.5, 0.5 * size[1] - 0.5
    return np.array([[focal_px, 0.0, -x], [0.0, -focal_px, -y], [0.0, 0.0, -1.0]])


def photographed(rng: np.random.Generator, rgb: UInt8) -> UInt8:
    """The picture with another exposure, white balance, contrast, blur, noise and coding."""
    code = rgb.astype(np.float32) / 255.0
    if rng.random() < 0.25:
        code = cv2.GaussianBlur(code, (0, 0), rng.uniform(0.3, 1.2))
    code *= np.exp(rng.normal(0.0, 0.08, 3) + rng.normal(0.0, 0.15)).astype(np.float32)
    code = np.clip(code, 0.0, 1.0) ** np.float32(math.exp(rng.normal(0.0, 0.2)))
    if rng.random() < 0.6:
        noise = rng.standard_normal(code.shape, dtype=np.float32)
        code += np.float32(rng.uniform(0.0, 0.03)) * noise
    rgb = np.uint8(255.0 * np.clip(code, 0.0, 1.0))
    if rng.random() < 0.3:
        quality = [cv2.IMWRITE_JPEG_QUALITY, int(rng.integers(50, 95))]
        rgb = cv2.imdecode(cv2.imencode(".jpg", rgb, quality)[1], cv2.IMREAD_COLOR)
    return np.asarray(rgb, np.uint8)


@dataclass(frozen=True, slots=True)
class Examples:
    """Features and cameras.

    Attributes:
        features: (N, ROWS, COLUMNS, CHANNELS) in half precision.
        cameras: pitch, roll [rad], logarithm of the focal length by the root of the area (N, 3).
        aspects: logarithms of width by height (N,).
        scenes: numbers of the scenes (N,).
    """

    features: npt.NDArray[np.float16]
    cameras: npt.NDArray[np.float32]
    aspects: npt.NDArray[np.float32]
    scenes: npt.NDArray[np.int64]

    @classmethod
    def load(cls, path: Path) -> Examples:
        """Read what `main` wrote."""
        with np.load(path) as file:
            return cls(**{name: file[name] for name in cls.__slots__})

    def part(self, *, apart: bool) -> Examples:
        """Of the scenes kept apart, or of the others."""
        picked = (self.scenes % APART == 0) == apart
        return Examples(*(getattr(self, name)[picked] for name in self.__slots__))


def draw_examples(views: list[View], crops: int, seed: int) -> Examples:
    """Crops of each view."""
    features, cameras, aspects, scenes = [], [], [], []
    for number, view in enumerate(views):
        rng = np.random.default_rng([seed, number])
        for _ in range(crops):
            rgb, camera = draw_crop(rng, view)
            height, width = rgb.shape[:2]
            features.append(picture_features(photographed(rng, rgb)).astype(np.float16))
            focal = math.log(camera.focal_px / math.sqrt(width * height))
            cameras.append((camera.pitch, camera.roll, focal))
            aspects.append(math.log(width / height))
            scenes.append(view.scene)
    return Examples(
        np.array(features), np.float32(cameras), np.float32(aspects), np.array(scenes, np.int64)
    )


def main() -> None:
    """Draw the examples of a folder of views."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--views", type=Path, required=True, help="folder that render.py filled")
    parser.add_argument("--out", type=Path, required=True, help="the examples (.npz)")
    parser.add_argument("--crops", type=int, default=5, help="of each view")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    cv2.setNumThreads(1)
    found = [load_view(path) for path in sorted(options.views.glob("*.json"))]
    views = [view for view in found if view is not None]
    examples = draw_examples(views, options.crops, options.seed)
    np.savez(options.out, **{name: getattr(examples, name) for name in examples.__slots__})
    print(f"{len(examples.scenes)} examples of {len(views)} views")


if __name__ == "__main__":
    main()
