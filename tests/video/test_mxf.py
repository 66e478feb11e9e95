"""MXF, and DV as well, hold all pictures of a shot, each with sound of its time."""

from fractions import Fraction

import av
import numpy as np
import pytest
from support.clips import copy, copy_range, mux_sound, noise_frame, write_clip

from nlens_video.video.input.source import open_source
from nlens_video.video.output.sink import open_sink

RATE = 48000
BLOCK = 960
"""Samples of a block of sound [1]."""


def count(path, kind):
    """Packets of the first stream of a kind."""
    with av.open(str(path)) as source:
        return sum(packet.size > 0 for packet in source.demux(source.streams.best(kind)))


def test_a_shot_without_cuts_gets_key_frames_as_often_as_its_index_requires(tmp_path):
    still = noise_frame(32, 24, "yuv420p")
    plate = write_clip(tmp_path / "in.mp4", [still] * 400, codec="libx264")
    copy(plate, tmp_path / "out.mxf")
    assert count(tmp_path / "out.mxf", "video") == 400


def write_plate(path, sound_s, *, codec="pcm_s16le", layout="mono", size=(64, 48), pictures=40):
    """A clip of some pictures, 25 a second, and for some time a ramp as its sound."""
    with av.open(str(path), "w") as out:
        video = out.add_stream("mpeg2video", 25)
        (video.width, video.height), video.pix_fmt = size, "yuv420p"
        sound = out.add_stream(codec, RATE, layout=layout)
        for index in range(pictures):
            frame = noise_frame(*size, "yuv420p", index)
            frame.pts, frame.time_base = index, Fraction(1, 25)
            out.mux(video.encode(frame))
        kind = sound.codec_context.codec.audio_formats[0].name
        resampler = av.AudioResampler(kind, layout, RATE, sound.frame_size or BLOCK)
        channels = sound.codec_context.layout.nb_channels
        for start in range(0, round(sound_s * RATE), BLOCK):
            samples = ramp(start, BLOCK).repeat(channels)[None]
            block = av.AudioFrame.from_ndarray(samples, "s16", layout)
            block.sample_rate, block.pts, block.time_base = RATE, start, Fraction(1, RATE)
            mux_sound(out, sound, resampler, block)
        mux_sound(out, sound, resampler, None)
        out.mux([*sound.encode(None), *video.encode(None)])
    return path


def ramp(start, count):
    """Samples that tell their own place; none of them is 0."""
    return (np.arange(start, start + count) % 30000 + 1).astype(np.int16)


def heard(path):
    """All samples of a file's sound (n, channel)."""
    with av.open(str(path)) as source:
        channels = source.streams.audio[0].codec_context.layout.nb_channels
        blocks = [frame.to_ndarray().reshape(-1, channels) for frame in source.decode(audio=0)]
    return np.concatenate(blocks)


@pytest.mark.parametrize("codec", ["pcm_s16le", "mp2"])
def test_sound_that_ends_before_the_pictures_costs_none_of_them(tmp_path, codec):
    plate = write_plate(tmp_path / "in.mov", 0.5, codec=codec)
    notes = copy(plate, tmp_path / "out.mxf")
    assert count(tmp_path / "out.mxf", "video") == 40
    assert count(tmp_path / "out.mxf", "audio") == 40
    assert any("(audio)" in note for note in notes) == (codec == "mp2")


def test_pictures_do_not_wait_in_memory_for_sound_that_has_ended(tmp_path):
    plate, out = write_plate(tmp_path / "in.mov", 0.5, pictures=1000), tmp_path / "out.mxf"
    with open_source(str(plate)) as source, open_sink(str(out), source.info) as sink:
        source.packet_sink = sink.write_packet
        for frame in source:
            sink.write(frame)
        (partial,) = tmp_path.glob(".*")
        written = partial.stat().st_size
        sink.commit()
    assert count(out, "video") == 1000
    assert written > 0.7 * out.stat().st_size  # the last 10 of 40 seconds may wait


def test_dv_keeps_all_pictures_where_the_sound_ends_before_them(tmp_path):
    plate = write_plate(tmp_path / "in.mov", 0.5, layout="stereo", size=(720, 576))
    copy(plate, tmp_path / "out.dv")
    assert count(tmp_path / "out.dv", "video") == 40


@pytest.mark.parametrize(
    ("layout", "ending"),
    [("mono", "mov"), ("5.1", "mov"), ("hexadecagonal", "mov"), ("hexadecagonal", "mkv")],
)
def test_samples_without_loss_stay_before_the_silence_at_the_end(tmp_path, layout, ending):
    plate = write_plate(tmp_path / f"in.{ending}", 0.5, layout=layout)
    assert not [note for note in copy(plate, tmp_path / "out.mxf") if "(audio)" in note]
    found, told = heard(tmp_path / "out.mxf"), heard(plate)
    np.testing.assert_array_equal(found[: len(told)], told)
    assert len(found) == round(1.6 * RATE)
    assert not found[len(told) :].any()


def test_a_range_after_the_end_of_the_sound_is_silent(tmp_path):
    plate = write_plate(tmp_path / "in.mov", 0.5)
    copy_range(plate, tmp_path / "out.mxf", 24, 40)
    assert count(tmp_path / "out.mxf", "video") == 16
    found = heard(tmp_path / "out.mxf")
    assert len(found) == round(0.64 * RATE)
    assert not found.any()
