"""Rows of the table of shots for what sensor and shutter do: grain, softness, a pan's smear."""

from __future__ import annotations

from functools import partial

import cv2
import numpy as np
from support.effects import filmed_shots as film
from support.effects.shot_table import LOOKS, UNITS, Row
from support.effects.synthetic_frames import panned, scene

from nlens_video.effects.camera.grain import to_code
from nlens_video.effects.measurement import shutter_angle
from nlens_video.video.pixels.picture import ArrayPicture

SENSOR = ("softness", "grain")
UNITS |= {"softness": "px (sigma)", "grain": "levels", "shutter": "degrees"}


def _shutter(pictures):
    angle = shutter_angle(pictures)
    return angle is not None, angle or 0.0


LOOKS["shutter"] = _shutter


def sensed(make, levels=0.0, soft_px=0.0, frames=4, lasting=0.0, spread_px=0.0, crf=None):
    """Pictures of a still camera: softness in light, noise in code values, rounding, a codec."""
    light = np.asarray(make(), np.float32)
    if light.shape[:2] == film.FINE:
        light = film.seen_by(light, film.Camera())
    if soft_px:
        light = cv2.GaussianBlur(light, (0, 0), soft_px)
    code, before = to_code(np.clip(light, 0, 1)), None
    rng = np.random.default_rng(5)
    shots = []
    for _ in range(frames):
        fresh = rng.standard_normal(code.shape)
        if spread_px:
            fresh = cv2.GaussianBlur(fresh, (0, 0), spread_px)
        fresh /= fresh.std()
        before = fresh if before is None else lasting * before + np.sqrt(1 - lasting**2) * fresh
        shots.append(np.uint8(np.clip(np.rint(255 * code + levels * before), 0, 255)))
    if crf is None:
        return [ArrayPicture(shot, "rgb") for shot in shots]
    return film.decoded(shots, crf)


def _row(name, make, **how):
    truth = {}
    if how.get("levels"):
        truth["grain"] = float(np.hypot(how["levels"], 12**-0.5))  # rounding is seen, too
    if how.get("soft_px"):
        truth["softness"] = how["soft_px"]
    weak = tuple(how.pop("weak", ()))
    if weak or how.get("crf"):
        truth = {effect: value for effect, value in truth.items() if effect in weak}
    pictures = partial(sensed, make, **how)
    return Row(name=name, pictures=pictures, truth=truth, judged=SENSOR, weak=weak)


def _pan(name, seed, way, share, weak=()):
    return Row(
        name=name, pictures=partial(panned, scene(seed, slope=0.9), way, share),
        truth={"shutter": 360.0 * share} if share else {}, judged=("shutter",), weak=weak,
    )  # fmt: skip


STREET, ROOM = partial(film.street, 2), partial(film.room, 3)
STREET_B, ROOM_B = partial(film.street, 31), partial(film.room, 33)
FINE, COARSE = partial(film.spectrum, 1, 1.0), partial(film.spectrum, 11, 1.5)
CARDS, CARDS_B = partial(scene, 3), partial(scene, 17)


def _defocused():
    return film.defocused(STREET())


SENSOR_ROWS = [
    _row("clean street, four frames", STREET),
    _row("clean room, four frames", ROOM),
    _row("clean fine texture, four frames", FINE),
    _row("clean cards, one frame", CARDS, frames=1),
    _row("clean coarse texture, one frame", COARSE, frames=1),
    _row("clean street, crf 23", STREET_B, crf=23),
    _row("clean room, crf 30", ROOM_B, crf=30),
    _row("defocused street, clean", _defocused),
    _row("grain of 1.5 levels, street", STREET, levels=1.5),
    _row("grain of 3 levels, room", ROOM, levels=3.0),
    _row("grain of 6 levels, fine texture", FINE, levels=6.0),
    _row("coarse grain of 3 levels, street", STREET_B, levels=3.0, spread_px=0.8),
    _row("lasting grain of 3 levels, room", ROOM_B, levels=3.0, lasting=0.5),
    _row("grain of 4 levels, defocused street, one frame", _defocused, levels=4.0, frames=1),
    _row("grain of 3 levels, cards", CARDS_B, levels=3.0),
    _row("soft, 1.4 px, cards", CARDS, soft_px=1.4),
    _row("soft, 1.6 px, other cards", CARDS_B, soft_px=1.6),
    _row("soft, 1.5 px, grain of 2 levels, cards", CARDS, soft_px=1.5, levels=2.0),
    _row("hardly soft, 0.6 px, cards", CARDS, soft_px=0.6, weak=("softness",)),
    _pan("still camera", 0, (0.0, 0.0), 0.0),
    _pan("pan of 14 px, no smear", 1, (14.0, 0.0), 0.0),
    _pan("pan of 12 px, half open", 0, (12.0, 0.0), 0.5),
    _pan("slanting pan of 15 px, half open", 1, (-9.0, 12.0), 0.5),
    _pan("pan of 25 px, three quarters open", 0, (25.0, 0.0), 0.75),
    _pan("pan of 20 px, wide open", 3, (20.0, 0.0), 1.0, ("shutter",)),
]
