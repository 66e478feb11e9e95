"""From light layers to frames: mixing, fairy lights, grain, the camera's curve, YUV."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import numpy.typing as npt
import OpenEXR
from denoise import denoise, noise_variance
from shot_list import FRAMES, HEIGHT, RATE, WIDTH, Shot, bulbs

Floats = npt.NDArray[np.float64]

GROUPS = ("sun", "sky", "lamps", "candle")
FLICKER = {"sun": (0.02, 0.3), "sky": (0.01, 0.2), "lamps": (0.05, 0.8), "candle": (0.16, 4.0)}
"""Relative swing and its middle frequency [Hz] of every light group."""
READ_NOISE, SHOT_NOISE = 0.0016, 1.0e-4
"""Deviation in the dark and variance by signal, scene-linear; about one code at mid grey."""


def read_groups(path: Path) -> dict[str, Floats]:
    """Scene-linear RGB (H, W, 3) of every light group of a file that make_plate.py wrote."""
    channels = OpenEXR.File(str(path), separate_channels=True).channels()
    return {
        group: np.stack(
            [channels[f"ViewLayer.Combined_{group}.{c}"].pixels for c in "RGB"], axis=-1
        ).astype(np.float64)
        for group in GROUPS
    }


def read_alpha(path: Path) -> Floats:
    """Alpha (H, W) of an OpenEXR picture."""
    return np.asarray(OpenEXR.File(str(path)).channels()["RGBA"].pixels[..., 3], np.float64)


def clean_layers(folder: Path) -> dict[str, Floats]:
    """The light layers without the renderer's noise."""
    layers, fewer = read_groups(folder / "layers.exr"), read_groups(folder / "noise.exr")
    return {
        group: denoise(layers[group], noise_variance(layers[group], fewer[group]))
        for group in GROUPS
    }


def wave(time: float, hertz: float, phases: Floats) -> Floats:
    """A slow irregular swing in about [-1, 1], one for every row of phases (N, 3)."""
    turns = 2.0 * np.pi * hertz * time * np.array([0.62, 1.0, 1.87])
    return np.asarray(np.sin(turns + phases) @ np.array([0.5, 0.35, 0.25]))


def weights(shot: Shot, time: float) -> dict[str, float]:
    """Strength of every light group at a time [s], 1 on average."""
    phases = np.random.default_rng(shot.seed + 1).uniform(0.0, 2.0 * np.pi, (len(GROUPS), 3))
    return {
        group: 1.0 + FLICKER[group][0] * float(wave(time, FLICKER[group][1], phases[i : i + 1])[0])
        for i, group in enumerate(GROUPS)
    }


def fairy_lights(shot: Shot, time: float) -> Floats:
    """Defocused bulbs as antialiased discs (H, W, 3), swaying and flickering; exact for points."""
    lights = bulbs(shot)
    picture = np.zeros((HEIGHT, WIDTH, 3))
    phases = np.random.default_rng(shot.seed + 2).uniform(0.0, 2.0 * np.pi, (len(lights), 3))
    glow = 1.0 + 0.08 * wave(time, 1.3, phases)
    drift = 0.012 * wave(time, 0.35, lights[:, :1] * 1.5 + np.array([[0.0, 1.0, 2.0]]))
    place = shot.project(lights[:, :3] + np.stack([drift, 0.0 * drift, 0.4 * drift], axis=1))
    radius = 0.5 * abs(shot.coc_px(place[:, 2]))
    for (x, y, _), r, colour in zip(place, radius, lights[:, 3:] * glow[:, None], strict=True):
        left, top = max(0, int(x - r - 1.0)), max(0, int(y - r - 1.0))
        window = picture[top : int(y + r + 3.0), left : int(x + r + 3.0)]
        rows, columns = (np.arange(n) + 0.5 for n in window.shape[:2])
        distance = np.hypot(columns[None, :] + left - x, rows[:, None] + top - y)
        window += np.clip(r - distance + 0.5, 0.0, 1.0)[..., None] * colour
    return picture


def frames(shot: Shot, folder: Path) -> Iterator[npt.NDArray[np.uint8]]:
    """Every frame of the clip as planar 4:2:0 (H * 3 / 2, W), BT.709, limited range."""
    layers = clean_layers(folder)
    near = read_alpha(folder / "near.exr") if len(bulbs(shot)) else np.zeros((HEIGHT, WIDTH))
    rng = np.random.default_rng(shot.seed + 3)
    for index in range(FRAMES):
        time = index / RATE
        strength = weights(shot, time)
        linear = sum(strength[group] * layers[group] for group in GROUPS)
        linear = linear + (1.0 - near[..., None]) * fairy_lights(shot, time)
        linear = shot.exposure * linear
        deviation = np.sqrt(READ_NOISE**2 + SHOT_NOISE * linear)
        yield to_yuv420(bt709(linear + deviation * rng.standard_normal(linear.shape)))


def bt709(linear: Floats) -> Floats:
    """BT.709 opto-electronic transfer function, clipped to [0, 1]."""
    light = np.clip(linear, 0.0, 1.0)
    return np.asarray(np.where(light < 0.018, 4.5 * light, 1.099 * light**0.45 - 0.099))


def to_yuv420(rgb: Floats) -> npt.NDArray[np.uint8]:
    """Coded RGB (H, W, 3) in [0, 1] as planar 4:2:0 (H * 3 / 2, W), chroma sited left."""
    luma = rgb @ np.array([0.2126, 0.7152, 0.0722])
    planes = [16.0 + 219.0 * luma]
    for channel, scale in ((2, 1.8556), (0, 1.5748)):
        chroma = np.pad((rgb[..., channel] - luma) / scale, ((0, 0), (1, 0)), mode="edge")
        across = (
            0.25 * chroma[:, 0:-1:2]
            + 0.5 * chroma[:, 1::2]
            + 0.25
            * np.concatenate([chroma[:, 2::2], chroma[:, -1:]], axis=1)[:, : rgb.shape[1] // 2]
        )
        planes.append(128.0 + 224.0 * 0.5 * (across[0::2] + across[1::2]))
    flat = np.concatenate([plane.ravel() for plane in planes])
    return np.rint(flat).astype(np.uint8).reshape(rgb.shape[0] * 3 // 2, rgb.shape[1])
