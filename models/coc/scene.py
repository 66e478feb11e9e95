"""Scenes through a thin lens: planes in perspective, things on them, their light and their CoC.

On a plane disparity is affine in the picture, so the signed CoC is too: `coc = c0 + A * (d - 1)`
with `d` the disparity relative to the middle of the picture. A ground plane runs to its vanishing
line or into a wall; things stand on it or hang before it, each scattered with its own CoC and laid
over what lies behind.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

from models.coc.degrade import photographed
from models.coc.optics import (
    Aperture,
    cat_eye_aperture,
    polygon_aperture,
    round_aperture,
    scatter,
)
from models.coc.textures import GRAINED_SHARE, Photos, grained, noise, surface

Float32 = npt.NDArray[np.float32]
Rng = np.random.Generator
SIZE = 512  # edge of a finished picture: the network learns to look as far around [px]
MARGIN = 32  # what light can come from beyond the border [px]
MAX_COC_PX = 64.0
PHOTO_SHARE = 0.4
TEXTURE_SIZE = 648
MOST_TAPS = 5  # of one pixel on the texture
RENDERED_SHARE = 0.45  # of the pictures carry the noise of a lens sampled by a path tracer


@dataclass(frozen=True, slots=True)
class Layout:
    """One lens and the plane (or ground and wall) that fills the picture.

    Attributes:
        disparity: of the surface in each pixel, 1 in the middle of the plane (N, N).
        slope: CoC per relative disparity [px].
        offset: signed CoC at relative disparity 1 [px].
        down: unit vector (x, y) in the picture along which the ground comes nearer.
    """

    disparity: Float32
    slope: float
    offset: float
    down: tuple[float, float]

    def coc(self, disparity: Float32 | float) -> Float32:
        """Signed CoC diameter, positive nearer than the focus [px]."""
        return np.clip(
            self.offset + self.slope * (np.float32(disparity) - 1), -MAX_COC_PX, MAX_COC_PX
        ).astype(np.float32)


def draw_aperture(rng: Rng) -> Aperture:
    """Round mostly, else five to nine blades or a disc cut by vignetting."""
    kind = rng.random()
    if kind < 0.75:
        return round_aperture()
    if kind < 0.9:
        return polygon_aperture(int(rng.integers(5, 10)), rng.uniform(0, np.pi))
    return cat_eye_aperture(rng.uniform(0.1, 0.6), rng.uniform(0, 2 * np.pi))


def draw_coc(rng: Rng) -> float:
    """A CoC: 8 % to 1 px, 52 % log-uniform to 45, 35 % uniform to 40, 5 % to the limit."""
    kind = rng.random()
    if kind < 0.08:
        return rng.uniform(0, 1)
    if kind > 0.6:
        return rng.uniform(1, MAX_COC_PX if kind > 0.95 else 40.0)
    return float(np.exp(rng.uniform(np.log(1.3), np.log(46))) - 1)


def draw_layout(rng: Rng) -> tuple[Layout, Float32 | None]:
    """A layout and, where a wall stands on the ground, its mask."""
    size = SIZE + 2 * MARGIN
    y, x = (np.mgrid[0:size, 0:size] - (size - 1) / 2).astype(np.float32)
    offset = draw_coc(rng) * rng.choice([-1.0, 1.0])
    angle = rng.normal(np.pi / 2, 0.12) if rng.random() < 0.65 else rng.uniform(0, 2 * np.pi)
    down = (float(np.cos(angle)), float(np.sin(angle)))
    if rng.random() < 0.15:
        return Layout(np.ones((size, size), np.float32), rng.uniform(2, 30), offset, down), None
    horizon = float(np.exp(rng.uniform(np.log(40), np.log(3000))))  # distance to it [px]
    change = float(np.exp(rng.uniform(np.log(1.0), np.log(45)))) / SIZE  # CoC per px
    plane = 1 + (x * down[0] + y * down[1]) / horizon
    wall_at = rng.uniform(1 - 100 / horizon, 1 + 90 / horizon) if rng.random() < 0.5 else 0.0
    wall_at = max(wall_at, 0.03)
    slope = min(change * horizon, 400.0)
    disparity = np.maximum(plane, wall_at)
    extreme = np.abs(offset + slope * (disparity - 1)).max()
    shrink = min(1.0, MAX_COC_PX / extreme)
    wall = np.float32(plane < wall_at) if (plane < wall_at).any() else None
    return Layout(disparity, slope * shrink, offset * shrink, down), wall


def within(place: Float32, side: int) -> Float32:
    """Coordinates on a texture of `side` px that goes on as its mirror image without end.

    OpenCV's cubic `remap` holds the border's value instead where a coordinate lies more than a side
    beyond it. Coordinates [px] of any shape, in and out.
    """
    turns = np.rint(place * np.float32(0.5 / (side - 1)))
    return np.abs(place - np.float32(2 * (side - 1)) * turns)


def in_perspective(rng: Rng, layout: Layout, texture: Float32) -> Float32:
    """The ground: a square texture seen along the layout's plane, sharp to the pixel near and far.

    A texture that is magnified is soft without any defocus, and teaches the network to take blur
    for a smooth surface; so the nearest row sees about a texel a pixel, and farther rows
    smaller copies of the texture. Where the view is flat a pixel covers many texels one behind the
    other; it shows the mean of up to MOST_TAPS of them.
    """
    size = layout.disparity.shape[0]
    side = texture.shape[0]
    y, x = (np.mgrid[0:size, 0:size] - (size - 1) / 2).astype(np.float32)
    cosine, sine = layout.down
    d = np.maximum(layout.disparity, 0.02)
    scale = float(rng.uniform(0.8, 1.6) * np.quantile(d, 0.9))
    tilt, turn = np.exp(rng.uniform(0, np.log(4))), rng.uniform(0, 2 * np.pi)
    across, along = scale * (x * sine - y * cosine) / d, scale * tilt * (x * cosine + y * sine) / d
    u = across * np.cos(turn) - along * np.sin(turn) + side / 2
    v = across * np.sin(turn) + along * np.cos(turn) + side / 2
    level = np.clip(np.log2(scale / d), 0, 5).astype(np.int32)
    row = scale * tilt / d**2  # of the texture that one row of the picture runs along [px]
    seen = np.zeros((size, size, 3), np.float32)
    for step in range(int(level.max()) + 1):
        if step:
            texture = cv2.resize(texture, None, fx=0.5, fy=0.5, interpolation=cv2.INTER_AREA)
        here = level == step
        rows = np.flatnonzero(here.any(1))
        if not len(rows):
            continue
        strip = slice(rows[0], rows[-1] + 1)
        taps = int(np.clip(np.median(row[here]) * 0.5**step, 1, MOST_TAPS))
        kind = cv2.INTER_CUBIC if taps == 1 else cv2.INTER_LINEAR
        for tap in range(taps):
            aside = row[strip] * ((tap + 0.5) / taps - 0.5)
            place = (
                within((np.float32(axis) + 0.5) * 0.5**step - 0.5, len(texture))
                for axis in (u[strip] - aside * np.sin(turn), v[strip] + aside * np.cos(turn))
            )
            copy = cv2.remap(texture, *place, kind, borderMode=cv2.BORDER_REFLECT_101)
            seen[strip] += copy * (here[strip, :, None] / np.float32(taps))
    seen = np.maximum(seen, 0)
    return grained(rng, seen) if rng.random() < GRAINED_SHARE else seen


def lit(rng: Rng, linear: Float32) -> Float32:
    """Soft shadows, shading and points of light brighter than white."""
    size = linear.shape[0]
    if rng.random() < 0.22:
        mask = np.float32(noise(rng, size, rng.uniform(1.5, 2.5)) > rng.normal(0, 0.8))
        mask = cv2.GaussianBlur(mask, (0, 0), float(np.exp(rng.uniform(np.log(0.5), np.log(25)))))
        linear = linear * (1 - rng.uniform(0.1, 0.8) * mask)[..., None]
    if rng.random() < 0.25:
        linear = linear * np.exp(rng.uniform(0.1, 0.6) * noise(rng, size, 2.6))[..., None]
    if rng.random() < 0.14:
        linear = linear.copy()
        for _ in range(int(rng.integers(1, 30))):
            at = tuple(int(i) for i in rng.integers(0, size, 2))
            power = np.exp(rng.uniform(np.log(2), np.log(200)))
            colour = (power * np.exp(rng.normal(0, 0.3, 3))).tolist()
            cv2.circle(linear, at, int(rng.integers(0, 3)), colour, -1)
    return np.float32(linear)


def silhouette(rng: Rng, size: int, base: tuple[float, float], reach: float) -> Float32:
    """Coverage (size, size) of one thing that stands with its foot at `base` [px], `reach` tall."""
    mask = np.zeros((size, size), np.uint8)
    x, y = base
    kind = rng.integers(5)
    width = reach * rng.uniform(0.3, 1.5)
    if kind == 0:  # a box
        corners = np.array([[-width, 0], [width, 0], [width, -2 * reach], [-width, -2 * reach]])
        corners = corners / 2 + rng.normal(0, 0.06 * reach, (4, 2))
        cv2.fillPoly(mask, [np.int32((corners + base) * 16)], 255, cv2.LINE_AA, 4)
    elif kind == 1:  # a round thing
        centre, axes = np.int32([x * 16, (y - reach / 2) * 16]), np.int32([width * 8, reach * 8])
        angle = rng.uniform(-20, 20)
        cv2.ellipse(mask, centre.tolist(), axes.tolist(), angle, 0, 360, 255, -1, cv2.LINE_AA, 4)
    elif kind == 2:  # poles, legs, stems
        for _ in range(int(rng.integers(1, 5))):
            foot = np.array(base) + rng.normal(0, 0.4 * reach, 2) * (1, 0.1)
            head = foot + (rng.normal(0, 0.15 * reach), -1.5 * reach)
            points = [np.int32(point * 16).tolist() for point in (foot, head)]
            thick = int(rng.integers(1, 2 + int(reach / 8)))
            cv2.line(mask, points[0], points[1], 255, thick, cv2.LINE_AA, 4)
    elif kind == 3:  # a ragged outline
        angles = np.linspace(0, 2 * np.pi, 40, endpoint=False)
        wobble = 1 + 0.35 * np.convolve(rng.normal(0, 1, 40), np.ones(5) / 3, "same")
        ring = np.stack([np.cos(angles) * width, np.sin(angles) * reach], -1) * wobble[:, None] / 2
        points = np.int32((ring + (x, y - reach / 2)) * 16)
        cv2.fillPoly(mask, [points], 255, cv2.LINE_AA, 4)
    else:  # leaves
        for _ in range(int(rng.integers(8, 50))):
            centre = (np.array([x, y - reach / 2]) + rng.normal(0, 0.35 * reach, 2)) * 16
            axes = np.int32(rng.uniform(0.02, 0.12, 2) * reach * 16 + 8)
            turn = rng.uniform(0, 180)
            cv2.ellipse(
                mask,
                np.int32(centre).tolist(),
                axes.tolist(),
                turn,
                0,
                360,
                255,
                -1,
                cv2.LINE_AA,
                4,
            )
    return np.float32(mask) / 255


def add_thing(
    scene: tuple[Float32, Float32],
    thing: tuple[Float32, Float32, Float32],
    aperture: Aperture,
) -> tuple[Float32, Float32]:
    """Lay one thing over the blurred picture, with true partial occlusion at its edge.

    Args:
        scene: blurred light (N, N, C) and unsigned CoC (N, N) so far.
        thing: its sharp light (N, N, C), coverage (N, N) and signed CoC (N, N).
        aperture: the lens.
    """
    light, coc = scene
    colour, alpha, thing_coc = thing
    rows, columns = np.nonzero(alpha.max(1) > 0)[0], np.nonzero(alpha.max(0) > 0)[0]
    if not len(rows):
        return scene
    pad = int(np.abs(thing_coc).max() / 2) + 3
    box = (
        slice(max(0, rows[0] - pad), rows[-1] + pad + 1),
        slice(max(0, columns[0] - pad), columns[-1] + pad + 1),
    )
    cover = alpha[box][..., None]
    layer = np.concatenate([colour[box] * cover, cover, np.ones_like(cover)], -1)
    spread = scatter(layer, thing_coc[box], aperture)
    spread = spread[..., :-1] / np.maximum(spread[..., -1:], 0.5)
    light = light.copy()
    light[box] = light[box] * (1 - np.minimum(spread[..., -1:], 1)) + spread[..., :-1]
    return light, np.where(alpha > 0.5, np.abs(thing_coc), coc)


def draw_things(rng: Rng, layout: Layout, photos: Photos) -> list[tuple[Float32, Float32, Float32]]:
    """Things on the ground and before it, farthest first: light, coverage, signed CoC."""
    size = layout.disparity.shape[0]
    count = int(rng.choice([0, 0, 1, 2, 3, 5], p=[0.2, 0.15, 0.2, 0.2, 0.15, 0.1]))
    placed = []
    for _ in range(count):
        base = rng.uniform(0.1 * size, 1.0 * size, 2)
        reach = float(np.exp(rng.uniform(np.log(14), np.log(260))))
        at = layout.disparity[int(min(base[1], size - 1)), int(min(base[0], size - 1))]
        if rng.random() < 0.35:
            at = at * rng.uniform(1.0, 1.6)
        placed.append((float(at), base, reach))
    things = []
    for at, base, reach in sorted(placed, key=lambda place: place[0]):
        alpha = silhouette(rng, size, (base[0], base[1]), reach)
        light = surface(rng, size, photos, PHOTO_SHARE)
        if rng.random() < 0.5:
            ramp = np.linspace(-1, 1, size, dtype=np.float32)
            light = light * np.clip(1 + rng.normal(0, 0.8) * ramp, 0.1, 2)[None, :, None]
        coc = np.broadcast_to(layout.coc(at), (size, size))
        if rng.random() < 0.3:  # a side that runs away from the camera
            coc = coc + rng.normal(0, 4) * np.linspace(-1, 1, size, dtype=np.float32)[None]
        things.append((np.float32(light), alpha, np.float32(np.clip(coc, -64, 64))))
    return things


def with_squares(light: Float32) -> Float32:
    """Light and its square (N, N, 6): averaged over a disc they give the variance in it."""
    return np.concatenate([light, light * light], -1)


def path_traced(rng: Rng, moments: Float32, fewest: float = 40, most: float = 1500) -> Float32:
    """The picture that a renderer gets from `fewest` to `most` samples of the lens.

    Its noise is not that of a sensor: it is strong where a disc covers strong contrast, just where
    the blur must be read. Half of the pictures have that of the lights, too, which is the same
    share of the light everywhere.
    """
    samples = np.exp(rng.uniform(np.log(fewest), np.log(most)))
    mean, square = moments[..., :3], moments[..., 3:]
    of_lights = rng.uniform(0.3, 1.2) ** 2 if rng.random() < 0.5 else 0.0
    variance = np.maximum(square - mean * mean, 0) + np.float32(of_lights) * mean * mean
    deviation = np.sqrt(variance / samples)
    chance = rng.standard_normal((*mean.shape[:2], 1), dtype=np.float32)
    return np.maximum(mean + deviation * chance, 0).astype(np.float32)


def draw_ground(rng: Rng, layout: Layout, wall: Float32 | None, photos: Photos) -> Float32:
    """The sharp light of the surface that fills the picture (N, N, 3)."""
    size = layout.disparity.shape[0]
    if rng.random() < 0.3:
        ground = surface(rng, size, photos, 0.7)
    else:
        texture = surface(rng, TEXTURE_SIZE, photos, PHOTO_SHARE * 0.6)
        ground = in_perspective(rng, layout, texture)
    if wall is not None:
        ground = np.where(wall[..., None] > 0, surface(rng, size, photos, PHOTO_SHARE), ground)
    return lit(rng, ground)


def draw_scene(rng: Rng, photos: Photos) -> tuple[npt.NDArray[np.uint8], Float32]:
    """A finished picture uint8 (SIZE, SIZE, 3) and its unsigned CoC diameter (SIZE, SIZE) [px]."""
    layout, wall = draw_layout(rng)
    aperture = draw_aperture(rng)
    rendered = rng.random() < RENDERED_SHARE
    ground = draw_ground(rng, layout, wall, photos)
    ground = with_squares(ground) if rendered else ground
    coc = layout.coc(layout.disparity)
    back = scatter(np.concatenate([ground, np.ones_like(ground[..., :1])], -1), coc, aperture)
    scene = (back[..., :-1] / np.maximum(back[..., -1:], 1e-3), np.abs(coc))
    for light, alpha, thing_coc in draw_things(rng, layout, photos):
        light = with_squares(light) if rendered else light
        scene = add_thing(scene, (light, alpha, thing_coc), aperture)
    picture = path_traced(rng, scene[0]) if rendered else scene[0]
    inner = slice(MARGIN, MARGIN + SIZE)
    return photographed(rng, picture)[inner, inner], scene[1][inner, inner]
