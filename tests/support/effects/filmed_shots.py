"""Plates of known scenes, taken by a camera with known effects, through a real encoder."""

from __future__ import annotations

import io
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache

import av
import cv2
import numpy as np
import scipy.fft
from support.clips import REPEATABLE

from nlens_video.video.pixels.picture import AvPicture

WIDTH, HEIGHT = 800, 450
CORNER_PX = float(np.hypot(WIDTH / 2, HEIGHT / 2))
_FINE = 2  # scenes are drawn on a grid so much finer, warped there, then averaged
FINE = (HEIGHT * _FINE, WIDTH * _FINE)


@dataclass(frozen=True, kw_only=True)
class Camera:
    """What a camera does to a scene.

    Attributes:
        aberration: (linear, cubic) displacement of red at the corner, blue half as much the other
            way [px].
        vignetting: loss at the corner [stops].
        distortion: k1 of Brown's model, radius in half diagonals [1].
        bloom: (share of the light, decay length [px]) of the halo round what clips.
        drift: change of the exposure from frame to frame [stops].
        balance: change of red against blue from frame to frame [stops].
        noise: deviation at white [1].
        crf: quality of the H.264 encoder, None for no compression.
        pan: columns and rows from frame to frame [px].
        entering: whether something dark and large comes into view.
    """

    aberration: tuple[float, float] = (0.0, 0.0)
    vignetting: float = 0.0
    distortion: float = 0.0
    bloom: tuple[float, float] = (0.0, 12.0)
    drift: float = 0.0
    balance: float = 0.0
    noise: float = 0.004
    crf: int | None = 20
    pan: tuple[float, float] = (0.0, 0.0)
    entering: bool = False


@lru_cache(maxsize=4)
def spectrum(seed, exponent, contrast=0.6, colour=0.2):
    """Noise of a given spectrum, scene-linear (H, W, 3), partly the same in all channels."""
    rng = np.random.default_rng(seed)
    size = FINE
    rows, columns = np.fft.fftfreq(size[0])[:, None], np.fft.rfftfreq(size[1])[None, :]
    far = np.hypot(rows, columns).astype(np.float32)
    gain = np.maximum(far, 1.0 / size[1]) ** -exponent
    gain *= np.exp(-((far / 0.2) ** 2))  # a lens resolves no more
    white = [scipy.fft.rfft2(rng.standard_normal(size, np.float32)) for _ in range(4)]
    mixed = [np.sqrt(1 - colour**2) * white[3] + colour * white[k] for k in range(3)]
    out = np.stack([scipy.fft.irfft2(one * gain, size) for one in mixed], axis=-1)
    return 0.18 * np.exp(np.float32(contrast / out.std()) * out)


def street(seed, count=60, plain=0.08):
    """Coloured quadrilaterals in front of each other, each with a fine texture."""
    rng = np.random.default_rng(seed)
    height, width = FINE
    grain = np.log(spectrum(seed + 1, 0.8, plain, 0.2) / 0.18)
    light = np.full((*FINE, 3), 0.25, np.float32)
    for _ in range(count):
        centre = rng.uniform(0, 1, 2) * (width, height)
        side = rng.uniform(0.04, 0.22, 2) * width
        turn = rng.uniform(0, np.pi) if rng.random() < 0.4 else rng.normal(0, 0.04)
        box = cv2.boxPoints(((float(centre[0]), float(centre[1])), tuple(side), np.degrees(turn)))
        colour = 0.02 + 0.6 * rng.random() * rng.uniform(0.4, 1.0, 3)
        cv2.fillConvexPoly(
            light, np.int32(box * 16), tuple(map(float, colour)), lineType=cv2.LINE_AA, shift=4
        )
    return cv2.GaussianBlur(light, (0, 0), 1.2) * np.exp(grain)


def defocused(light, near=2.0, far=30.0):
    """Sharp in a band in the middle, blurred more and more towards top and bottom."""
    height = len(light)
    out = light.copy()
    away = np.abs(np.linspace(-1, 1, height))
    for step, width in enumerate(np.linspace(near, far, 5)):
        cover = np.clip((away - 0.15 - 0.16 * step) / 0.08, 0, 1)[:, None, None]
        out = (1 - cover) * out + cover * cv2.GaussianBlur(light, (0, 0), width / 2)
    return out.astype(np.float32)


def lit(light, slope=1.2):
    """The same, brighter to one side: an open window."""
    across = np.linspace(-0.5, 0.5, light.shape[1])[None, :, None]
    return (light * np.exp2(slope * across)).astype(np.float32)


def room(seed):
    """Tiles and shelves: long straight edges in both directions, seen a little askew."""
    rng = np.random.default_rng(seed)
    height, width = FINE
    light = np.full((*FINE, 3), 0.3, np.float32)
    skew = rng.uniform(-0.05, 0.05)
    for i, x in enumerate(np.linspace(-0.1, 1.1, 9)):
        tone = 0.12 + 0.5 * rng.random()
        quad = np.array([[x, -0.1], [x + 0.13, -0.1], [x + 0.13 + skew, 1.1], [x + skew, 1.1]])
        quad[:, 0] += 0.01 * i
        colour = tuple(float(tone * c) for c in rng.uniform(0.7, 1.0, 3))
        cv2.fillConvexPoly(light, np.int32(quad * (width, height) * 16), colour, cv2.LINE_AA, 4)
    for y in np.linspace(0.06, 0.94, 5):
        tilt = rng.uniform(-0.02, 0.02)
        quad = np.array(
            [[-0.1, y - tilt], [1.1, y + tilt], [1.1, y + 0.03 + tilt], [-0.1, y + 0.03 - tilt]]
        )
        colour = tuple(float(0.05 + 0.5 * rng.random()) for _ in range(3))
        cv2.fillConvexPoly(light, np.int32(quad * (width, height) * 16), colour, cv2.LINE_AA, 4)
    grain = np.log(spectrum(seed + 1, 0.8, 0.06, 0.2) / 0.18)
    return cv2.GaussianBlur(light, (0, 0), 1.2) * np.exp(grain)


def lamps(seed, count=9, radiance=8.0, blur=1.2):
    """A dim scene with lamps that clip."""
    rng = np.random.default_rng(seed)
    light = 0.15 * street(seed, 40)
    height, width = FINE
    for _ in range(count):
        centre = np.int32(rng.uniform(0.08, 0.92, 2) * (width, height) * 16)
        radius = int(rng.uniform(6, 16) * _FINE * 16)
        cv2.circle(
            light, tuple(map(int, centre)), radius, (radiance,) * 3, -1, cv2.LINE_AA, shift=4
        )
    return cv2.GaussianBlur(light, (0, 0), blur)


def dots(seed, count=25, blur=8.0):
    """Defocused lights and a bright window: highlights that clip, with soft borders, no halo."""
    rng = np.random.default_rng(seed)
    light = lamps(seed, count=0)
    spots = np.zeros_like(light)
    height, width = light.shape[:2]
    for _ in range(count):
        centre = rng.uniform(0.03, 0.97, 2) * (width, height)
        colour = tuple(rng.uniform(1.0, 5.0) * rng.uniform(0.6, 1.0, 3))
        cv2.circle(spots, tuple(map(int, centre)), int(rng.uniform(6, 30)), colour, -1, cv2.LINE_AA)
    cv2.rectangle(spots, (100, 200), (380, 520), (3.0, 3.0, 3.2), -1)
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (int(4 * blur) | 1,) * 2)
    disc = disc.astype(np.float32) / disc.sum()
    return light + cv2.filter2D(spots, -1, disc)


def _radius(size):
    """Columns, rows from the middle and radius, in half diagonals (H, W)."""
    height, width = size
    half = 0.5 * np.hypot(width, height)
    x = (np.arange(width) + 0.5 - 0.5 * width) / half
    y = (np.arange(height) + 0.5 - 0.5 * height) / half
    x, y = np.meshgrid(x, y)
    return x, y, np.hypot(x, y)


def _warped(plane, displacement_px):
    """Light that a lens moves outwards; `displacement_px` of the radius where it ends up."""
    x, y, r = _radius(plane.shape[:2])
    half = 0.5 * np.hypot(*plane.shape[:2])
    scale = half * (r - displacement_px(r) / half) / np.maximum(r, 1e-9)
    return cv2.remap(
        plane,
        (x * scale + 0.5 * plane.shape[1] - 0.5).astype(np.float32),
        (y * scale + 0.5 * plane.shape[0] - 0.5).astype(np.float32),
        cv2.INTER_CUBIC,
        borderMode=cv2.BORDER_REFLECT,
    )


def _distorted_from(k1):
    """Displacement [fine px] as a function of the distorted radius of r_d = r (1 + k1 r^2)."""
    r = np.linspace(0, 2, 4001)
    half = _FINE * CORNER_PX
    grows = r * (1 + k1 * r**2)
    keep = np.concatenate([[True], np.diff(np.maximum.accumulate(grows)) > 0])
    return lambda at: half * (at - np.interp(at, grows[keep], r[keep]))


def seen_by(light, camera):
    """The light that reaches the sensor (H, W, 3), from a scene on the fine grid."""
    light = light.astype(np.float32)
    if camera.distortion:
        light = _warped(light, _distorted_from(camera.distortion))
    linear, cubic = (part * _FINE for part in camera.aberration)
    if linear or cubic:
        planes = [
            _warped(light[..., k], lambda r, sign=sign: sign * (linear * r + cubic * r**3))
            for k, sign in ((0, 1.0), (1, 0.0), (2, -0.5))
        ]
        light = np.stack(planes, axis=-1)
    light = cv2.resize(light, (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA)
    light *= np.exp2(-camera.vignetting * _falloff(_radius((HEIGHT, WIDTH))[2]))[..., None]
    share, length = camera.bloom
    if share:
        light = (1 - share) * light + share * _spread(light, length)
    return light


def _falloff(r):
    """Shape of the loss, as a lens has it: between the square and the fourth power."""
    return 0.5 * r**2 + 0.5 * r**4


def halo_levels(light, bloom):
    """What a halo adds beside what clips, 4 to 8 px from it, on an exact picture [8-bit levels]."""
    before = cv2.resize(light.astype(np.float32), (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA)
    after = seen_by(light, Camera(bloom=bloom))
    grey = np.array([0.2126, 0.7152, 0.0722])
    clipped = (after @ grey > 0.92).astype(np.uint8)
    away = cv2.distanceTransform(1 - clipped, cv2.DIST_L2, 5)
    strip = (away >= 4) & (away < 8)
    return float(255 * np.mean((coded(after @ grey) - coded(before @ grey))[strip]))


def _spread(light, length):
    """Light through a halo that decays exponentially."""
    reach = int(8 * length)
    at = np.hypot(*np.meshgrid(*2 * [np.arange(-reach, reach + 1)]))
    kernel = np.exp(-at / length)
    out = cv2.filter2D(light, -1, kernel / kernel.sum(), borderType=cv2.BORDER_REFLECT)
    return out


def coded(light):
    light = np.clip(light, 0, 1)
    return np.where(
        light < 0.018053968510807, 4.5 * light, 1.099296826809442 * light**0.45 - 0.099296826809442
    )


def filmed(scene, camera=None, frames=2, seed=7):
    """The pictures that a camera takes of a scene; the camera's pictures are the decoder's."""
    camera = camera or Camera()
    rng = np.random.default_rng(seed)
    light = scene() if callable(scene) else scene
    still = seen_by(light, camera)
    shots = []
    for number in range(frames):
        seen = still
        if any(camera.pan):
            move = np.float32([[1, 0, -number * camera.pan[0]], [0, 1, -number * camera.pan[1]]])
            big = cv2.resize(light, None, fx=0.75, fy=0.75, interpolation=cv2.INTER_AREA)
            seen = cv2.warpAffine(big, move, (WIDTH, HEIGHT), borderMode=cv2.BORDER_REFLECT)
        seen = seen * np.exp2(camera.drift * number)
        seen = seen * np.exp2(camera.balance * number * np.array([0.5, 0.0, -0.5]))
        if camera.entering:
            seen[:, : int(WIDTH * 0.045 * number)] = (0.05, 0.03, 0.02)
        deviation = camera.noise * np.sqrt(np.clip(seen, 0.01, 1))
        seen = seen + deviation * rng.standard_normal(seen.shape)
        shots.append(np.uint8(np.rint(255 * coded(seen))))
    return decoded(shots, camera.crf)


def decoded(shots, crf):
    """Frames (H, W, 3) uint8 as a decoder gives them back."""
    if crf is None:
        tagged = [av.VideoFrame.from_ndarray(shot, "rgb24") for shot in shots]
        for frame in tagged:
            frame.color_trc, frame.color_primaries = 1, 1
        return [AvPicture(frame) for frame in tagged]
    memory = io.BytesIO()
    with av.open(memory, "w", format="matroska") as container:
        stream = container.add_stream("libx264", rate=25)
        stream.width, stream.height, stream.pix_fmt = WIDTH, HEIGHT, "yuv420p"
        stream.options = {"crf": str(crf), "preset": "medium", **REPEATABLE["libx264"]}
        context = stream.codec_context
        context.colorspace, context.color_range = 1, 1
        context.color_trc, context.color_primaries = 1, 1
        for number, shot in enumerate(shots):
            frame = av.VideoFrame.from_ndarray(shot, "rgb24").reformat(
                format="yuv420p", dst_colorspace="ITU709", dst_color_range="MPEG"
            )
            frame.pts, frame.time_base = number, Fraction(1, 25)
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
    memory.seek(0)
    with av.open(memory) as container:
        return [AvPicture(frame) for frame in container.decode(video=0)]
