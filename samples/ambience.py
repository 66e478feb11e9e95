"""A soft soundscape for each clip, synthesised: air, leaves, crickets or birds, a far chime."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy.signal import butter, sosfilt
from shot_list import SECONDS, Shot

SOUND_HZ = 48000
Floats = npt.NDArray[np.float64]


def _air(rng: np.random.Generator, low: float, high: float, swell_hz: float) -> Floats:
    """Band-passed noise (2, N) that swells, each side on its own, unit deviation."""
    count = int(SECONDS * SOUND_HZ)
    band = butter(2, [low, high], "bandpass", fs=SOUND_HZ, output="sos")
    noise = sosfilt(band, rng.standard_normal((2, count + SOUND_HZ)), axis=1)[:, SOUND_HZ:]
    time = np.arange(count) / SOUND_HZ
    swell = 1.0 + 0.4 * np.sin(2.0 * np.pi * (swell_hz * time + rng.uniform(size=(2, 1))))
    return np.asarray(noise / noise.std() * swell)


def _place(sound: Floats, start: float, tone: Floats, pan: float) -> None:
    """Add a tone (N,) at a time [s], panned from 0 (left) to 1 (right)."""
    first = int(start * SOUND_HZ)
    tone = tone[: sound.shape[1] - first]
    sound[0, first : first + len(tone)] += np.sqrt(1.0 - pan) * tone
    sound[1, first : first + len(tone)] += np.sqrt(pan) * tone


def _chime(hertz: float) -> Floats:
    time = np.arange(int(2.5 * SOUND_HZ)) / SOUND_HZ
    partials = sum(
        a * np.sin(2 * np.pi * hertz * k * time) * np.exp(-time * d)
        for a, k, d in ((1.0, 1.0, 1.8), (0.45, 2.76, 3.0), (0.2, 5.4, 5.0))
    )
    return np.asarray(partials * np.clip(time / 0.004, 0.0, 1.0))


def _cricket(rng: np.random.Generator) -> Floats:
    time = np.arange(int(0.35 * SOUND_HZ)) / SOUND_HZ
    pulses = np.clip(np.sin(2.0 * np.pi * 28.0 * time), 0.0, 1.0) ** 2
    return np.asarray(
        np.sin(2.0 * np.pi * rng.uniform(4300, 4700) * time) * pulses * np.sin(np.pi * time / 0.35)
    )


def _bird(rng: np.random.Generator) -> Floats:
    time = np.arange(int(0.16 * SOUND_HZ)) / SOUND_HZ
    start, end = rng.uniform(2600, 3400), rng.uniform(3400, 4600)
    pitch = start + (end - start) * np.sin(np.pi * time / 0.16)
    return np.asarray(
        np.sin(2.0 * np.pi * np.cumsum(pitch) / SOUND_HZ) * np.sin(np.pi * time / 0.16) ** 2
    )


def ambience(shot: Shot) -> npt.NDArray[np.float32]:
    """Stereo sound (2, N) of the clip's length at 48 kHz, peak below 0.5."""
    rng = np.random.default_rng(shot.seed + 4)
    sound = 0.020 * _air(rng, 90.0, 500.0, 0.17) + 0.006 * _air(rng, 1200.0, 5200.0, 0.31)
    if shot.name == "terrace":
        for start in np.arange(0.2, SECONDS - 0.4, 0.62) + rng.uniform(0.0, 0.12, 9):
            _place(sound, float(start), 0.010 * _cricket(rng), 0.25 if rng.uniform() < 0.6 else 0.8)
        for start, hertz in ((0.6, 523.3), (1.9, 659.3), (3.3, 784.0), (4.1, 587.3)):
            _place(sound, start, 0.030 * _chime(hertz), float(rng.uniform(0.3, 0.7)))
    else:
        for start in (0.4, 0.62, 0.84, 2.1, 2.3, 3.5, 3.68, 3.86, 5.0):
            _place(sound, start, 0.030 * _bird(rng), 0.3 if start < 2.0 else 0.75)
    edge = np.clip(np.arange(sound.shape[1]) / (0.05 * SOUND_HZ), 0.0, 1.0)
    return np.clip(sound * edge * edge[::-1], -0.5, 0.5).astype(np.float32)
