"""Sound that is encoded anew stays with the pictures."""

from fractions import Fraction

import av
import numpy as np
import pytest
from support.clips import copy, noise_frame, read_packets, write_clip

RATE = 48000
FLAC_SAMPLES = 4608
"""Of a packet by FFmpeg's encoder."""


def write_sound(path, blocks, *, codec="pcm_s16le"):
    """A clip whose sound is a tone in blocks of 20 ms at the given moments [ms]."""
    with av.open(str(path), "w") as out:
        video = out.add_stream("ffv1", 25)
        video.width, video.height, video.pix_fmt = 32, 24, "yuv420p"
        sound = out.add_stream(codec, RATE, layout="stereo")
        for index in range(50):
            frame = noise_frame(32, 24, "yuv420p", index)
            frame.pts, frame.time_base = index, Fraction(1, 25)
            out.mux(video.encode(frame))
        for moment in blocks:
            start = moment * RATE // 1000
            tone = np.sin(np.arange(start, start + 960) * 0.05) * 8000
            block = av.AudioFrame.from_ndarray(
                np.repeat(tone.astype(np.int16), 2)[None], "s16", "stereo"
            )
            block.sample_rate, block.pts, block.time_base = RATE, start, Fraction(1, RATE)
            out.mux(sound.encode(block))
        out.mux(sound.encode(None))
        out.mux(video.encode(None))
    return path


def loudness(path):
    """Start [s] and root mean square of every 20 ms of a file's sound, from its first sample."""
    with av.open(str(path)) as source:
        frames = list(source.decode(audio=0))
    samples = np.concatenate([frame.to_ndarray()[0].astype(np.float64) for frame in frames])
    whole = samples[: len(samples) // 960 * 960].reshape(-1, 960)
    return frames[0].time, np.sqrt((whole**2).mean(axis=1))


@pytest.mark.parametrize("start", [0, 300])
@pytest.mark.parametrize("name", ["out.mp4", "out.webm"])
def test_audio_of_matroska_is_reencoded_without_a_discontinuity(tmp_path, name, start):
    clip = write_sound(tmp_path / "in.mkv", range(start, start + 1000, 20))
    notes = copy(clip, tmp_path / name, codec="libx264" if name.endswith("4") else "libvpx-vp9")
    assert any("(audio) becomes" in note for note in notes)
    first, rms = loudness(tmp_path / name)
    assert first == pytest.approx(start / 1000, abs=0.025)
    assert (rms[2:48] > 0.1).all()
    assert len(rms) == pytest.approx(50, abs=2)


def test_gap_in_the_audio_becomes_silence(tmp_path):
    heard = [*range(0, 400, 20), *range(1000, 1400, 20)]
    clip = write_sound(tmp_path / "in.mkv", heard)
    copy(clip, tmp_path / "out.webm", codec="libvpx-vp9")
    first, rms = loudness(tmp_path / "out.webm")
    assert first == pytest.approx(0.0, abs=0.025)
    assert len(rms) == pytest.approx(70, abs=2)
    assert (rms[2:18] > 0.1).all()
    assert (rms[24:47] < 0.01).all()
    assert (rms[53:67] > 0.1).all()


def test_overlapping_audio_packets_do_not_delay_the_rest(tmp_path):
    twice = [*range(0, 400, 20), *range(400, 500, 5), *range(500, 1000, 20)]
    clip = write_sound(tmp_path / "in.mkv", twice)
    copy(clip, tmp_path / "out.webm", codec="libvpx-vp9")
    assert len(loudness(tmp_path / "out.webm")[1]) == pytest.approx(50, abs=2)


def write_flac(path, *, overlap=0, damaged=()):
    """A clip whose sound counts its samples, modulo 30000, in twenty FLAC packets of 96 ms.

    From the middle on it comes `overlap` samples too early and repeats as many, as where two
    recordings of the same sound are joined. Packets of the given numbers hold zeros only.
    """
    with av.open(str(path), "w") as out:
        video = out.add_stream("ffv1", 25)
        video.width, video.height, video.pix_fmt = 32, 24, "yuv420p"
        sound = out.add_stream("flac", RATE, layout="mono")
        sound.codec_context.format = "s16"
        early = np.where(np.arange(20) < 10, 0, overlap)
        packets = []
        for number in range(20):
            first = number * FLAC_SAMPLES - early[number]
            count = np.arange(first, first + FLAC_SAMPLES) % 30000
            block = av.AudioFrame.from_ndarray(count.astype(np.int16)[None], "s16", "mono")
            block.sample_rate, block.pts = RATE, number * FLAC_SAMPLES
            packets += sound.encode(block)
        packets += sound.encode(None)
        for number, packet in enumerate(packets[:20]):
            made = av.Packet(bytes(packet.size) if number in damaged else bytes(packet))
            made.pts = made.dts = int(number * FLAC_SAMPLES - early[number])
            made.time_base, made.stream = Fraction(1, RATE), sound
            out.mux(made)
        for index in range(50):
            frame = noise_frame(32, 24, "yuv420p", index)
            frame.pts, frame.time_base = index, Fraction(1, 25)
            out.mux(video.encode(frame))
        out.mux(video.encode(None))
    return path


def heard(path):
    """All samples of a file's sound, one channel."""
    with av.open(str(path)) as source:
        return np.concatenate([frame.to_ndarray()[0] for frame in source.decode(audio=0)])


@pytest.mark.parametrize("overlap_ms", [50, 90])
def test_samples_of_a_block_that_overlap_earlier_ones_are_dropped(tmp_path, overlap_ms):
    overlap = overlap_ms * RATE // 1000
    copy(write_flac(tmp_path / "in.mkv", overlap=overlap), tmp_path / "out.avi")
    expected = np.arange(20 * FLAC_SAMPLES - overlap) % 30000
    np.testing.assert_array_equal(heard(tmp_path / "out.avi"), expected)


def test_damaged_sound_that_is_reencoded_is_counted_and_silent(tmp_path):
    notes = copy(write_flac(tmp_path / "in.mkv", damaged=(8, 9)), tmp_path / "out.avi")
    assert "2 damaged packets of sound or other streams were left out" in notes
    expected = np.arange(20 * FLAC_SAMPLES) % 30000
    expected[8 * FLAC_SAMPLES : 10 * FLAC_SAMPLES] = 0
    np.testing.assert_array_equal(heard(tmp_path / "out.avi"), expected)


def test_whole_sound_that_is_reencoded_is_not_called_damaged(tmp_path):
    notes = copy(write_flac(tmp_path / "in.mkv"), tmp_path / "out.avi")
    assert not any("damaged" in note for note in notes)


def test_audio_without_a_channel_layout_is_reencoded_for_mp4(tmp_path):
    clip = write_sound(tmp_path / "in.mkv", range(0, 1000, 20))
    with av.open(str(clip)) as source:
        assert source.streams.audio[0].codec_context.layout.name == "2 channels"
    notes = copy(clip, tmp_path / "out.mp4", codec="libx264")
    assert "stream 1 (audio) becomes aac: mp4 does not hold its codec" in notes


def write_channels(path, layout, codec="flac", *, pause_s=0):
    """A clip with a tone of its own loudness in each channel, 0.05 for the first, then 0.05 more.

    It is so low that the channel of effects keeps it. With a pause it comes twice.
    """
    count = av.AudioLayout(layout).nb_channels
    with av.open(str(path), "w") as out:
        video = out.add_stream("libx264", 25)
        video.width, video.height, video.pix_fmt = 32, 24, "yuv420p"
        sound = out.add_stream(codec, RATE, layout=layout)
        kind = sound.codec_context.codec.audio_formats[0].name
        sound.codec_context.format = kind
        for index in range(25):
            frame = noise_frame(32, 24, "yuv420p", index)
            frame.pts, frame.time_base = index, Fraction(1, 25)
            out.mux(video.encode(frame))
        tone = np.sin(np.arange(RATE) * 2 * np.pi * 60 / RATE)
        samples = tone[:, None] * 0.05 * (1 + np.arange(count))
        packed = np.ascontiguousarray(samples, np.float32).reshape(1, -1)
        for start in (0, int(RATE * (1 + pause_s)))[: 2 if pause_s else 1]:
            block = av.AudioFrame.from_ndarray(packed, "flt", layout)
            block.sample_rate, block.pts, block.time_base = RATE, start, Fraction(1, RATE)
            resampler = av.AudioResampler(kind, layout, RATE, sound.frame_size or 1152)
            for part in (*resampler.resample(block), *resampler.resample(None)):
                out.mux(sound.encode(part))
        out.mux([*sound.encode(None), *video.encode(None)])
    return path


def channels(path):
    """Layout of a file's sound, and its samples (channel, n)."""
    with av.open(str(path)) as source:
        layout = source.streams.audio[0].codec_context.layout
        packed = av.AudioResampler("flt", layout, RATE)
        parts = [part for frame in source.decode(audio=0) for part in packed.resample(frame)]
    flat = np.concatenate([part.to_ndarray()[0] for part in parts])
    return layout.name, flat.reshape(-1, layout.nb_channels).T.astype(np.float64)


def peaks(samples):
    return np.sqrt(2.0 * (samples**2).mean(axis=1))


@pytest.mark.parametrize(
    ("layout", "codec", "becomes"),
    [
        ("5.1(side)", "ac3", "5.1"), ("5.1(side)", "eac3", "5.1"), ("5.1(side)", "flac", "5.1"),
        ("5.0(side)", "ac3", "5.0"), ("quad(side)", "flac", "quad"), ("5.1", "flac", "5.1"),
        ("6.1", "flac", "6.1"), ("7.1", "flac", "7.1"),
    ],
)  # fmt: skip
def test_each_channel_of_surround_sound_stays_itself_in_webm(tmp_path, layout, codec, becomes):
    clip = write_channels(tmp_path / "in.mkv", layout, codec)
    assert channels(clip)[0] == layout
    notes = copy(clip, tmp_path / "out.webm")
    assert "stream 1 (audio) becomes libopus: webm does not hold its codec" in notes
    name, samples = channels(tmp_path / "out.webm")
    assert name == becomes
    loud = peaks(samples[:, RATE // 5 : RATE // 2])
    np.testing.assert_allclose(loud, 0.05 * (1 + np.arange(len(loud))), rtol=0.1)


def test_gap_in_sound_of_eight_channels_becomes_silence(tmp_path):
    clip = write_channels(tmp_path / "in.mkv", "7.1", "pcm_s16le", pause_s=1)
    notes = copy(clip, tmp_path / "out.mp4")
    assert "stream 1 (audio) becomes aac: mp4 does not hold its codec" in notes
    _, samples = channels(tmp_path / "out.mp4")
    assert samples.shape[1] == pytest.approx(3 * RATE, abs=2000)
    assert peaks(samples[:, RATE * 6 // 5 : RATE * 9 // 5]).max() < 0.001
    assert peaks(samples[:, RATE * 11 // 5 : RATE * 14 // 5]).min() > 0.04


def test_sound_that_loses_channels_is_noted(tmp_path):
    clip = write_channels(tmp_path / "in.mkv", "2.1")
    notes = " ".join(copy(clip, tmp_path / "out.webm"))
    assert "becomes libopus: webm does not hold its codec; 3 channels become 2" in notes


@pytest.mark.parametrize("name", ["out.mp4", "out.m4v", "out.mov"])
def test_ac3_audio_is_copied_byte_for_byte(tmp_path, name):
    clip = write_clip(tmp_path / "in.mkv", [noise_frame(32, 24, "yuv420p")], audio="ac3")
    assert len(read_packets(clip)) > 5
    copy(clip, tmp_path / name, codec="libx264")
    assert read_packets(tmp_path / name) == read_packets(clip)


def test_audio_of_another_length_than_the_video_stays_in_sync(tmp_path):
    made = [noise_frame(32, 24, "yuv420p", seed) for seed in range(10)]
    clip = write_clip(tmp_path / "in.mkv", made, audio=True, time_base=Fraction(1, 1000),
                      pts=range(0, 400, 40))  # fmt: skip
    copy(clip, tmp_path / "out.webm")
    with av.open(str(tmp_path / "out.webm")) as out:
        assert sum(frame.samples for frame in out.decode(audio=0)) == pytest.approx(20480, abs=960)
