"""Sound whose channels or rate change within the plate, as where a broadcast goes to a film."""

from fractions import Fraction

import av
import numpy as np
import pytest
from support.clips import copy, noise_frame

RATE = 48000
SECONDS = 1


def write_part(path, codec, layout, rate, *, begins):
    """A second of pictures and of a tone, at its own time [s] of a broadcaster's clock."""
    with av.open(str(path), "w", format="mpegts") as out:
        video = out.add_stream("mpeg2video", 25)
        video.width, video.height, video.pix_fmt = 64, 48, "yuv420p"
        sound = out.add_stream(codec, rate, layout=layout)
        for index in range(25 * SECONDS):
            frame = noise_frame(64, 48, "yuv420p", index)
            frame.pts, frame.time_base = begins * 25 + index, Fraction(1, 25)
            out.mux(video.encode(frame))
        kind = sound.codec_context.codec.audio_formats[0].name
        resampler = av.AudioResampler(kind, layout, rate, sound.frame_size)
        tone = np.sin(np.arange(rate * SECONDS) * 0.06).astype(np.float32) * 0.3
        packed = tone.repeat(av.AudioLayout(layout).nb_channels)[None]
        block = av.AudioFrame.from_ndarray(packed, "flt", layout)
        block.sample_rate, block.pts, block.time_base = rate, begins * rate, Fraction(1, rate)
        for part in (*resampler.resample(block), *resampler.resample(None)):
            out.mux(sound.encode(part))
        out.mux([*video.encode(None), *sound.encode(None)])
    return path.read_bytes()


def plate(folder, *parts):
    """A transport stream of parts, each with codec, layout and rate of its sound."""
    path = folder / "in.ts"
    path.write_bytes(b"".join(
        write_part(folder / "part.ts", *part, begins=number) for number, part in enumerate(parts)
    ))  # fmt: skip
    return path


def heard(path):
    """Loudness of every 20 ms of a file's sound, from its start at 0 on."""
    with av.open(str(path)) as source:
        even = av.AudioResampler("flt", "mono", RATE)
        parts = [part for frame in source.decode(audio=0) for part in even.resample(frame)]
    samples = np.concatenate([part.to_ndarray()[0] for part in parts])
    return np.sqrt((samples[: len(samples) // 960 * 960].reshape(-1, 960) ** 2).mean(axis=1))


@pytest.mark.parametrize("name", ["out.webm", "out.mxf"])
@pytest.mark.parametrize(
    ("codec", "before", "after", "told"),
    [
        ("ac3", ("stereo", RATE), ("5.1", RATE), "stereo, 48000 Hz, to 5.1(side), 48000 Hz"),
        ("aac", ("stereo", RATE), ("mono", RATE), "stereo, 48000 Hz, to mono, 48000 Hz"),
        ("aac", ("stereo", RATE), ("stereo", 44100), "stereo, 48000 Hz, to stereo, 44100 Hz"),
        ("mp2", ("mono", RATE), ("stereo", RATE), "mono, 48000 Hz, to stereo, 48000 Hz"),
    ],
)
def test_sound_that_changes_within_the_plate_is_reencoded_to_its_end(
    tmp_path, name, codec, before, after, told
):
    source = plate(tmp_path, (codec, *before), (codec, *after), (codec, *before))
    notes = copy(source, tmp_path / name)
    (note,) = (one for one in notes if "changes" in one)
    assert note == (
        f"stream 1 (audio) changes from {told}: all of it becomes {before[0]}, {before[1]} Hz"
    )
    loud = heard(tmp_path / name)
    assert len(loud) == pytest.approx(3 * SECONDS * 50, abs=4)
    quiet = (loud[5:145] < 0.05).sum()
    assert quiet <= 4  # the parts' encoders begin with up to 40 ms of silence
