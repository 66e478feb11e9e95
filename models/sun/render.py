"""Picture of a training scene by ray casting: sun or lamps, sky, light from the ground, defocus."""

from __future__ import annotations

import math
from functools import cache

import cv2
import numpy as np
import numpy.typing as npt
from embreex.mesh_construction import TriangleMesh
from embreex.rtcore_scene import EmbreeScene

from models.sun.ground import Ground, Texture, draw_color
from models.sun.scene import Scene
from models.sun.shapes import Floats, Rng

Float32 = npt.NDArray[np.float32]
OVER = 1.3
"""Rays along each side of a pixel."""
SKY_RAYS = 5
LABEL_PX = 4
"""Pixels of a picture along each side of a pixel of its labels."""
_OFF = 2e-3  # from a surface, where rays to the light begin, by its distance
_BOUNCED = 0.25  # radiance of what hides the sky, by the ground's light
_BLURS = (0.0, 1.0, 2.0, 4.0, 7.0)  # diameters of discs that pictures are blurred by [px]
_MOST_BLUR = 7.0


class Traced:
    """What rays from the camera meet, P of them, one at a random place of each pixel.

    Attributes:
        unit: their directions (P, 3).
        distance: of what they meet, inf for the sky (P,) [camera heights].
        triangle: which of the scene's, -1 for ground and sky (P,).
        seen: whether they meet anything near (P,).
        is_ground: whether that is the ground (P,).
        points: where (P, 3) [camera heights].
        normals: of the surface there, towards the camera (P, 3).
        seen_from: the points, a little off the surface: rays to the light begin there (P, 3).
        material: of each triangle (T,); only where the scene has any.
    """

    def __init__(self, scene: Scene, rng: Rng, columns: int, rows: int) -> None:
        self._scene = EmbreeScene()
        x, y = np.meshgrid(np.arange(columns), np.arange(rows))
        places = np.stack([x.ravel(), y.ravel()], axis=1) + rng.random((columns * rows, 2))
        rays = scene.camera.rays(places / (columns, rows))
        self._build(scene)
        eye = np.array([0.0, 1.0, 0.0])
        unit = rays / np.linalg.norm(rays, axis=1, keepdims=True)
        self.unit = unit
        ground = np.where(unit[:, 1] < -1e-4, -1.0 / np.minimum(unit[:, 1], -1e-4), np.inf)
        self.distance, self.triangle = ground, np.full(len(unit), -1)
        if self._triangles is not None:
            origins = np.broadcast_to(eye, unit.shape).astype(np.float32)
            hit = self._scene.run(origins, unit.astype(np.float32), query="INTERSECT", output=1)
            nearer = (hit["primID"] >= 0) & (hit["tfar"] < ground)
            self.distance = np.where(nearer, hit["tfar"], ground)
            self.triangle = np.where(nearer, hit["primID"], -1)
        self.seen = np.isfinite(self.distance) & (self.distance < 400.0)
        self.is_ground = self.seen & (self.triangle < 0)
        self.points = eye + unit * np.where(self.seen, self.distance, 0.0)[:, None]
        self.normals = np.tile(np.float32([0.0, 1.0, 0.0]), (len(unit), 1))
        there = self.triangle >= 0
        if there.any():
            self.normals[there] = self._normals(self.triangle[there], self.points[there])
            away = (self.normals * unit).sum(axis=1) > 0.0
            self.normals[away & there] *= -1.0
        off = _OFF * np.clip(self.distance, 0.3, 20.0)[:, None]
        self.seen_from = np.float32(self.points + off * self.normals)

    def _build(self, scene: Scene) -> None:
        triangles, material, smooth, middles = [], [], [], []
        for number, thing in enumerate(scene.things):
            for part in thing.parts:
                corners = part.vertices[part.faces]
                triangles.append(corners)
                material.append(np.full(len(corners), 3 * number + part.material))
                smooth.append(np.full(len(corners), part.smooth))
                low, high = part.vertices.min(axis=0), part.vertices.max(axis=0)
                box = np.stack([0.5 * (low + high), np.maximum(high - low, 1e-6)])
                middles.append(np.broadcast_to(box, (len(corners), 2, 3)))
        self._triangles = np.concatenate(triangles) if triangles else None
        if self._triangles is None:
            return
        self.material, self._smooth = np.concatenate(material), np.concatenate(smooth)
        self._boxes = np.concatenate(middles)
        TriangleMesh(self._scene, self._triangles.astype(np.float32))
        a, b, c = self._triangles.transpose(1, 0, 2)
        normal = np.cross(b - a, c - a)
        self._flat = normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)

    def _normals(self, triangles: npt.NDArray[np.int64], points: Floats) -> Floats:
        """Of faces, and of balls, whose axes are nearly those of their boxes."""
        flat = self._flat[triangles]
        middle, size = self._boxes[triangles].transpose(1, 0, 2)
        round_ = (points - middle) / size**2
        round_ /= np.maximum(np.linalg.norm(round_, axis=1, keepdims=True), 1e-12)
        round_ *= np.sign((round_ * flat).sum(axis=1, keepdims=True))
        close = self._smooth[triangles] & ((round_ * flat).sum(axis=1) > 0.8)
        return np.where(close[:, None], round_, flat)

    def blocked(self, origins: Floats, directions: Floats) -> npt.NDArray[np.bool_]:
        """Whether something stands in the way (P,)."""
        if self._triangles is None:
            return np.zeros(len(origins), np.bool_)
        found = self._scene.run(
            origins.astype(np.float32), directions.astype(np.float32), query="OCCLUDED"
        )
        return np.asarray(found) >= 0

    def blocked_before(self, origins: Floats, ends: Floats) -> npt.NDArray[np.bool_]:
        """Whether something stands between points (P, 3) (P,)."""
        if self._triangles is None:
            return np.zeros(len(origins), np.bool_)
        hit = self._scene.run(
            origins.astype(np.float32), (ends - origins).astype(np.float32), query="INTERSECT",
            output=1,
        )  # fmt: skip
        return np.asarray((hit["primID"] >= 0) & (hit["tfar"] < 1.0))


def render(
    scene: Scene, ground: Ground, textures: list[Texture], rng: Rng, columns: int, rows: int
) -> tuple[Float32, Float32]:
    """A picture, scene-linear (rows, columns, 3), and its labels, a pixel for LABEL_PX of them.

    Labels are the shares of ground in the sun's shadow and of things (h, w, 2).
    """
    wide, tall = round(OVER * columns), round(OVER * rows)
    traced = Traced(scene, rng, wide, tall)
    reflectance = _reflectance(scene, traced, ground, textures, rng, wide)
    light, shaded = _light(scene, traced, float(ground.base.mean()), rng)
    sky = _backdrop(scene, traced, rng)
    picture = np.where(traced.seen[:, None], reflectance * light, sky)
    depth = np.where(traced.seen, traced.distance, 1e3)
    haze = rng.uniform(0.0, 0.02) if rng.random() < 0.3 else 0.0
    share = np.exp(-haze * depth)[:, None]
    picture = share * picture + (1.0 - share) * 0.6
    small = cv2.resize(
        np.float32(picture).reshape(tall, wide, 3), (columns, rows), interpolation=cv2.INTER_AREA
    )
    near = cv2.resize(
        np.float32(1.0 / depth).reshape(tall, wide), (columns, rows), interpolation=cv2.INTER_AREA
    )
    on_ground = np.where(traced.is_ground, shaded, np.float32(0.0))
    labels = np.stack([on_ground, np.float32(traced.triangle >= 0)], axis=1)
    labels = cv2.resize(
        labels.reshape(tall, wide, 2), (columns // LABEL_PX, rows // LABEL_PX),
        interpolation=cv2.INTER_AREA,
    )  # fmt: skip
    return (_defocused(small, near, rng) if rng.random() < 0.7 else small), labels


def _reflectance(
    scene: Scene, traced: Traced, ground: Ground, textures: list[Texture], rng: Rng, wide: int
) -> Float32:
    out = np.zeros((len(traced.seen), 3), np.float32)
    pixel = 2.0 * math.tan(0.5 * scene.camera.fov) / wide
    here = traced.is_ground
    slant = np.maximum(-traced.unit[here, 1], 0.02)
    footprint = pixel * traced.distance[here] / np.sqrt(slant)
    out[here] = ground.at(traced.points[here, 0], traced.points[here, 2], footprint)
    on_thing = np.nonzero(traced.triangle >= 0)[0]
    if not len(on_thing):
        return out
    materials = traced.material[traced.triangle[on_thing]]
    for one in np.unique(materials):
        where = on_thing[materials == one]
        base = draw_color(rng) if rng.random() < 0.85 else ground.base
        texture = textures[int(rng.integers(len(textures)))]
        contrast = float(rng.choice([0.0, rng.uniform(0.1, 1.0)]))
        scale = math.exp(rng.uniform(math.log(0.3), math.log(5.0)))
        axis = np.abs(traced.normals[where]).argmax(axis=1)
        others = np.array([[2, 1], [0, 2], [0, 1]])[axis]
        places = np.take_along_axis(traced.points[where], others, axis=1) * scale
        found = texture.at(places, scale * pixel * traced.distance[where])
        out[where] = base * found ** np.float32(contrast)
    return out


def _light(
    scene: Scene, traced: Traced, ground_reflectance: float, rng: Rng
) -> tuple[Float32, Float32]:
    """Light on all points (P, 3), by that of the whole sky on level ground; where a shadow is."""
    light = scene.light
    count = len(traced.seen)
    out = np.zeros((count, 3), np.float32)
    seen = traced.seen
    origins, normals = traced.seen_from[seen], traced.normals[seen]
    some = len(origins)
    around = np.zeros(some, np.float32)
    on_ground = 1.0
    if light.toward is not None:
        on_ground = 1.0 / light.left
    elif len(light.powers):
        on_ground = 1.0 + 0.5 * float(light.powers.sum())
    for _ in range(SKY_RAYS):
        direction = normals + _on_sphere(rng, some)
        size = np.sqrt(np.maximum(np.einsum("ij,ij->i", direction, direction), 1e-9))
        low = direction[:, 1] < 0.0
        hidden = traced.blocked(origins, direction) | low
        sky = np.maximum(1.0 + direction @ np.float32(light.tilt) / size, 0.1)
        bounced = np.where(low, ground_reflectance * on_ground, _BOUNCED * on_ground)
        around += np.where(hidden, bounced, sky)
    around = np.repeat(around[:, None] / SKY_RAYS, 3, axis=1)
    shaded = np.zeros(count, np.float32)
    if light.toward is not None:
        disc = light.toward + light.radius * _on_disc(rng, some, light.toward)
        cosine = np.maximum(normals @ light.toward, 0.0)
        blocked = traced.blocked(origins, disc)
        free = (cosine > 0.0) & ~blocked
        shaded[seen] = blocked
        strength = (1.0 / light.left - 1.0) / light.toward[1]
        around += (strength * cosine * free)[:, None] * light.tint
    for lamp, power in zip(light.lamps, light.powers, strict=True):
        end = lamp + light.lamp_radius * _on_sphere(rng, some)
        way = end - origins
        square = np.maximum((way**2).sum(axis=1), 0.05)
        cosine = np.maximum((normals * way).sum(axis=1) / np.sqrt(square), 0.0)
        free = ~traced.blocked_before(origins, end)
        around += (power * 8.0 * cosine * free / square)[:, None] * light.tint
    out[seen] = around
    return out, shaded


@cache
def _sphere() -> Float32:
    """Points (1 << 19, 3) on the unit sphere."""
    points = np.random.default_rng(0).standard_normal((1 << 19, 3)).astype(np.float32)
    return np.asarray(points / np.linalg.norm(points, axis=1, keepdims=True))


def _on_sphere(rng: Rng, count: int) -> Float32:
    start = int(rng.integers(len(_sphere()) - count))
    return _sphere()[start : start + count]


def _on_disc(rng: Rng, count: int, axis: Floats) -> Floats:
    points = _on_sphere(rng, count) * np.sqrt(rng.random((count, 1)))
    return np.asarray(points - (points @ axis)[:, None] * axis)


def _backdrop(scene: Scene, traced: Traced, rng: Rng) -> Floats:
    """Sky or haze where nothing is met (P, 3)."""
    up = np.clip(traced.unit[:, 1:2], 0.0, 1.0)
    blue = rng.uniform(0.0, 0.5)
    low = np.exp(rng.normal(0.0, 0.1, 3)) * (1.0 - 0.3 * blue, 1.0, 1.0 + 0.3 * blue)
    high = rng.uniform(0.4, 1.0) * np.array([1.0 - blue, 1.0 - 0.5 * blue, 1.0 + 0.2 * blue])
    level = rng.uniform(0.4, 1.5)
    if scene.light.toward is not None:
        level *= min(1.0 / scene.light.left, 4.0) ** 0.7
    return np.asarray(level * (low + (high - low) * np.sqrt(up)))


def _defocused(picture: Float32, near: Float32, rng: Rng) -> Float32:
    """Through a lens: blurred by the distance from a plane in focus."""
    usual = near[near > 0.003]
    if not len(usual):
        return picture
    focus = float(np.quantile(usual, rng.uniform(0.05, 0.95)))
    spread = max(float(np.quantile(np.abs(usual - focus), 0.9)), 1e-6)
    most = math.exp(rng.uniform(math.log(0.5), math.log(_MOST_BLUR)))
    coc = np.clip(most * np.abs(near - focus) / spread, 0.0, _MOST_BLUR)
    coc = cv2.GaussianBlur(coc, (0, 0), 1.0)
    blurred = [picture]
    for size in _BLURS[1:]:
        radius = math.ceil(0.5 * size + 0.5)
        y, x = np.mgrid[-radius : radius + 1, -radius : radius + 1]
        disc = np.clip(0.5 * size + 0.5 - np.hypot(x, y), 0.0, 1.0)
        blurred.append(cv2.filter2D(picture, -1, np.float32(disc / disc.sum())))
    out = np.zeros_like(picture)
    for k, one in enumerate(blurred):
        low = _BLURS[k - 1] if k else -1.0
        high = _BLURS[k + 1] if k + 1 < len(_BLURS) else _BLURS[k] + 1.0
        rising, falling = (coc - low) / (_BLURS[k] - low), (high - coc) / (high - _BLURS[k])
        out += np.clip(np.minimum(rising, falling), 0.0, 1.0)[..., None] * one
    return out
