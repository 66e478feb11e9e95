"""Pictures of one long ground plane in perspective, as footage shows it: hard to read, well posed.

A patch of such a ground often cannot tell a soft surface from a blurred one. The whole plane can:
its CoC is affine in disparity, its texture shrinks with the distance, and neither a soft pattern
nor grain follows the lens. So the picture is mostly ground, and its surface one of `grounds.py`.
The truth of a polished or wet ground is the surface's own CoC, whatever it mirrors.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import partial

import cv2
import numpy as np
import numpy.typing as npt

from models.coc.degrade import filmed, photographed, to_code
from models.coc.grounds import ground_surface
from models.coc.optics import (
    Aperture,
    cat_eye_aperture,
    polygon_aperture,
    round_aperture,
    scatter,
)
from models.coc.scene import (
    MARGIN,
    MAX_COC_PX,
    SIZE,
    TEXTURE_SIZE,
    Layout,
    add_thing,
    draw_things,
    in_perspective,
    lit,
    path_traced,
    with_squares,
)
from models.coc.textures import Photos, noise, surface, to_linear

Float32 = npt.NDArray[np.float32]
Rng = np.random.Generator
FOCUS_INSIDE_SHARE = 0.65
GLOSSY_SHARE = 0.22
STRANDS_SHARE = 0.14
RENDERED_SHARE = 0.45
FEWEST_SAMPLES, MOST_SAMPLES = 12, 1500  # of a path tracer's lens
FILMED_SHARE = 0.55


def _log_uniform(rng: Rng, low: float, high: float) -> float:
    return float(np.exp(rng.uniform(np.log(low), np.log(high))))


def draw_bladed_aperture(rng: Rng) -> Aperture:
    """Round on two fifths, else five to seven blades or a disc cut by vignetting."""
    kind = rng.random()
    if kind < 0.4:
        return round_aperture()
    if kind < 0.75:
        return polygon_aperture(int(rng.integers(5, 8)), rng.uniform(0, np.pi))
    return cat_eye_aperture(rng.uniform(0.1, 0.6), rng.uniform(0, 2 * np.pi))


@dataclass(frozen=True, slots=True)
class GroundPlane:
    """A plane that comes nearer downwards, and what stands at its far end.

    Attributes:
        layout: the lens and the disparity of what is seen.
        wall: mask of what stands at the far end (N, N).
        gradient: of the plane's disparity, which is 1 in the middle, along columns and rows
            [1 / px].
        end: disparity of its far end.
    """

    layout: Layout
    wall: Float32
    gradient: tuple[float, float]
    end: float


@dataclass(frozen=True, slots=True)
class GroundLight:
    """A ground as the lens shows it, with a margin on all sides.

    Attributes:
        plane: of the ground.
        light: scene-linear (N, N, 3).
        coc_px: unsigned CoC diameter of what is seen (N, N).
    """

    plane: GroundPlane
    light: Float32
    coc_px: Float32


def draw_ground_plane(rng: Rng) -> GroundPlane:
    """A ground plane and a lens that has its focus on it or beside it."""
    size = SIZE + 2 * MARGIN
    y, x = (np.mgrid[0:size, 0:size] - (size - 1) / 2).astype(np.float32)
    angle = rng.normal(np.pi / 2, 0.06)
    down = (float(np.cos(angle)), float(np.sin(angle)))
    horizon = _log_uniform(rng, 70, 2500)  # from the middle up to the vanishing line [px]
    plane = 1 + (x * down[0] + y * down[1]) / horizon
    end = max(rng.uniform(0.03, 0.15), 1 - rng.uniform(100, 260) / horizon)
    disparity = np.maximum(plane, end)
    near, far = 1 + SIZE / 2 / horizon, max(end, 1 - SIZE / 2 / horizon)
    change = _log_uniform(rng, 3, 55)  # of the CoC from the upper to the lower border [px]
    slope = change / (near - far)
    if rng.random() < FOCUS_INSIDE_SHARE:
        focus = rng.uniform(far, near)
    else:
        beyond = rng.uniform(0, 0.8) * (near - far)
        focus = near + beyond if rng.random() < 0.5 else far - beyond
    offset = slope * (1 - focus)
    shrink = min(1.0, MAX_COC_PX / float(np.abs(offset + slope * (disparity - 1)).max()))
    layout = Layout(disparity, slope * shrink, offset * shrink, down)
    gradient = (down[0] / horizon, down[1] / horizon)
    return GroundPlane(layout, np.float32(plane < end), gradient, float(end))


def with_strands(rng: Rng, layout: Layout, linear: Float32) -> tuple[Float32, Float32]:
    """Grass: thousands of strands, farther ones behind nearer ones.

    Returns:
        The light (N, N, 3) and the disparity (N, N), where a strand is seen that of its foot.
    """
    size = linear.shape[0]
    canvas = np.uint8(np.clip(255 * to_code(linear), 0, 255))
    disparity = layout.disparity.copy()
    count = int(_log_uniform(rng, 1500, 9000))
    feet = rng.integers(0, size, (count, 2))
    depth = layout.disparity[feet[:, 1], feet[:, 0]]
    largest = float(layout.disparity.max())
    reach = _log_uniform(rng, 8, 60) / largest
    thick = _log_uniform(rng, 1, 4) / largest
    base, spread = rng.uniform(20, 150, 3) * (0.9, 1.1, 0.7), rng.uniform(6, 45)
    lean = rng.normal(0, 0.3)
    for i in np.argsort(depth):
        at = float(depth[i])
        tall = reach * at * rng.uniform(0.4, 1.3)
        tip = feet[i] + (tall * (lean + rng.normal(0, 0.4)), -tall)
        colour = np.clip(base + rng.normal(0, spread) + rng.normal(0, 4, 3), 0, 255).tolist()
        line = feet[i].tolist(), np.int32(tip).tolist()
        width = max(1, round(thick * at))
        cv2.line(canvas, *line, colour, width, cv2.LINE_AA)
        cv2.line(disparity, *line, at, width)
    return to_linear(np.float32(canvas) / 255), disparity


def mirror_image(rng: Rng, photos: Photos, size: int) -> Float32:
    """What a polished ground mirrors: windows and lamps before a dark room, or any surface."""
    if rng.random() < 0.35:
        return lit(rng, surface(rng, size, photos, 0.6))
    image = np.float32(np.ones((size, size, 3)) * rng.uniform(0, 0.15))
    for _ in range(int(rng.integers(1, 9))):
        corner, extent = rng.integers(-40, size, 2), rng.integers(8, 170, 2)
        colour = rng.uniform(0.3, 4) * np.exp(rng.normal(0, 0.15, 3))
        cv2.rectangle(image, corner.tolist(), (corner + extent).tolist(), colour.tolist(), -1)
        for part in range(int(rng.integers(0, 4))):  # the bars of a window
            x = int(corner[0] + extent[0] * part / 3)
            cv2.line(image, (x, int(corner[1])), (x, int(corner[1] + extent[1])), (0, 0, 0), 2)
    return image


def mirrored(
    rng: Rng, layout: Layout, photos: Photos
) -> tuple[Float32, Float32, npt.NDArray[np.float32]]:
    """A mirror image in the ground: light (N, N, 3), its share of what is seen, CoC (N, N) [px].

    It lies beyond the ground at the same pixel, more of it is seen the flatter the view, and a
    rough ground smears it, mostly upright.
    """
    size = layout.disparity.shape[0]
    image = mirror_image(rng, photos, size)
    rough = _log_uniform(rng, 0.3, 7)
    image = cv2.GaussianBlur(image, (0, 0), rough, sigmaY=rough * rng.uniform(1, 3))
    share = rng.uniform(0.05, 0.45) * layout.disparity ** -rng.uniform(0, 2)
    if rng.random() < 0.4:  # puddles, worn polish
        wet = noise(rng, size, rng.uniform(1.5, 2.5)) > rng.normal(0, 0.7)
        share = share * cv2.GaussianBlur(np.float32(wet), (0, 0), rng.uniform(0.5, 8))
    beyond = np.minimum(layout.disparity, rng.uniform(0.15, 1.0))
    return image, np.float32(np.clip(share, 0, 0.85)), layout.coc(beyond)


def _spread(light: Float32, coc: Float32, aperture: Aperture) -> Float32:
    """Scattered light, divided by what falls on a pixel of the canvas (N, N, C)."""
    sums = scatter(np.concatenate([light, np.ones_like(light[..., :1])], -1), coc, aperture)
    return sums[..., :-1] / np.maximum(sums[..., -1:], 1e-3)


def _together(first: Float32, second: Float32) -> Float32:
    """The sum of two independent lights: (N, N, 3), or means and mean squares (N, N, 6)."""
    mean = first[..., :3] + second[..., :3]
    if first.shape[-1] == mean.shape[-1]:
        return mean
    variance = sum(part[..., 3:] - part[..., :3] ** 2 for part in (first, second))
    return np.concatenate([mean, variance + mean * mean], -1)


def draw_long_ground(rng: Rng, photos: Photos) -> tuple[npt.NDArray[np.uint8], Float32]:
    """A finished picture uint8 (SIZE, SIZE, 3) and its unsigned CoC diameter (SIZE, SIZE) [px]."""
    ground = draw_ground_light(rng, photos)
    inner = slice(MARGIN, MARGIN + SIZE)
    finish = filmed if rng.random() < FILMED_SHARE else photographed
    return finish(rng, ground.light)[inner, inner], ground.coc_px[inner, inner]


def draw_ground_light(rng: Rng, photos: Photos, hard_share: float = 1.0) -> GroundLight:
    """A long ground before it is photographed, hard to read on a share of the pictures."""
    plane = draw_ground_plane(rng)
    layout, wall = plane.layout, plane.wall
    aperture = draw_bladed_aperture(rng)
    rendered = rng.random() < RENDERED_SHARE
    moments = with_squares if rendered else np.asarray
    size = layout.disparity.shape[0]
    hard = hard_share >= 1.0 or rng.random() < hard_share
    texture = ground_surface if hard else partial(surface, photo_share=0.5)
    ground = in_perspective(rng, layout, texture(rng, TEXTURE_SIZE, photos))
    disparity = layout.disparity
    ground = np.where(wall[..., None] > 0, surface(rng, size, photos, 0.5), ground)
    if rng.random() < STRANDS_SHARE:
        ground, disparity = with_strands(rng, layout, ground)
    ground = lit(rng, ground)
    coc = layout.coc(disparity)
    if rng.random() < GLOSSY_SHARE:
        image, share, image_coc = mirrored(rng, layout, photos)
        share = (share * (1 - wall))[..., None]
        back = _together(
            _spread(moments(ground * (1 - share)), coc, aperture),
            _spread(moments(image * share), image_coc, aperture),
        )
    else:
        back = _spread(moments(ground), coc, aperture)
    scene = (back, np.abs(coc))
    if rng.random() < 0.7:
        for light, alpha, thing_coc in draw_things(rng, layout, photos):
            scene = add_thing(scene, (moments(light), alpha, thing_coc), aperture)
    picture = scene[0]
    if rendered:
        picture = path_traced(rng, picture, FEWEST_SAMPLES, MOST_SAMPLES)
    return GroundLight(plane, picture, scene[1])
