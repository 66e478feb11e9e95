"""What lies between the lens and the decoded frame; none of it counts as CoC.

Scene-linear light in, 8-bit display-coded sRGB out: motion, the softness of lens and sensor, noise,
demosaicing, exposure, tone, sharpening, resampling, compression.
"""

from __future__ import annotations

import io
from fractions import Fraction

import av
import cv2
import numpy as np
import numpy.typing as npt

Float32 = npt.NDArray[np.float32]
Uint8 = npt.NDArray[np.uint8]
Rng = np.random.Generator


def to_code(linear: Float32) -> Float32:
    """Display-coded sRGB of scene-linear light."""
    low = linear <= 0.0031308
    curve = 1.055 * np.maximum(linear, 0.0031308) ** (1 / 2.4) - 0.055
    return np.where(low, 12.92 * linear, curve).astype(np.float32)


def moved(rng: Rng, linear: Float32) -> Float32:
    """Motion blur of the whole picture, 2 to 9 px in any direction."""
    length, angle = rng.uniform(2, 9), rng.uniform(0, np.pi)
    reach = 5
    kernel = np.zeros((2 * reach + 1, 2 * reach + 1), np.float32)
    for t in np.linspace(-0.5, 0.5, 64):
        x, y = reach + t * length * np.cos(angle), reach + t * length * np.sin(angle)
        i, j = int(y), int(x)
        fy, fx = y - i, x - j
        for di, dj, weight in (
            (0, 0, (1 - fy) * (1 - fx)),
            (0, 1, (1 - fy) * fx),
            (1, 0, fy * (1 - fx)),
            (1, 1, fy * fx),
        ):
            if i + di <= 2 * reach and j + dj <= 2 * reach:
                kernel[i + di, j + dj] += weight
    return cv2.filter2D(linear, -1, kernel / kernel.sum(), borderType=cv2.BORDER_REFLECT_101)


def demosaiced(linear: Float32) -> Float32:
    """The picture through a Bayer pattern and bilinear interpolation."""
    mosaic = np.empty(linear.shape[:2], np.float32)
    for y, x, channel in ((0, 0, 0), (0, 1, 1), (1, 0, 1), (1, 1, 2)):
        mosaic[y::2, x::2] = linear[y::2, x::2, channel]
    counts = np.uint16(np.clip(mosaic * 8000, 0, 65535))
    return np.float32(cv2.cvtColor(counts, cv2.COLOR_BayerRGGB2RGB)) / 8000


def sensed(rng: Rng, linear: Float32) -> Float32:
    """Read noise, shot noise and the fireflies-free grain of a path tracer."""
    shape = linear.shape if rng.random() < 0.7 else (*linear.shape[:2], 1)
    kind = rng.random()
    if kind < 0.15:
        return linear
    level = float(np.exp(rng.uniform(np.log(0.0008), np.log(0.03))))
    if kind < 0.6:
        deviation = level * np.sqrt(0.01 + np.maximum(linear, 0))
    elif kind < 0.8:
        deviation = level * (0.02 + np.maximum(linear, 0))  # a renderer's: in step with the light
    else:
        deviation = np.float32(0.3 * level)
    grain = rng.standard_normal(shape, dtype=np.float32)
    if rng.random() < 0.35:  # the reconstruction filter or the denoiser ties neighbours together
        grain = cv2.GaussianBlur(grain, (0, 0), rng.uniform(0.3, 0.8)).reshape(shape)
    return np.float32(linear + deviation * grain)


def noisy(rng: Rng, code: Float32) -> Float32:
    """Noise added to the code values, as an editor, a gained-up camera or a bad link leaves it."""
    deviation = np.float32(rng.uniform(0.004, 0.035))
    return np.clip(code + deviation * rng.standard_normal(code.shape, dtype=np.float32), 0, 1)


def toned(rng: Rng, linear: Float32) -> Float32:
    """Exposure, white balance, tone curve, clipping: scene-linear light to code values [0, 1]."""
    level = float(np.percentile(linear, rng.choice([50.0, 90.0]))) + 0.003
    gain = 1.0
    if rng.random() < 0.6:
        gain = np.clip(rng.uniform(0.05, 0.75) ** 1.5 / level, 0.2, 6)
    gain = gain * np.exp(rng.normal(0, 0.08, 3))
    code = to_code(np.clip(linear * gain, 0, 60).astype(np.float32))
    if rng.random() < 0.4:
        code = np.maximum(code, 0) ** np.float32(np.exp(rng.normal(0, 0.2)))
    if rng.random() < 0.3:
        pivot = rng.uniform(0.3, 0.6)
        code = pivot + (code - pivot) * rng.uniform(0.75, 1.35)
    if rng.random() < 0.15:  # a film-like shoulder instead of hard clipping
        code = np.where(code > 0.7, 0.7 + 0.3 * np.tanh((code - 0.7) / 0.3), code)
    if rng.random() < 0.15:
        grey = code.mean(-1, keepdims=True)
        code = grey + (code - grey) * rng.uniform(0, 1.4)
    return np.clip(code, 0, 1).astype(np.float32)


def sharpened(rng: Rng, code: Float32) -> Float32:
    """A camera's or an editor's unsharp mask, with its halos."""
    soft = cv2.GaussianBlur(code, (0, 0), rng.uniform(0.6, 1.6))
    return np.clip(code + rng.uniform(0.15, 1.0) * (code - soft), 0, 1).astype(np.float32)


def resampled(rng: Rng, code: Float32) -> Float32:
    """Stored a little smaller and enlarged again."""
    height, width = code.shape[:2]
    factor = rng.uniform(0.65, 0.95)
    small = cv2.resize(
        code, (int(width * factor), int(height * factor)), interpolation=cv2.INTER_AREA
    )
    way = int(rng.choice([cv2.INTER_LINEAR, cv2.INTER_CUBIC, cv2.INTER_LANCZOS4]))
    return np.clip(cv2.resize(small, (width, height), interpolation=way), 0, 1)


def denoised(rng: Rng, code: Float32) -> Float32:
    """A camera's noise reduction: faint grain smoothed between edges, the colour more than luma."""
    luma, red, blue = cv2.split(cv2.cvtColor(code, cv2.COLOR_RGB2YCrCb))
    spatial = rng.uniform(0.8, 2.5)
    luma = cv2.bilateralFilter(luma, 5, rng.uniform(0.01, 0.07), spatial)
    red, blue = (cv2.GaussianBlur(part, (0, 0), 1.5 * spatial) for part in (red, blue))
    return np.clip(cv2.cvtColor(cv2.merge([luma, red, blue]), cv2.COLOR_YCrCb2RGB), 0, 1)


def grainy(rng: Rng, code: Float32) -> Float32:
    """Grain of film or of an editor: finer or coarser than a pixel, the same in every channel."""
    grain = rng.standard_normal(code.shape[:2], dtype=np.float32)
    grain = cv2.GaussianBlur(grain, (0, 0), rng.uniform(0.2, 1.1))
    level = np.exp(rng.uniform(np.log(0.004), np.log(0.04))) / (grain.std() + 1e-9)
    return np.clip(code + np.float32(level) * grain[..., None], 0, 1)


def through_h264(picture: Uint8, crf: int, preset: str) -> Uint8:
    """One intra frame of H.264, yuv420p, and back."""
    buffer = io.BytesIO()
    with av.open(buffer, "w", format="nut") as container:
        stream = container.add_stream("libx264", rate=Fraction(25))
        stream.height, stream.width = picture.shape[:2]
        stream.pix_fmt = "yuv420p"
        stream.thread_count = 1
        stream.options = {"crf": str(crf), "preset": preset}
        frame = av.VideoFrame.from_ndarray(np.ascontiguousarray(picture), format="rgb24")
        for packet in [*stream.encode(frame), *stream.encode(None)]:
            container.mux(packet)
    buffer.seek(0)
    with av.open(buffer) as container:
        return next(container.decode(video=0)).to_ndarray(format="rgb24")


def compressed(rng: Rng, picture: Uint8) -> Uint8:
    """H.264 (two fifths of the pictures), JPEG (a quarter) or nothing."""
    kind = rng.random()
    if kind < 0.4:
        preset = "medium" if rng.random() < 0.5 else "veryfast"
        return through_h264(picture, int(rng.integers(14, 33)), preset)
    if kind < 0.65:
        quality = int(100 - 40 * rng.random() ** 1.7 - 2)
        _, data = cv2.imencode(".jpg", picture[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, quality])
        return np.ascontiguousarray(cv2.imdecode(data, cv2.IMREAD_COLOR)[..., ::-1])
    return picture


def photographed(rng: Rng, linear: Float32) -> Uint8:
    """A defocused scene as a decoded frame shows it, uint8 (H, W, 3) of scene-linear (H, W, 3)."""
    if rng.random() < 0.07:
        linear = moved(rng, linear)
    linear = cv2.GaussianBlur(linear, (0, 0), float(rng.triangular(0.2, 0.35, 0.9)))
    linear = linear * np.float32(np.exp(rng.normal(0, 0.2)))
    linear = sensed(rng, linear)
    if rng.random() < 0.12:
        linear = demosaiced(np.maximum(linear, 0))
    code = toned(rng, linear)
    if rng.random() < 0.15:
        code = sharpened(rng, code)
    if rng.random() < 0.06:
        code = resampled(rng, code)
    if rng.random() < 0.15:
        code = noisy(rng, code)
    return compressed(rng, np.uint8(np.clip(code * 255 + 0.5, 0, 255)))


def filmed(rng: Rng, linear: Float32) -> Uint8:
    """The picture of a camera that records H.264: every step that a phone or a hybrid takes.

    Args:
        rng: source of chance.
        linear: defocused scene-linear light (H, W, 3).

    Returns:
        The decoded frame, uint8 (H, W, 3).
    """
    if rng.random() < 0.05:
        linear = moved(rng, linear)
    linear = cv2.GaussianBlur(linear, (0, 0), float(rng.triangular(0.2, 0.4, 0.8)))
    level = np.exp(rng.uniform(np.log(0.002), np.log(0.05)))
    deviation = level * np.sqrt(0.02 + np.maximum(linear, 0))
    linear = linear + np.float32(deviation) * rng.standard_normal(linear.shape, dtype=np.float32)
    if rng.random() < 0.8:
        linear = demosaiced(np.maximum(linear, 0))
    code = toned(rng, np.float32(linear))
    if rng.random() < 0.6:
        code = denoised(rng, code)
    if rng.random() < 0.6:
        code = sharpened(rng, code)
    if rng.random() < 0.2:
        code = grainy(rng, code)
    picture = np.uint8(np.clip(code * 255 + 0.5, 0, 255))
    if rng.random() < 0.8:
        picture = through_h264(picture, int(rng.integers(18, 31)), "veryfast")
    return picture
