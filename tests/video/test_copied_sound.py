"""Packets of sound that are copied: those that are shown, all of them, in sync."""

import os
import subprocess
import sys
from fractions import Fraction

import av
import numpy as np
import pytest
from support.clips import copy, noise_frame, read_packets

RATE = 48000
BLOCK = 1024
LATE = """
import sys
from nlens_video.video.input.source import open_source
from nlens_video.video.output.sink import open_sink

packets = []
source = open_source(sys.argv[1])
source.packet_sink = packets.append
with open_sink(sys.argv[2], source.info) as sink:
    frames = list(source)
    source.close()
    for packet in packets:
        sink.write_packet(packet)
    for frame in frames:
        sink.write(frame)
    sink.commit()
"""


def write_plate(path, codec="aac", *, seconds=3):
    """A clip of 25 pictures a second, with one key frame, and noise as its sound."""
    with av.open(str(path), "w") as out:
        video = out.add_stream("libx264", 25, {"g": "1000", "bf": "0"})
        video.width, video.height, video.pix_fmt = 32, 24, "yuv420p"
        sound = out.add_stream(codec, RATE, layout="mono")
        size = BLOCK if codec == "aac" else 1536
        noise = np.random.default_rng(1).standard_normal(seconds * RATE) * 0.1
        for index in range(25 * seconds):
            frame = noise_frame(32, 24, "yuv420p", index)
            frame.pts, frame.time_base = index, Fraction(1, 25)
            out.mux(video.encode(frame))
        for start in range(0, len(noise) - size + 1, size):
            block = av.AudioFrame.from_ndarray(
                noise[None, start : start + size].astype(np.float32), "fltp", "mono"
            )
            block.sample_rate, block.pts, block.time_base = RATE, start, Fraction(1, RATE)
            out.mux(sound.encode(block))
        out.mux([*video.encode(None), *sound.encode(None)])
    return path


def remade(plate, target, retime):
    """A copy of a plate's packets, with other times of the sound's; `retime` takes their number."""
    with av.open(str(plate)) as given, av.open(str(target), "w") as made:
        streams = {one.index: made.add_stream_from_template(one) for one in given.streams}
        number = 0
        for packet in given.demux():
            if packet.dts is None:
                continue
            kind = packet.stream.type
            packet.stream = streams[packet.stream.index]
            retime(packet, kind, number)
            number += kind == "audio"
            made.mux(packet)
    return target


def trimmed(plate, target, cut_s):
    """A copy whose edit list hides the beginning, as a trim without encoding makes it."""

    def earlier(packet, _kind, _number):
        ticks = round(cut_s / packet.time_base)
        packet.pts, packet.dts = packet.pts - ticks, packet.dts - ticks

    return remade(plate, target, earlier)


def samples(path):
    """The sound of a file, and the time of its first sample by that of the first picture [s]."""
    with av.open(str(path)) as source:
        blocks = list(source.decode(audio=0))
    with av.open(str(path)) as source:
        # FFmpeg takes H.264 in AVI, which has decoding times only, to be reordered
        pictures = 0.0 if path.suffix == ".avi" else next(source.decode(video=0)).time
    return np.concatenate([one.to_ndarray()[0] for one in blocks]), blocks[0].time - pictures


def late_s(path, plate):
    """By how much the sound of a file comes later beside the pictures than the plate's [s]."""
    (found, first), (told, expected) = samples(path), samples(plate)
    piece = told[RATE // 2 : RATE]
    place = np.correlate(found, piece, "valid").argmax()
    return first + place / RATE - (expected + 0.5)


@pytest.mark.parametrize(
    ("name", "most_s"), [("out.mkv", 0.002), ("out.ts", 0.002), ("out.nut", 0.002),
                         ("out.avi", 0.022), ("out.mp4", 0.002), ("out.webm", 0.01)],
)  # fmt: skip
def test_sound_that_a_trim_has_cut_away_does_not_come_back(tmp_path, name, most_s):
    whole = write_plate(tmp_path / "whole.mp4")
    plate = trimmed(whole, tmp_path / "in.mp4", 1)
    notes = copy(plate, tmp_path / name)
    assert not any("damaged" in note for note in notes)
    assert late_s(tmp_path / name, plate) == pytest.approx(0.0, abs=most_s)
    assert samples(tmp_path / name)[1] >= -2 * BLOCK / RATE


@pytest.mark.parametrize("name", ["out.mp4", "out.mpg", "out.mkv", "out.ts"])
def test_sound_at_the_time_of_the_packet_before_is_kept(tmp_path, name):
    whole = write_plate(tmp_path / "whole.mkv", "ac3")
    times = []

    def doubled(packet, kind, number):
        if kind == "audio":
            times.append(packet.dts)
            packet.dts = packet.pts = times[19 if number in (20, 21) else number]

    plate = remade(whole, tmp_path / "in.mkv", doubled)
    notes = copy(plate, tmp_path / name)
    assert not any("damaged" in note for note in notes)
    assert read_packets(tmp_path / name) == read_packets(plate)


def test_packets_outlive_the_source_that_they_were_read_from(tmp_path):
    """A lost connection is closed while its last packets wait to be written."""
    write_plate(tmp_path / "in.mkv")
    script = tmp_path / "late.py"
    script.write_text(LATE)
    command = [sys.executable, script, tmp_path / "in.mkv", tmp_path / "out.mkv"]
    # freed memory is overwritten at once, not by chance
    subprocess.run(command, check=True, env={**os.environ, "MALLOC_PERTURB_": "165"})
    assert read_packets(tmp_path / "out.mkv") == read_packets(tmp_path / "in.mkv")
