"""Clips that the tests make for themselves, through real codecs."""

from fractions import Fraction

import av
import numpy as np

from nlens_video.run.frame_range import FrameRange
from nlens_video.video.info import SourceFrame
from nlens_video.video.input.seek import open_seekable
from nlens_video.video.input.source import open_source
from nlens_video.video.output.sink import open_sink
from nlens_video.video.times.part import part_of

REPEATABLE = {"libx264": {"x264-params": "cpu-independent=1"}}
"""Options with which encoders give the same packets in each run, as `encoders.py` sets them."""
VFR = (0, 1000, 1467, 4000, 4001, 9013, 9500)


def noise_frame(width, height, pixel_format, seed=0):
    """A frame of noise over the codes of its depth."""
    frame = av.VideoFrame(width, height, pixel_format)
    rng = np.random.default_rng(seed)
    digits = "".join(filter(str.isdigit, pixel_format.split("p")[-1]))
    deep = pixel_format.endswith("le")
    for plane in frame.planes:
        size = plane.buffer_size
        if deep:
            peak = 1 << (int(digits) if digits in ("10", "12") else 16)
            plane.update(rng.integers(0, peak, size // 2).astype("<u2").tobytes())
        else:
            plane.update(rng.integers(0, 256, size).astype(np.uint8).tobytes())
    return frame


def planes(frame):
    """The visible bytes of every plane."""
    result = []
    for plane, component in zip(frame.planes, frame.format.components, strict=False):
        rows = np.frombuffer(plane, np.uint8).reshape(plane.height, plane.line_size)
        result.append(rows[:, : component.width * (2 if component.bits > 8 else 1)].copy())
    return result


def write_clip(
    path, frames, *, codec="ffv1", pts=None, time_base=Fraction(1, 16000), audio=False, rotation=0,
    mirrored=False, options=None, format_=None, rate=25, alpha=False,
):  # fmt: skip
    """Encode frames with given pts; optionally AAC or another codec, and a display matrix.

    `alpha` says in WebM that the pictures have alpha.
    """
    pts = [index * 640 for index in range(len(frames))] if pts is None else pts
    with av.open(str(path), "w", format=format_) as out:
        stream = out.add_stream(codec, rate, REPEATABLE.get(codec, {}) | (options or {}))
        stream.width, stream.height = frames[0].width, frames[0].height
        stream.pix_fmt = frames[0].format.name
        stream.time_base = stream.codec_context.time_base = time_base
        for name in ("colorspace", "color_range", "color_primaries", "color_trc"):
            setattr(stream.codec_context, name, getattr(frames[0], name))
        if alpha:
            stream.metadata["alpha_mode"] = "1"
        if rotation or mirrored:
            stream.set_display_rotation(rotation, hflip=mirrored)
        if audio:
            sound = out.add_stream("aac" if audio is True else audio, 48000, layout="mono")
        for frame, moment in zip(frames, pts, strict=True):
            frame.pts, frame.time_base = moment, time_base
            out.mux(stream.encode(frame))
        if audio:
            for index in range(20):
                tone = np.sin(np.arange(1024)[None] * 0.05 + index).astype(np.float32)
                block = av.AudioFrame.from_ndarray(tone, "fltp", "mono")
                block.sample_rate, block.pts = 48000, index * 1024
                out.mux(sound.encode(block))
            out.mux(sound.encode(None))
        out.mux(stream.encode(None))
    return path


def trim(path, target, frames, **options):
    """Copy a file's video and let an edit list leave out its first frames, as phones trim."""
    with av.open(str(path)) as given, av.open(str(target), "w", options=options) as made:
        video = given.streams.video[0]
        stream = made.add_stream_from_template(video)
        for packet in given.demux(video):
            if packet.dts is None:
                continue
            ticks = round(frames / video.average_rate / packet.time_base)
            packet.pts, packet.dts = packet.pts - ticks, packet.dts - ticks
            packet.stream = stream
            made.mux(packet)
    return target


def read_times(path):
    """Presentation times [s], exact."""
    with av.open(str(path)) as source:
        return [frame.pts * frame.time_base for frame in source.decode(video=0)]


def read_packets(path, kind="audio"):
    """The bytes of a stream's packets."""
    with av.open(str(path)) as source:
        stream = source.streams.best(kind)
        return [bytes(packet) for packet in source.demux(stream) if packet.dts is not None]


def copy(spec, target, *, box=None, **options):
    """Read everything and write it, with something composited on a box; gives the sink's notes."""
    with open_source(str(spec)) as source, open_sink(str(target), source.info, **options) as sink:
        source.packet_sink = sink.write_packet
        for frame in source:
            if box is not None:
                rgba = np.full((box.height, box.width, 4), 0.5, np.float32)
                frame.picture.composite_over(box, rgba)
            sink.write(frame)
        sink.commit()
        return sink.notes


def copy_range(plate, out, first, end):
    """Write a range as a run does; gives the sink's notes."""
    opened = open_seekable if first else open_source
    with (
        opened(str(plate)) as source,
        open_sink(str(out), part_of(source.info, (first, end))) as sink,
    ):
        for item in FrameRange(source, (first, end)).items():
            (sink.write if isinstance(item, SourceFrame) else sink.write_packet)(item)
        sink.commit()
        return sink.notes


def write_plates(folder, *numbers, size=(32, 24)):
    """PNG plates p_1001.png and so on, filled with the last two digits of their numbers."""
    for number in numbers:
        frame = av.VideoFrame.from_ndarray(
            np.full((size[1], size[0], 3), number % 100, np.uint8), "rgb24"
        )
        frame.save(str(folder / f"p_{number:04d}.png"))
    return folder / "p_%04d.png"


def mux_sound(out, stream, resampler, block):
    """Resample, encode and mux a block of sound; None for what the resampler still holds."""
    for part in resampler.resample(block):
        out.mux(stream.encode(part))
