"""Small clips for the check: a panning plate, and a composite whose faults the tests choose."""

from fractions import Fraction

import av
import cv2
import numpy as np
from av.video.reformatter import Interpolation
from support.clips import REPEATABLE

WIDTH, HEIGHT, FRAMES, RATE = 320, 192, 24, 25


# swscale truncates otherwise, and darkens by a level
_UNBIASED = Interpolation.BICUBIC | Interpolation.ACCURATE_RND | Interpolation.FULL_CHR_H_INT


def texture(shape, seed, softest=3):
    """Noise of several scales, 0 to 1."""
    rng = np.random.default_rng(seed)
    total = np.zeros((*shape, 3), np.float32)
    for octave in range(1, softest + 3):
        small = rng.random((shape[0] >> octave or 1, shape[1] >> octave or 1, 3), np.float32)
        total += cv2.resize(small, shape[::-1], interpolation=cv2.INTER_CUBIC) - 0.5
    grey = total.mean(axis=2, keepdims=True)
    return np.clip(0.5 + 0.3 * (grey + 0.3 * (total - grey)), 0.05, 0.95)


WORLD = texture((HEIGHT, WIDTH + 100), 1)
SKIN = np.clip(1.4 * texture((96, 96), 2) * np.array([1.2, 0.7, 0.3], np.float32), 0, 1)


def plate(number, *, pan=2.0):
    """What the camera sees on a frame, (H, W, 3) in [0, 1]."""
    move = np.array([[1, 0, -pan * number], [0, 1, 0]], np.float32)
    return cv2.warpAffine(WORLD, move, (WIDTH, HEIGHT), flags=cv2.INTER_LINEAR)


def with_object(picture, number, *, sigma=1.5, detail=1.0, place=None, gains=(1, 1, 1)):
    """A patterned disc that slides over a picture, blurred, its detail and its colours scaled.

    `place` is that of its middle, by default on a straight line.
    """
    x, y = (88 + 3.0 * number, 88 + 1.5 * number) if place is None else place
    layer = np.zeros((96, 96, 4), np.float32)
    cv2.circle(layer, (48, 48), 30, (1, 1, 1, 1), -1)
    layer[..., :3] *= np.clip(SKIN.mean((0, 1)) + detail * (SKIN - SKIN.mean((0, 1))), 0, 1)
    layer[..., :3] *= np.array(gains, np.float32)
    move = np.array([[1, 0, x - 48], [0, 1, y - 48]], np.float32)
    spread = cv2.warpAffine(layer, move, (WIDTH, HEIGHT), flags=cv2.INTER_LINEAR)
    blurred = cv2.GaussianBlur(spread, (0, 0), sigma)
    return blurred[..., :3] + (1 - blurred[..., 3:]) * picture


def encode(
    path, pictures, *, size=(WIDTH, HEIGHT), times=None, crf=18, codec="libx264",
    audio_shift_s=0.0, audio=True, audio_codec="aac", loudness=0.1,
    aspect=None,
):  # fmt: skip
    """Write pictures in [0, 1] as 4:2:0 video with a tone of some loudness in [0, 1] beside it.

    `aspect` is the width of a pixel by its height.
    """
    with av.open(str(path), "w") as out:
        stream = out.add_stream(codec, rate=RATE)
        (stream.width, stream.height), stream.pix_fmt = size, "yuv420p"
        if codec == "libx264":
            stream.options = {"crf": str(crf), "preset": "veryfast", **REPEATABLE[codec]}
        stream.codec_context.time_base = Fraction(1, 1000)
        if aspect is not None:
            stream.codec_context.sample_aspect_ratio = aspect
        sound = out.add_stream(audio_codec, rate=48000, layout="mono") if audio else None
        if sound is not None:
            for at in range(RATE * 4 // 5):
                _tone(out, sound, at, audio_shift_s, loudness)
            out.mux(sound.encode())
        for number, picture in enumerate(pictures):
            coded = np.clip(np.round(255 * picture), 0, 255).astype(np.uint8)
            frame = av.VideoFrame.from_ndarray(coded, "rgb24").reformat(
                format="yuv420p", dst_colorspace="ITU709", dst_color_range="MPEG"
            )
            frame.pts = round(1000 / RATE * (number if times is None else times[number]))
            frame.time_base = Fraction(1, 1000)
            out.mux(stream.encode(frame))
        out.mux(stream.encode())
    return path


def _tone(out, sound, at, shift_s, loudness):
    count = 48000 // RATE
    wave = loudness * np.sin(0.05 * (np.arange(count) + at * count)).astype(np.float32)
    block = av.AudioFrame.from_ndarray(wave[None], "fltp", "mono")
    block.sample_rate, block.time_base = 48000, Fraction(1, 48000)
    block.pts = at * count + round(48000 * shift_s)
    out.mux(sound.encode(block))


def coded_again(source, path, codec, pixels, options, *, color_trc=2):
    """The samples of a file in another codec, their transfer function tagged, if at all."""
    with av.open(str(source)) as given, av.open(str(path), "w") as out:
        shown = given.streams.video[0]
        stream = out.add_stream(codec, rate=RATE)
        stream.width, stream.height = shown.width, shown.height
        stream.pix_fmt, stream.options = pixels, options
        stream.codec_context.color_trc = color_trc
        for number, frame in enumerate(given.decode(shown)):
            coded = frame.reformat(format=pixels, interpolation=_UNBIASED)
            coded.pts, coded.time_base, coded.pict_type = number, Fraction(1, RATE), 0
            coded.color_trc = color_trc
            out.mux(stream.encode(coded))
        out.mux(stream.encode())
    return path


def decode(path):
    """The pictures of a file, in [0, 1]."""
    with av.open(str(path)) as source:
        for frame in source.decode(video=0):
            picture = frame.reformat(
                format="rgb24", src_colorspace="ITU709", interpolation=_UNBIASED
            )
            yield picture.to_ndarray().astype(np.float32) / 255


def composite(source, path, *, looks=None, times=None, **options):
    """Composite on a plate's file; `looks` gives the options of `with_object` by frame."""
    pictures = [
        with_object(picture, number, **(looks(number) if looks else {}))
        for number, picture in enumerate(decode(source))
    ]
    return encode(path, pictures, times=times, **options)
