"""What a camera's processing and a codec make of a plate: the same scene, the same truth.

PYTHONPATH=samples python -m truth.pipeline DIR --out ROUGH

For every folder of DIR one of the same name in ROUGH: its labels, and `bg.png` as a decoded frame
of footage shows it. What was done is drawn from the folder's name and kept in `params.json`.
"""

from __future__ import annotations

import argparse
import io
import json
import math
import shutil
import zlib
from dataclasses import asdict, dataclass
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np
import numpy.typing as npt
import OpenEXR
from PIL import Image

Float32 = npt.NDArray[np.float32]
UInt8 = npt.NDArray[np.uint8]
Rng = np.random.Generator
FRAMES = 5
"""Of the clip, whose middle one is kept: it is predicted from others, as most frames are."""
COUNTS = 16383.0
"""Of a 14-bit sensor at picture-linear 1."""
LEFT_OUT = ("bg.png", "bg.exr", "params.json")


@dataclass(frozen=True, slots=True, kw_only=True)
class Pipeline:
    """From the light on the sensor to a decoded frame.

    Attributes:
        electrons: that picture-linear 1 sets free in a pixel: the fewer, the more shot noise [1].
        read_electrons: standard deviation of reading a pixel [1].
        edges: whether demosaicing follows edges, or is bilinear.
        denoise: deviation that the denoiser takes for noise, 0: none [code value, 0 to 1].
        contrast: exponent of the tone curve's slope at its middle [1].
        sharpen: weight of the unsharp mask [1].
        radius_px: deviation of its Gaussian [px].
        codec: `libx264` or `libx265`, 8 bit, 4:2:0.
        crf: its constant rate factor [1].
    """

    electrons: float
    read_electrons: float
    edges: bool
    denoise: float
    contrast: float
    sharpen: float
    radius_px: float
    codec: str
    crf: int


def draw(rng: Rng) -> Pipeline:
    """A camera from a phone at night to a studio's."""
    electrons = math.exp(rng.uniform(math.log(600.0), math.log(40000.0)))
    grain = math.sqrt(0.2 * electrons) / (0.2 * electrons)
    return Pipeline(
        electrons=round(electrons),
        read_electrons=round(rng.uniform(1.5, 6.0), 2),
        edges=bool(rng.random() < 0.7),
        denoise=round(0.45 * grain * rng.uniform(0.5, 2.0), 4) if rng.random() < 0.7 else 0.0,
        contrast=round(rng.uniform(1.0, 1.5), 3),
        sharpen=round(max(0.0, rng.uniform(-0.2, 1.0)), 3),
        radius_px=round(rng.uniform(0.6, 1.4), 3),
        codec=str(rng.choice(["libx264", "libx265"])),
        crf=int(rng.integers(18, 31)),
    )


def sensed(light: Float32, pipeline: Pipeline, rng: Rng) -> Float32:
    """Light (H, W, 3) through a Bayer pattern, with shot and read noise, demosaiced."""
    mosaic = np.empty(light.shape[:2], np.float64)
    for y, x, channel in ((0, 0, 0), (0, 1, 1), (1, 0, 1), (1, 1, 2)):
        mosaic[y::2, x::2] = light[y::2, x::2, channel]
    electrons = rng.poisson(pipeline.electrons * np.clip(mosaic, 0.0, 1.5)).astype(np.float64)
    electrons += pipeline.read_electrons * rng.standard_normal(mosaic.shape)
    black = 0.03  # the offset of raw files keeps the noise of black symmetric
    counts = np.uint16(np.clip((electrons / pipeline.electrons + black) * COUNTS, 0, 65535))
    way = cv2.COLOR_BayerRGGB2RGB_EA if pipeline.edges else cv2.COLOR_BayerRGGB2RGB
    return np.float32(cv2.cvtColor(counts, way) / COUNTS - black)


def graded(light: Float32, pipeline: Pipeline) -> UInt8:
    """Denoise, tone-map and sharpen: picture-linear (H, W, 3) to 8-bit codes."""
    low = np.clip(light, 0.0, None)
    shoulder = np.where(low > 0.7, 0.7 + 0.3 * np.tanh((low - 0.7) / 0.3), low)
    linear = shoulder <= 0.0031308
    curve = 1.055 * np.maximum(shoulder, 0.0031308) ** (1 / 2.4) - 0.055
    code = np.float32(np.where(linear, 12.92 * shoulder, curve))
    if pipeline.denoise > 0.0:
        code = cv2.bilateralFilter(code, 7, 3.0 * pipeline.denoise, 1.6)
    pivot = 0.42
    below, above = code / pivot, (1.0 - code) / (1.0 - pivot)
    power = pipeline.contrast
    code = np.float32(
        np.where(code < pivot, pivot * below**power, 1.0 - (1.0 - pivot) * np.abs(above) ** power)
    )
    if pipeline.sharpen > 0.0:
        code = code + pipeline.sharpen * (code - cv2.GaussianBlur(code, (0, 0), pipeline.radius_px))
    return np.uint8(np.clip(255.0 * code + 0.5, 0, 255))


def through_codec(frames: list[UInt8], pipeline: Pipeline) -> UInt8:
    """Encode a clip, decode it and return its middle frame."""
    buffer = io.BytesIO()
    with av.open(buffer, "w", format="matroska") as container:
        stream = container.add_stream(pipeline.codec, rate=Fraction(25))
        stream.height, stream.width = frames[0].shape[:2]
        stream.pix_fmt = "yuv420p"
        stream.options = {"crf": str(pipeline.crf), "preset": "medium", "threads": "1"}
        if pipeline.codec == "libx265":
            stream.options |= {"x265-params": "log-level=none:pools=none:frame-threads=1"}
        for picture in frames:
            shown = av.VideoFrame.from_ndarray(picture, format="rgb24").reformat(
                format="yuv420p", dst_colorspace="ITU709", dst_color_range="MPEG"
            )
            container.mux(stream.encode(shown))
        container.mux(stream.encode())
    buffer.seek(0)
    with av.open(buffer) as container:
        decoded = list(container.decode(video=0))
    return decoded[len(decoded) // 2].to_ndarray(
        format="rgb24", src_colorspace="ITU709", src_color_range="MPEG"
    )


def footage(light: Float32, pipeline: Pipeline, rng: Rng) -> UInt8:
    """A frame of a still clip of picture-linear light (H, W, 3), H and W even."""
    clip = [graded(sensed(light, pipeline, rng), pipeline) for _ in range(FRAMES)]
    return through_codec(clip, pipeline)


def read_light(path: Path) -> Float32:
    """Picture-linear light (H, W, 3) of `bg.exr`."""
    channels = OpenEXR.File(str(path), separate_channels=True).channels()
    return np.stack([np.asarray(channels[c].pixels, np.float32) for c in "RGB"], axis=-1)


def convert(folder: Path, out: Path) -> None:
    """One folder of ground truth to the same with the picture as footage."""
    rng = np.random.default_rng(zlib.crc32(folder.name.encode()))
    pipeline = draw(rng)
    fresh = out.with_name(out.name + ".new")
    shutil.rmtree(fresh, ignore_errors=True)
    shutil.copytree(folder, fresh, ignore=shutil.ignore_patterns(*LEFT_OUT))
    Image.fromarray(footage(read_light(folder / "bg.exr"), pipeline, rng)).save(fresh / "bg.png")
    known = json.loads((folder / "params.json").read_text()) | {"pipeline": asdict(pipeline)}
    (fresh / "params.json").write_text(json.dumps(known, indent=1))
    shutil.rmtree(out, ignore_errors=True)
    fresh.replace(out)


def main() -> None:
    """Convert every folder."""
    parser = argparse.ArgumentParser(prog="truth.pipeline", description=__doc__.splitlines()[0])
    parser.add_argument("plates", type=Path)
    parser.add_argument("--out", type=Path, required=True)
    given = parser.parse_args()
    given.out.mkdir(parents=True, exist_ok=True)
    for path in sorted(given.plates.glob("*/bg.exr")):
        if not path.parent.name.endswith(".new"):
            convert(path.parent, given.out / path.parent.name)


if __name__ == "__main__":
    main()
