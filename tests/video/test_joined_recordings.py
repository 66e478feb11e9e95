"""Recordings that are joined by `cat`: times begin anew within the file, at one place a stream."""

from fractions import Fraction
from itertools import pairwise

import av
import numpy as np
import pytest
from support.clips import copy, noise_frame

from nlens_video.video.input.passed_packets import PassedPackets
from nlens_video.video.input.repair import SourceClock
from nlens_video.video.input.source import open_source

RATE = 48000
SECONDS = 2


def write_part(path, *, loud, seconds=SECONDS, subtitle=False):
    """Dark and silent, or bright and loud."""
    with av.open(str(path), "w") as out:
        video = out.add_stream("libx264", 25, {"preset": "veryfast", "bf": "2"})
        video.width, video.height, video.pix_fmt = 64, 48, "yuv420p"
        sound = out.add_stream("aac", RATE, layout="mono")
        for index in range(round(25 * seconds)):
            frame = noise_frame(64, 48, "yuv420p", index)
            luma = np.full(frame.planes[0].buffer_size, 200 if loud else 40, np.uint8)
            frame.planes[0].update(luma.tobytes())
            frame.pts, frame.time_base = index, Fraction(1, 25)
            out.mux(video.encode(frame))
            tone = np.sin(np.arange(1920) * 0.06) * (0.5 if loud else 0.0)
            block = av.AudioFrame.from_ndarray(tone.astype(np.float32)[None], "fltp", "mono")
            block.sample_rate, block.pts, block.time_base = RATE, index * 1920, Fraction(1, RATE)
            out.mux(sound.encode(block))
        out.mux([*video.encode(None), *sound.encode(None)])
    return path


def joined(folder, *parts):
    path = folder / "joined.ts"
    path.write_bytes(b"".join(part.read_bytes() for part in parts))
    return path


def brightness(path):
    """Time of each frame [s], and the mean of its luma with the padding of its rows."""
    with av.open(str(path)) as source:
        return [(frame.time, np.frombuffer(frame.planes[0], np.uint8).mean())
                for frame in source.decode(video=0)]  # fmt: skip


def loudness(path):
    """Time of each frame of sound [s], its length [s] and its root mean square."""
    with av.open(str(path)) as source:
        return [(frame.time, frame.samples / RATE, float(np.sqrt((frame.to_ndarray() ** 2).mean())))
                for frame in source.decode(audio=0)]  # fmt: skip


@pytest.mark.parametrize("ending", ["mp4", "mkv", "ts"])
@pytest.mark.parametrize("lengths", [(2, 2), (2, 5), (5, 2), (0.6, 3)])
def test_sound_of_joined_recordings_is_whole_and_stays_with_the_pictures(tmp_path, ending, lengths):
    parts = [
        write_part(tmp_path / f"{loud}.ts", loud=bool(loud), seconds=seconds)
        for loud, seconds in enumerate(lengths)
    ]
    out = tmp_path / f"out.{ending}"
    notes = copy(joined(tmp_path, *parts), out)
    assert not any("damaged" in note for note in notes)
    with open_source(str(tmp_path / "joined.ts")) as source:
        assert len(list(source)) == 25 * sum(lengths)
        assert not source.damaged
    seen, heard = brightness(out), loudness(out)
    assert len(seen) == 25 * sum(lengths)
    steps = [later - moment for (moment, _), (later, _) in pairwise(seen)]
    assert min(steps) > 0.03
    assert sum(length for _, length, _ in heard) == pytest.approx(sum(lengths), abs=0.1)
    bright = next(moment for moment, luma in seen if luma > 60)
    loud = next(moment for moment, _, level in heard if level > 0.1)
    assert loud == pytest.approx(bright, abs=0.06)
    ends = [moment + length for moment, length, _ in heard]
    gaps = [begin - end for (begin, _, _), end in zip(heard[1:], ends, strict=False)]
    assert max(map(abs, gaps)) < 0.045


def test_three_joined_recordings_stay_in_sync(tmp_path):
    dark = write_part(tmp_path / "dark.ts", loud=False)
    bright = write_part(tmp_path / "bright.ts", loud=True)
    copy(joined(tmp_path, dark, dark, bright), tmp_path / "out.mkv")
    seen, heard = brightness(tmp_path / "out.mkv"), loudness(tmp_path / "out.mkv")
    assert len(seen) == 25 * 3 * SECONDS
    begin = next(moment for moment, luma in seen if luma > 60)
    assert begin - seen[0][0] == pytest.approx(2 * SECONDS, abs=0.05)
    assert next(at for at, _, level in heard if level > 0.1) == pytest.approx(begin, abs=0.06)


def test_packets_before_a_step_back_keep_their_times(tmp_path):
    dark, bright = (write_part(tmp_path / f"{on}.ts", loud=on) for on in (False, True))
    with av.open(str(dark)) as source:
        alone = [packet.pts for packet in source.demux(audio=0) if packet.dts is not None]
    passed = []
    with open_source(str(joined(tmp_path, dark, bright))) as source:
        source.packet_sink = lambda packet: passed.append(packet.pts)
        for _ in source:
            pass
    assert passed[: len(alone)] == alone
    assert passed == sorted(passed)
    assert len(passed) == pytest.approx(2 * len(alone), abs=4)


@pytest.mark.parametrize("wrong_s", [-2, 3600])
def test_one_wrong_time_stamp_of_the_pictures_leaves_the_sound_where_it_is(tmp_path, wrong_s):
    clip = write_part(tmp_path / "in.mkv", loud=True, seconds=8)
    with open_source(str(clip)) as source:
        clock = SourceClock(source.info)
    packets, given, passed, seen = PassedPackets(), [], [], 0
    with av.open(str(clip)) as container:
        for packet in container.demux():
            if packet.dts is None:
                continue
            if packet.stream.type == "audio":
                given.append(packet.dts)
                packets.add(packet)
            else:
                seen += 1
                packet.dts += int(wrong_s / packet.time_base) if seen == 80 else 0
                packets.see(packet)
                clock.tick(packet.dts)
            passed += [one.dts for one in packets.due(clock)]
    assert len(given) - len(passed) < 150  # of 64 frames
    passed += [one.dts for one in packets.due(clock, ended=True)]
    assert passed == given
