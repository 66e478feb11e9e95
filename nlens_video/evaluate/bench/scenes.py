"""Built-in scenes of `bench`: an object and its lens each, one difficulty of the reblur each.

Each object covers about 200x400 of 960x512 pixels, with CoC to +-28 px. The CoC is given, so that
the reblur alone is measured.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
from msgspec import Struct

from nlens_video.core.color import transfer
from nlens_video.core.layers import UInt8
from nlens_video.core.lens_fit import LensFit
from nlens_video.evaluate.bench.glb_writer import Joint, TexturedMesh, write_glb
from nlens_video.evaluate.bench.shapes import (
    HEIGHT,
    WIDTH,
    YFOV,
    Place,
    SceneLens,
    card,
    rectangle,
    tube,
)

_OPTICS = SceneLens(slope=112.0, intercept=-56.0)  # from +28 px at 4/3 to -28 px at 4 scene units
_CLOSE = SceneLens(slope=350.0, intercept=-181.5)  # steeper, for a figure of less depth
_TOPS = (7, 2, 9, 0, 5, 10, 3, 8, 1, 6, 4)  # where the rods begin and end, in steps of 19 px
_FEET = (3, 9, 5, 1, 10, 6, 7, 2, 8, 0, 4)


class SceneModel(Struct, frozen=True):
    """Surfaces, the lens that sees them, the skeleton that carries them."""

    optics: SceneLens
    surfaces: tuple[TexturedMesh, ...]
    joints: tuple[Joint, ...] = ()


class BuiltScene(Struct, frozen=True, kw_only=True):
    """A scene of `bench` on disk, what is hard about it, and its lens in the frame's pixels."""

    name: str
    about: str
    glb: Path
    fit: LensFit


def write_scenes(folder: Path, size: tuple[int, int]) -> list[BuiltScene]:
    """Write the scenes' files for frames of 960x512 pixels, or a fraction of both."""
    scenes = []
    for name, (about, draw) in _SCENES.items():
        drawn = draw()
        glb = folder / f"{name.replace(' ', '_')}.glb"
        write_glb(glb, drawn.surfaces, YFOV, drawn.joints)
        optics = drawn.optics
        fit = LensFit(slope=optics.slope, intercept=optics.intercept, width=WIDTH, height=HEIGHT)
        scenes.append(BuiltScene(name=name, about=about, glb=glb, fit=fit.for_width(*size)))
    return scenes


def plate(size: tuple[int, int]) -> UInt8:
    """A softly blurred plate with detail of every size, display-coded RGB (H, W, 3)."""
    rng = np.random.default_rng(7)
    light = np.full((size[1], size[0], 3), 0.3, np.float32)
    for octave in range(2, 7):
        noise = rng.random((max(2, HEIGHT >> octave), max(2, WIDTH >> octave), 3), np.float32)
        light += 0.2 * cv2.resize(noise - 0.5, size, interpolation=cv2.INTER_CUBIC)
    blurred = cv2.GaussianBlur(light, (0, 0), 4.0 * size[0] / WIDTH)
    coded = transfer("iec61966-2-1").encode(np.clip(blurred, 0.01, 1.0).astype(np.float64))
    return np.asarray(np.round(255 * coded), np.uint8)


def _slab() -> SceneModel:
    sides = rectangle(Place(380, 0, 28.0), Place(580, 0, -28.0), (56, 456))
    return SceneModel(_OPTICS, (card(_OPTICS, sides, 1),))


def _near_over_far() -> SceneModel:
    far = rectangle(Place(380, 0, 2.0), Place(580, 0, -6.0), (56, 456))
    near = rectangle(Place(445, 0, 27.0), Place(515, 0, 24.0), (90, 422))
    return SceneModel(_OPTICS, (card(_OPTICS, far, 2), card(_OPTICS, near, 3, 0.12)))


def _far_over_near() -> SceneModel:
    far = rectangle(Place(380, 0, -24.0), Place(580, 0, -28.0), (56, 456))
    near = rectangle(Place(445, 0, 2.0), Place(515, 0, -1.0), (90, 422))
    return SceneModel(_OPTICS, (card(_OPTICS, far, 4, 0.5), card(_OPTICS, near, 5, 0.2)))


def _rods() -> SceneModel:
    rods = []
    for number, (top, foot) in enumerate(zip(_TOPS, _FEET, strict=True)):
        near = 28.0 - 5.6 * number
        ends = (Place(385 + 19 * top, 60, near), Place(385 + 19 * foot, 452, 4.0 - 0.6 * near))
        path = np.linspace(_OPTICS.point(ends[0]), _OPTICS.point(ends[1]), 6)
        wide = 1.5 + 0.5 * (number % 5)
        radii = np.linspace(_OPTICS.size(ends[0], wide), _OPTICS.size(ends[1], wide), 6)
        rods.append(tube(path, radii.tolist(), 10 + number, lit=False))
    return SceneModel(_OPTICS, tuple(rods))


def _figure() -> SceneModel:
    """A body with arms and legs, one arm bent before the chest, the other stretched back."""
    at = {
        name: _CLOSE.point(Place(x, y, 0.0))
        for name, (x, y) in {
            "hip": (480, 290), "right shoulder": (430, 165), "right elbow": (360, 170),
            "left shoulder": (530, 165), "left elbow": (600, 170), "right leg": (450, 300),
            "right knee": (448, 375), "left leg": (510, 300), "left knee": (512, 375),
        }.items()
    }  # fmt: skip
    x, y, z = np.eye(3)
    joints = (
        Joint(at=at["hip"]),
        Joint(at=at["right shoulder"], parent=0, turn=_turn(y, 55.0)),
        Joint(at=at["right elbow"], parent=1, turn=_turn(y, 80.0)),
        Joint(at=at["left shoulder"], parent=0, turn=_turn(y, 60.0)),
        Joint(at=at["left elbow"], parent=3, turn=_turn(z, 40.0)),
        Joint(at=at["right leg"], parent=0, turn=_turn(x, -28.0)),
        Joint(at=at["right knee"], parent=5, turn=_turn(x, 35.0)),
        Joint(at=at["left leg"], parent=0, turn=_turn(x, 22.0)),
        Joint(at=at["left knee"], parent=7, turn=_turn(x, 20.0)),
    )
    parts = (
        ([(480, 312), (480, 240), (480, 165), (480, 148)], [34, 42, 48, 22], [0, 0, 0, 0]),
        ([(480, 150), (480, 130), (480, 100), (480, 70), (480, 58)], [14, 30, 40, 30, 8], [0] * 5),
        ([(440, 165), (395, 168), (360, 170), (320, 172), (290, 174)], [17, 15, 13, 12, 13],
         [1, 1, 2, 2, 2]),
        ([(520, 165), (565, 168), (600, 170), (640, 172), (670, 174)], [17, 15, 13, 12, 13],
         [3, 3, 4, 4, 4]),
        ([(452, 295), (449, 340), (448, 375), (447, 420), (446, 448)], [24, 20, 17, 14, 18],
         [5, 5, 6, 6, 6]),
        ([(508, 295), (511, 340), (512, 375), (513, 420), (514, 448)], [24, 20, 17, 14, 18],
         [7, 7, 8, 8, 8]),
    )  # fmt: skip
    middle = Place(480, 256, 0.0)
    surfaces = tuple(
        tube(
            np.array([_CLOSE.point(Place(x, y, 0.0)) for x, y in path]),
            [_CLOSE.size(middle, radius) for radius in radii],
            30 + number,
            joints=carried,
        )
        for number, (path, radii, carried) in enumerate(parts)
    )
    return SceneModel(_CLOSE, surfaces, joints)


def _turn(axis: np.ndarray, degrees: float) -> tuple[float, float, float, float]:
    """Quaternion of a turn about an axis."""
    half = math.radians(degrees) / 2.0
    x, y, z = (math.sin(half) * axis).tolist()
    return (x, y, z, math.cos(half))


# The first is one that calls for every node, so that start-up is the whole of it.
_SCENES: dict[str, tuple[str, Callable[[], SceneModel]]] = {
    "near over far": ("a card at +26 px before one in focus", _near_over_far),
    "far over near": ("a card in focus before one at -26 px", _far_over_near),
    "thin rods": ("eleven rods 3 to 7 px wide that cross at all depths", _rods),
    "skinned figure": ("an arm before the chest, one away from the lens", _figure),
    "tilted slab": ("one card through the focus, from +28 to -28 px", _slab),
}
