"""Silhouettes of the shapes that objects are made of, and what stands before what.

The held-out kinds (`HELD_OUT`) share no drawing code with those that the network is trained on.
All draw from the given generator only, so a seed names an object.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from models.coc.textures import Photos, drawn, surface
from models.reblur.lens import CROP, FINE, GRID, LARGEST_COC_PX, Float32, Shape, UInt8

Rng = np.random.Generator
SIDE = FINE * GRID
HIGHLIGHT_SHARE = 0.15  # of the shapes
STEEPEST = 0.3  # change of the CoC along a pixel [px / px]


def _canvas() -> UInt8:
    return np.zeros((SIDE, SIDE), np.uint8)


def _place(rng: Rng) -> tuple[float, float]:
    """A point in the middle part, in mask samples."""
    x, y = (GRID / 2 + rng.uniform(-0.4, 0.4, 2) * CROP) * FINE
    return float(x), float(y)


def _size(rng: Rng, low: float, high: float) -> float:
    """A length, log-uniform from low to high [px], in mask samples."""
    return float(np.exp(rng.uniform(np.log(low), np.log(high)))) * FINE


def _filled(points: np.ndarray) -> UInt8:
    mask = _canvas()
    cv2.fillPoly(mask, [np.int32(np.round(points * 16))], 255, cv2.LINE_8, 4)
    return mask


def card(rng: Rng) -> UInt8:
    """A rectangle at any angle."""
    centre, turn = _place(rng), rng.uniform(0, 180)
    box = cv2.boxPoints((centre, (_size(rng, 14, 120), _size(rng, 14, 120)), turn))
    return _filled(np.asarray(box))


def rods(rng: Rng) -> UInt8:
    """One to five straight bars, 1.5 to 9 px wide."""
    mask = _canvas()
    for _ in range(int(rng.integers(1, 6))):
        (x, y), turn, half = _place(rng), rng.uniform(0, np.pi), _size(rng, 20, 160)
        step = np.array([np.cos(turn), np.sin(turn)]) * half
        ends = [tuple(np.int32(np.array([x, y]) + sign * step)) for sign in (-1, 1)]
        cv2.line(mask, ends[0], ends[1], 255, max(2, round(_size(rng, 1.5, 9))))
    return mask


def blob(rng: Rng) -> UInt8:
    """A star-convex shape with a wavy rim."""
    angles = np.linspace(0, 2 * np.pi, 160, endpoint=False)
    rim = np.ones(160)
    for wave in range(2, 9):
        rim += rng.normal(0, 0.5 / wave) * np.cos(wave * angles + rng.uniform(0, 6.3))
    rim = _size(rng, 10, 60) * np.maximum(rim, 0.2)
    return _filled(np.stack([np.cos(angles), np.sin(angles)], 1) * rim[:, None] + _place(rng))


def ring(rng: Rng) -> UInt8:
    """An ellipse's rim, thin or thick."""
    mask, centre = _canvas(), tuple(int(v) for v in _place(rng))
    axes = (int(_size(rng, 8, 60)), int(_size(rng, 8, 60)))
    width = max(2, round(_size(rng, 2, 14)))
    cv2.ellipse(mask, centre, axes, rng.uniform(0, 180), 0, 360, 255, width)
    return mask


def polygon(rng: Rng) -> UInt8:
    """A star or an irregular polygon."""
    corners = int(rng.integers(3, 12))
    angles = np.sort(rng.uniform(0, 2 * np.pi, corners))
    rim = _size(rng, 12, 70) * rng.uniform(0.25, 1, corners)
    return _filled(np.stack([np.cos(angles), np.sin(angles)], 1) * rim[:, None] + _place(rng))


def sheet(rng: Rng) -> UInt8:
    """Everything, or everything on one side of a line: a wall behind the rest."""
    mask = np.full((SIDE, SIDE), 255, np.uint8)
    if rng.random() < 0.5:
        y, x = np.mgrid[0:SIDE, 0:SIDE]
        (cx, cy), turn = _place(rng), rng.uniform(0, 2 * np.pi)
        mask[(x - cx) * np.cos(turn) + (y - cy) * np.sin(turn) < 0] = 0
    return mask


@dataclass(frozen=True, slots=True)
class _Body:
    """What the parts of a figure share: texture, CoC in the middle, slope limit."""

    texture: Float32
    coc_px: float


def _limb(rng: Rng, body: _Body, start: np.ndarray, stop: np.ndarray, ends: tuple[float, float],
          width_px: float) -> Shape:  # fmt: skip
    """A bar from joint to joint whose CoC runs from one joint's to the other's."""
    mask = _canvas()
    first, last = (tuple(np.int32(p * FINE)) for p in (start, stop))
    cv2.line(mask, first, last, 255, max(2, round(width_px * FINE)))
    along = stop - start
    slope = along * (ends[1] - ends[0]) / max(float(along @ along), 1.0)
    steep = float(np.hypot(*slope))
    slope = slope * min(1.0, 0.8 / max(steep, 1e-6))
    return Shape(
        mask=mask, texture=body.texture, coc_px=float(ends[0] - slope @ start),
        slope=(float(slope[0]), float(slope[1])),
    )  # fmt: skip


def figure(rng: Rng, texture: Float32, coc_px: float) -> list[Shape]:
    """A random tree of limbs, connected in depth at the joints, one before another elsewhere."""
    body = _Body(texture, coc_px)
    joints = [(np.array([GRID / 2, GRID / 2]) + rng.uniform(-0.3, 0.3, 2) * CROP, coc_px)]
    shapes = []
    for _ in range(int(rng.integers(4, 10))):
        start, depth = joints[int(rng.integers(len(joints)))]
        turn, length = rng.uniform(0, 2 * np.pi), rng.uniform(18, 60)
        stop = start + length * np.array([np.cos(turn), np.sin(turn)])
        end = float(np.clip(depth + rng.normal(0, 8), -32, 32))
        shapes.append(_limb(rng, body, start, stop, (depth, end), rng.uniform(3, 22)))
        joints.append((stop, end))
    return shapes


def leaf(rng: Rng) -> UInt8:
    """A held-out kind: a pointed leaf on its stem."""
    t = np.linspace(0, 1, 60)
    half = np.sin(np.pi * t) ** rng.uniform(0.7, 1.6) * rng.uniform(0.12, 0.35)
    bend = rng.uniform(-0.3, 0.3) * t * t
    outline = np.concatenate([np.stack([t, bend + half], 1), np.stack([t, bend - half], 1)[::-1]])
    stem = np.array([[0, 0.008], [-0.5, 0.03], [-0.5, 0.0], [0, -0.008]])
    turn, size = rng.uniform(0, 2 * np.pi), _size(rng, 30, 90)
    rotation = np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
    return _filled(outline @ rotation.T * size + _place(rng)) | _filled(
        stem @ rotation.T * size + _place(rng)
    )


def grille(rng: Rng) -> UInt8:
    """A held-out kind: a lattice of slats, 2 to 8 px, with openings of 6 to 25 px."""
    y, x = np.mgrid[0:SIDE, 0:SIDE] / FINE
    turn, gap, slat = rng.uniform(0, np.pi), rng.uniform(8, 30), rng.uniform(2, 8)
    u, v = x * np.cos(turn) + y * np.sin(turn), y * np.cos(turn) - x * np.sin(turn)
    solid = u % gap < slat
    if rng.random() < 0.5:
        solid |= v % (gap * 1.4) < slat
    return np.where(solid, np.uint8(255), np.uint8(0))


def letter(rng: Rng) -> UInt8:
    """A held-out kind: a bold letter or a sign with inner corners and holes."""
    mask, (x, y) = _canvas(), _place(rng)
    scale = _size(rng, 24, 80) / 22
    text = str(rng.choice(list("ABEFHKMRSWXZ&%#@")))
    origin = (int(x - 11 * scale), int(y + 11 * scale))
    cv2.putText(mask, text, origin, int(rng.choice([0, 2, 3])), scale, 255, round(scale * 4))
    return mask


TRAINED: tuple[Callable[[Rng], UInt8], ...] = (card, card, rods, blob, ring, polygon)
HELD_OUT: dict[str, tuple[Callable[[Rng], UInt8], ...]] = {
    "leaves": (leaf,),
    "grille": (grille,),
    "letters": (letter,),
}


def held_out_texture(rng: Rng, photos: Photos) -> Float32:
    """Held-out photographs, or drawn surfaces of other seeds."""
    return photos.crop(rng, GRID) if rng.random() < 0.6 else drawn(rng, GRID)


def painted(rng: Rng, photos: Photos, *, held_out: bool) -> Float32:
    """A surface (GRID, GRID, 3), some with highlights of 2 to 10 times white."""
    texture = held_out_texture(rng, photos) if held_out else surface(rng, GRID, photos, 0.45)
    texture = texture * np.float32(np.exp(rng.normal(0, 0.4)))
    if rng.random() < HIGHLIGHT_SHARE:
        for _ in range(int(rng.integers(1, 6))):
            x, y = (int(v) for v in rng.integers(0, GRID, 2))
            light = np.zeros((GRID, GRID), np.float32)
            cv2.circle(light, (x, y), int(rng.integers(1, 4)), float(rng.uniform(2, 10)), -1)
            texture = texture + light[..., None]
    return texture.astype(np.float32)


def flat(rng: Rng, mask: UInt8, texture: Float32, coc_px: float, *, tilt: bool) -> Shape:
    """A shape with its CoC in its middle, perhaps tilted, nowhere beyond LARGEST_COC_PX."""
    steep = rng.uniform(0.02, STEEPEST) if tilt else 0.0
    turn = rng.uniform(0, 2 * np.pi)
    slope = np.array([np.cos(turn), np.sin(turn)]) * steep
    rows, columns = np.nonzero(mask[::8, ::8])
    if rows.size:
        points = np.stack([columns, rows], 1) * (8 / FINE)
        middle = points.mean(0)
        spread = float(np.abs((points - middle) @ slope).max())
        room = LARGEST_COC_PX - 2 - abs(coc_px)
        slope = slope * min(1.0, max(0.0, room) / max(spread, 1e-6))
    else:
        middle = np.array([GRID / 2, GRID / 2])
    return Shape(
        mask=mask, texture=texture, coc_px=float(coc_px - slope @ middle),
        slope=(float(slope[0]), float(slope[1])),
    )  # fmt: skip


def draw_cocs(rng: Rng, count: int) -> list[float]:
    """Signed CoCs, focus before, behind or between the shapes; often one of them sharp."""
    spread = float(np.exp(rng.uniform(np.log(4), np.log(44))))
    low = rng.uniform(-32, 32 - spread) if spread < 64 else -32.0
    cocs = low + spread * rng.random(count)
    if rng.random() < 0.35:
        cocs = np.clip(cocs - cocs[int(rng.integers(count))], -32, 32)
    return [float(c) for c in np.clip(cocs, -32, 32)]


def draw_object(rng: Rng, photos: Photos) -> list[Shape]:
    """An object to train on: two to six shapes, or a figure, before a wall or before nothing."""
    count = int(rng.integers(2, 7))
    cocs = draw_cocs(rng, count)
    shapes: list[Shape] = []
    if rng.random() < 0.6:
        texture = painted(rng, photos, held_out=False)
        shapes.append(flat(rng, sheet(rng), texture, min(cocs), tilt=rng.random() < 0.5))
    if rng.random() < 0.3:
        return shapes + figure(rng, painted(rng, photos, held_out=False), max(cocs))
    for coc in cocs[len(shapes) :]:
        mask = TRAINED[int(rng.integers(len(TRAINED)))](rng)
        texture = painted(rng, photos, held_out=False)
        shapes.append(flat(rng, mask, texture, coc, tilt=rng.random() < 0.5))
    return shapes


def draw_held_out(rng: Rng, photos: Photos, category: str) -> list[Shape]:
    """An object of a category of `CATEGORIES` that nothing is trained on."""
    if category == "skeleton":
        return skeleton(rng, photos)
    cocs = sorted(draw_cocs(rng, 4))
    wall = flat(
        rng, sheet(rng), painted(rng, photos, held_out=True), cocs[0], tilt=rng.random() < 0.5
    )
    shapes = [wall]
    for coc in cocs[1:] if category != "grille" else cocs[-1:]:
        mask = HELD_OUT[category][0](rng)
        texture = painted(rng, photos, held_out=True)
        shapes.append(flat(rng, mask, texture, coc, tilt=rng.random() < 0.5))
    return shapes


def skeleton(rng: Rng, photos: Photos) -> list[Shape]:
    """A held-out object: a standing body with arms before and behind its trunk."""
    texture = painted(rng, photos, held_out=True)
    coc = float(rng.uniform(-20, 20))
    body = _Body(texture, coc)
    middle = np.array([GRID / 2, GRID / 2]) + rng.uniform(-12, 12, 2)
    hip, neck = middle + (0, 26), middle - (0, 26)
    parts: list[tuple[np.ndarray, np.ndarray, float, float, float]] = [
        (neck, hip, coc, coc, rng.uniform(22, 34)),
        (neck, neck - (0, 16), coc, coc + rng.normal(0, 2), rng.uniform(12, 18)),
    ]
    for side in (-1, 1):
        reach = rng.choice([-1, 1]) * rng.uniform(6, 14)
        elbow = neck + (side * rng.uniform(8, 20), rng.uniform(8, 24))
        hand = elbow + (-side * rng.uniform(10, 34), rng.uniform(4, 24))
        parts.append((neck + (side * 10, 2), elbow, coc, coc + reach * 0.7, rng.uniform(6, 9)))
        parts.append((elbow, hand, coc + reach * 0.7, coc + reach, rng.uniform(5, 8)))
        foot = hip + (side * rng.uniform(4, 22), rng.uniform(24, 50))
        parts.append((hip, foot, coc, coc + rng.normal(0, 6), rng.uniform(8, 12)))
    return [_limb(rng, body, a, b, (c, d), w) for a, b, c, d, w in parts]


CATEGORIES: Sequence[str] = (*HELD_OUT, "skeleton")
