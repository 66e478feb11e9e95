"""What stands and walks in `walkers`: figures of limbs, and a flat object."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float32]
PX_PER_M = 220
OBJECT_SIZE = (1.2, 1.2)
"""Width and height of the object [m]."""
_CARD = 1.3, 1.9  # width and height of a figure's card [m]


@dataclass(frozen=True, slots=True)
class Look:
    """How a figure looks: colours in linear light, its height [m], the weave of its clothes."""

    shirt: tuple[float, ...]
    trousers: tuple[float, ...]
    skin: tuple[float, ...]
    height: float
    weave: Array

    @classmethod
    def drawn(cls, draw: np.random.Generator) -> Look:
        """A look by chance."""
        shirt, trousers = draw.uniform(0.02, 0.7, 3), draw.uniform(0.01, 0.25, 3)
        skin = np.array([0.55, 0.32, 0.2]) * draw.uniform(0.35, 1.1)
        coarse = draw.normal(0, 0.25, (60, 40)).astype(np.float32)
        shape = round(_CARD[0] * PX_PER_M), round(_CARD[1] * PX_PER_M)
        weave = np.exp2(cv2.resize(coarse, shape, interpolation=cv2.INTER_CUBIC))
        stripes = 1 + 0.4 * np.sign(np.sin(np.arange(shape[1]) / float(draw.uniform(3, 12))))
        striped = weave * stripes[:, None] if draw.uniform() < 0.4 else weave
        return cls(
            tuple(shirt.tolist()), tuple(trousers.tolist()), tuple(skin.tolist()),
            float(draw.uniform(1.6, 1.85)), np.asarray(striped, np.float32),
        )  # fmt: skip


def draw_figure(look: Look, stride: float, facing: float) -> Array:
    """A figure at a moment of its stride, premultiplied RGBA (h, w, 4); its feet at the bottom.

    Args:
        look: of it.
        stride: steps walked so far [1].
        facing: 1 to the right, -1 to the left.
    """
    width, height = round(_CARD[0] * PX_PER_M), round(_CARD[1] * PX_PER_M)
    card = np.zeros((height, width, 4), np.float32)
    swing = math.sin(math.pi * stride)
    h, middle = look.height, _CARD[0] / 2
    hip, shoulder = 0.5 * h, 0.8 * h

    def limb(points: list[tuple[float, float]], thick: float, colour: tuple[float, ...]) -> None:
        mask = np.zeros((height, width), np.uint8)
        px = [(round(16 * PX_PER_M * x), round(16 * (height - PX_PER_M * y))) for x, y in points]
        for a, b in zip(px, px[1:], strict=False):
            cv2.line(mask, a, b, 255, max(1, round(thick * PX_PER_M)), cv2.LINE_AA, 4)
        cover = mask[..., None].astype(np.float32) / 255
        round_light = (0.6 + 0.4 * np.linspace(0, 1, width, dtype=np.float32))[None, :, None]
        paint = np.array(colour, np.float32) * round_light * look.weave[..., None]
        card[..., :3] = cover * paint + (1 - cover) * card[..., :3]
        card[..., 3:] = cover + (1 - cover) * card[..., 3:]

    def leg(phase: float) -> None:
        angle = 0.42 * phase
        bend = 0.35 * max(0.0, math.cos(math.pi * stride) * phase)
        knee = middle + facing * 0.25 * h * math.sin(angle + bend), hip - 0.25 * h
        lift = 0.06 + 0.08 * bend
        foot = middle + facing * 0.5 * h * math.sin(angle), lift
        limb([(middle, hip), knee, foot], 0.13, look.trousers)
        limb([foot, (foot[0] + facing * 0.12, foot[1] - 0.02)], 0.08, (0.02, 0.02, 0.02))

    def arm(phase: float) -> None:
        elbow = middle + facing * 0.16 * h * math.sin(0.5 * phase), shoulder - 0.18 * h
        hand = elbow[0] + facing * 0.15 * h * math.sin(0.5 * phase + 0.3), shoulder - 0.34 * h
        limb([(middle, shoulder - 0.03), elbow, hand], 0.1, look.shirt)
        limb([hand, hand], 0.1, look.skin)

    arm(-swing)
    leg(-swing)
    leg(swing)
    limb([(middle, hip), (middle, shoulder - 0.06)], 0.34, look.shirt)
    limb([(middle, shoulder), (middle, shoulder + 0.05)], 0.11, look.skin)
    limb([(middle, 0.91 * h), (middle, 0.93 * h)], 0.2, look.skin)
    arm(swing)
    return card


def draw_object(draw: np.random.Generator) -> Array:
    """The object, upright and flat, premultiplied RGBA (h, w, 4)."""
    fine = 3
    width, height = (round(length * PX_PER_M * fine) for length in OBJECT_SIZE)
    y, x = np.mgrid[:height, :width].astype(np.float32) / height
    round_body = np.hypot((x - 0.5) / 0.48, (y - 0.42) / 0.4) < 1
    stand = (np.abs(x - 0.5) < 0.06 + 0.2 * np.maximum(y - 0.8, 0)) & (y > 0.5)
    hole = np.hypot(x - 0.62, y - 0.35) < 0.09
    cover = ((round_body & ~hole) | stand).astype(np.float32)
    first, second = draw.uniform(0.05, 0.8, (2, 3)).astype(np.float32)
    checks = ((np.floor(x * 9) + np.floor(y * 9)) % 2)[..., None]
    shading = (0.5 + 0.5 * np.clip(1.2 - x - 0.5 * y, 0, 1))[..., None]
    rgba = np.dstack([(first * checks + second * (1 - checks)) * shading, np.ones_like(x)])
    rgba = (rgba * cover[..., None]).astype(np.float32)
    return np.asarray(
        cv2.resize(rgba, None, fx=1 / fine, fy=1 / fine, interpolation=cv2.INTER_AREA)
    )
