"""Clips of files for VapourSynth, whose wheel brings no reader; and frames in FFmpeg's planes."""

from __future__ import annotations

from pathlib import Path

import av
import numpy as np
import vapoursynth as vs

FORMATS = {
    "yuv420p": vs.YUV420P8, "yuv444p": vs.YUV444P8, "yuv422p10le": vs.YUV422P10,
    "gbrp10le": vs.RGB30,
}  # fmt: skip
_GBR = (2, 0, 1)  # VapourSynth's R, G, B among FFmpeg's G, B, R
_RGB = (1, 2, 0)


def clip_of(path: str | Path) -> vs.VideoNode:
    """The frames of a file, with the properties that sources set."""
    with av.open(str(path)) as container:
        rate = container.streams.video[0].average_rate
        frames = list(container.decode(video=0))
    first = frames[0]
    blank = vs.core.std.BlankClip(
        format=FORMATS[first.format.name], width=first.width, height=first.height,
        length=len(frames), fpsnum=rate.numerator, fpsden=rate.denominator,
    )  # fmt: skip
    blank = blank.std.SetFrameProps(
        _Matrix=int(first.colorspace), _Transfer=int(first.color_trc),
        _Primaries=int(first.color_primaries), _Range=int(first.color_range) - 1,
    )  # fmt: skip

    def filled(n: int, f: vs.VideoFrame) -> vs.VideoFrame:
        made, frame = f.copy(), frames[n]
        order = _GBR if made.format.color_family == vs.RGB else (0, 1, 2)
        for number, place in enumerate(order):
            target = np.asarray(made[number])
            plane = frame.planes[place]
            rows = np.frombuffer(plane, target.dtype).reshape(plane.height, -1)
            target[...] = rows[:, : target.shape[1]]
        return made

    return blank.std.ModifyFrame(clips=blank, selector=filled)


def without_rate(clip: vs.VideoNode) -> vs.VideoNode:
    """The clip as one whose rate varies."""
    other = clip.std.AssumeFPS(fpsnum=50)
    blank = vs.core.std.Splice([clip[0], other[1:]], mismatch=True)
    return blank.std.SetFrameProps(_DurationNum=1, _DurationDen=25)


def timed(clip: vs.VideoNode, times_s: list[float]) -> vs.VideoNode:
    """The clip with a time at each frame."""

    def with_time(n: int, f: vs.VideoFrame) -> vs.VideoFrame:
        made = f.copy()
        made.props["_AbsoluteTime"] = times_s[n]
        return made

    return clip.std.ModifyFrame(clips=clip, selector=with_time)


def planes_by_ffmpeg(frame: vs.VideoFrame) -> list[np.ndarray]:
    """Copies of a frame's planes, in FFmpeg's order."""
    planes = [np.asarray(frame[number]).copy() for number in range(frame.format.num_planes)]
    return [planes[number] for number in _RGB] if frame.format.color_family == vs.RGB else planes
