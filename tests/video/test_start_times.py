"""Results begin where their container lets them, with sound and pictures in sync."""

from fractions import Fraction

import av
import numpy as np
import pytest
from support.clips import copy, copy_range, mux_sound, noise_frame, read_times

from nlens_video.video.input.source import open_source

RATE = 48000
BLOCK = 1920
"""Samples of sound for one picture [1]."""


def write_flash_and_beep(
    path, *, pictures_s=0, sound_s=0, codec="mp2", options=None, packet=0, pictures="mpeg4"
):  # fmt: skip
    """Two seconds: bright and loud from 1 s on; each stream begins at its time on that clock.

    Packets of sound have as many samples as the encoder likes, or as `packet` says.
    """
    with av.open(str(path), "w", container_options=options or {}) as out:
        video = out.add_stream(pictures, 25)
        video.width, video.height, video.pix_fmt = 64, 48, "yuv420p"
        sound = out.add_stream(codec, RATE, layout="mono")
        kind = sound.codec_context.codec.audio_formats[0].name
        resampler = av.AudioResampler(kind, "mono", RATE, packet or sound.frame_size or None)
        for index in range(50):
            moment = Fraction(index, 25)
            if moment >= pictures_s:
                frame = noise_frame(64, 48, "yuv420p", index)
                luma = np.full(frame.planes[0].buffer_size, 200 if moment >= 1 else 40, np.uint8)
                frame.planes[0].update(luma.tobytes())
                frame.pts, frame.time_base = index, Fraction(1, 25)
                out.mux(video.encode(frame))
            if moment >= sound_s:
                tone = np.sin(np.arange(BLOCK) * 0.06) * (16000 if moment >= 1 else 0)
                block = av.AudioFrame.from_ndarray(tone.astype(np.int16)[None], "s16", "mono")
                block.sample_rate, block.pts, block.time_base = (
                    RATE,
                    index * BLOCK,
                    Fraction(1, RATE),
                )
                mux_sound(out, sound, resampler, block)
        mux_sound(out, sound, resampler, None)
        out.mux([*video.encode(None), *sound.encode(None)])
    return path


def flash_and_beep(path):
    """Times at which pictures become bright and sound loud [s]."""
    with av.open(str(path)) as source:
        flash = next(frame.time for frame in source.decode(video=0)
                     if np.frombuffer(frame.planes[0], np.uint8)[:64].mean() > 120)  # fmt: skip
    with av.open(str(path)) as source:
        for frame in source.decode(audio=0):
            samples = frame.to_ndarray().astype(np.float64)
            full = 1 if frame.format.name[0] == "f" else 2 ** (8 * frame.format.bytes - 1)
            loud = np.abs(samples).max(axis=0) > 0.1 * full
            if loud.any():
                return flash, frame.time + loud.argmax() / RATE
    raise AssertionError("silent")


@pytest.mark.parametrize("ending", ["avi", "mxf"])
@pytest.mark.parametrize(
    ("name", "starts"),
    [
        ("in.ts", {"options": {"output_ts_offset": "1.4"}}),
        ("in.mkv", {"pictures_s": 0.6, "sound_s": 0.6}),
        ("in.mkv", {"sound_s": 0.6}),
        ("in.mkv", {"pictures_s": 0.6}),
        ("in.mov", {"sound_s": 0.6, "codec": "pcm_s16le"}),
    ],
)
def test_sound_stays_with_the_pictures_in_containers_without_start_times(
    tmp_path, name, starts, ending
):
    plate = write_flash_and_beep(tmp_path / name, **starts)
    out = tmp_path / f"out.{ending}"
    notes = copy(plate, out, codec="mpeg2video")
    flash, beep = flash_and_beep(out)
    assert beep == pytest.approx(flash, abs=0.05)
    late = starts.get("sound_s", 0) - starts.get("pictures_s", 0)
    assert any("silence is put before it" in note for note in notes) == (late > 0)
    cut = late < 0 and ending == "mxf"
    assert any("what comes before the pictures is left out" in note for note in notes) == cut


@pytest.mark.parametrize("ending", ["avi", "mxf"])
@pytest.mark.parametrize("first", [11, 12, 13, 14])
@pytest.mark.parametrize(
    ("name", "made", "within_s"),
    [
        ("in.mkv", {"codec": "flac"}, 0.002),
        ("in.mkv", {"codec": "pcm_s16le", "packet": 4800}, 0.002),
        ("in.mkv", {"codec": "pcm_s16le", "packet": 4800, "sound_s": 0.2}, 0.002),
        ("in.mkv", {"codec": "ac3"}, 0.04),
    ],
)
def test_sound_of_a_range_stays_with_the_pictures_where_containers_have_no_start_times(
    tmp_path, name, made, within_s, first, ending
):
    plate = write_flash_and_beep(tmp_path / name, **made)
    copy_range(plate, tmp_path / f"out.{ending}", first, 50)
    flash, beep = flash_and_beep(tmp_path / f"out.{ending}")
    assert flash == pytest.approx(1 - first / 25)
    assert beep == pytest.approx(flash, abs=within_s)


def test_late_pcm_stays_pcm_in_avi(tmp_path):
    plate = write_flash_and_beep(tmp_path / "in.mov", sound_s=0.6, codec="pcm_s16le")
    assert any("becomes pcm_s16le: silence" in note for note in copy(plate, tmp_path / "out.avi"))


def test_avi_begins_with_the_first_picture(tmp_path):
    """Encoders of sound give packets before 0, which must not push the pictures."""
    plate = write_flash_and_beep(tmp_path / "in.mkv", codec="aac")
    copy(plate, tmp_path / "out.avi", codec="libx264")
    with av.open(str(tmp_path / "out.avi")) as source:
        packets = [packet.dts for packet in source.demux(video=0) if packet.size]
    assert packets == list(range(50))


@pytest.mark.parametrize("ending", ["mp4", "mov", "mkv", "nut", "avi"])
def test_results_of_a_broadcast_begin_at_0(tmp_path, ending):
    """The clock of MPEG-TS may stand at hours."""
    plate = write_flash_and_beep(tmp_path / "in.ts", options={"output_ts_offset": "7200"})
    out = tmp_path / f"out.{ending}"
    notes = copy(plate, out)
    assert read_times(plate)[0] == 7200
    assert 0 <= read_times(out)[0] < 0.1
    flash, beep = flash_and_beep(out)
    assert beep == pytest.approx(flash, abs=0.05)
    assert any(note.startswith("times begin at 0: 7") for note in notes)


def test_mpeg_ts_keeps_the_clock_of_a_broadcast(tmp_path):
    plate = write_flash_and_beep(tmp_path / "in.ts", options={"output_ts_offset": "7200"})
    out = tmp_path / "out.ts"
    assert not any("times begin" in note for note in copy(plate, out))
    assert read_times(out) == read_times(plate)


@pytest.mark.parametrize("pictures", ["mpeg4", "libx264"])
@pytest.mark.parametrize("ending", ["mp4", "mov", "mkv", "ts", "avi"])
def test_pictures_before_0_in_matroska_keep_their_times_and_their_sound(tmp_path, ending, pictures):
    """FFmpeg gives no time stamps before 0 to H.264, whose pictures are in another order."""
    options = {"output_ts_offset": "-0.5", "avoid_negative_ts": "disabled"}
    plate, out = tmp_path / "in.mkv", tmp_path / f"out.{ending}"
    write_flash_and_beep(plate, options=options, pictures=pictures)
    with open_source(str(plate)) as source:
        frames = [(frame.pts, frame.time_s) for frame in source]
    assert frames == [(40 * index - 500, pytest.approx(index / 25)) for index in range(50)]
    notes = copy(plate, out)
    times = read_times(out)
    assert len(times) == 50 and 0 <= times[0] < 0.1
    assert [float(time - times[0]) for time in times] == pytest.approx(
        [index / 25 for index in range(50)], abs=0.001
    )
    flash, beep = flash_and_beep(out)
    assert beep == pytest.approx(flash, abs=0.05)
    assert "times begin at 0: the plate begins 0.5" in " ".join(notes)


def test_the_animation_begins_with_the_first_frame_of_a_broadcast(tmp_path):
    plate = write_flash_and_beep(tmp_path / "in.ts", options={"output_ts_offset": "7200"})
    with open_source(str(plate)) as source:
        times = [frame.time_s for frame in source]
    assert times == pytest.approx([index / 25 for index in range(50)])


@pytest.mark.parametrize("ending", ["mp4", "mov"])
@pytest.mark.parametrize("rate", [Fraction(24000, 1001), Fraction(30000, 1001), Fraction(24)])
def test_constant_rate_of_matroska_stays_constant_in_the_mp4_family(tmp_path, rate, ending):
    plate, out = tmp_path / "in.mkv", tmp_path / f"out.{ending}"
    write_steady(plate, rate, range(48))
    copy(plate, out, codec="libx264")
    assert read_times(out) == [index / rate for index in range(48)]
    with av.open(str(out)) as source:
        assert source.streams.video[0].average_rate == rate


def test_frames_off_the_constant_rate_keep_their_own_times_in_mp4(tmp_path):
    rate = Fraction(24000, 1001)
    off = [index + (0.3 if index in (10, 11) else 0) for index in range(48)]
    plate, out = tmp_path / "in.mkv", tmp_path / "out.mp4"
    write_steady(plate, rate, off)
    copy(plate, out, codec="libx264")
    times, plates = read_times(out), read_times(plate)
    assert times[10:12] == plates[10:12]
    assert times[9] == 9 / rate
    assert times[12:] == [index / rate for index in range(12, 48)]


def write_steady(path, rate, steps):
    """Pictures at multiples of a frame, which Matroska rounds to milliseconds."""
    with av.open(str(path), "w") as out:
        video = out.add_stream("mpeg4", rate, {"bf": "0"})
        video.width, video.height, video.pix_fmt = 64, 48, "yuv420p"
        video.time_base = video.codec_context.time_base = Fraction(1, 24000)
        for index, step in enumerate(steps):
            frame = noise_frame(64, 48, "yuv420p", index)
            frame.pts, frame.time_base = round(step / rate * 24000), Fraction(1, 24000)
            out.mux(video.encode(frame))
        out.mux(video.encode(None))
