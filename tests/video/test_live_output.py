"""Pictures of a stream come out in time, whatever becomes of its sound: through named pipes."""

import os
import threading
import time

import av
import pytest
from support.clips import copy, noise_frame, write_clip

from nlens_video.video.input.source import open_source
from nlens_video.video.output.sink import open_sink

FRAMES, RATE = 200, 25
SIZE = 32 * 32 * 3 // 2  # of a picture [bytes]


@pytest.fixture(scope="module")
def clip(tmp_path_factory):
    """Pictures of eight seconds, sound of less than half a second."""
    frames = [noise_frame(32, 32, "yuv420p", seed) for seed in range(FRAMES)]
    return write_clip(tmp_path_factory.mktemp("clip") / "in.mkv", frames, audio=True)


def test_pictures_do_not_wait_for_sound_that_has_ended(clip, tmp_path):
    pipe, got = tmp_path / "out.nut", []
    os.mkfifo(pipe)

    def read():
        with pipe.open("rb", buffering=0) as reader:
            while part := reader.read(1 << 16):
                got.append(len(part))

    reader = threading.Thread(target=read, daemon=True)
    reader.start()
    with open_source(str(clip)) as source, open_sink(str(pipe), source.info) as sink:
        source.packet_sink = sink.write_packet
        for frame in source:
            sink.write(frame)
        held, end = FRAMES, time.monotonic() + 10
        while held > 0.3 * RATE and time.monotonic() < end:
            time.sleep(0.05)
            held = FRAMES - sum(got) // SIZE
        sink.commit()
    reader.join(20)
    assert held <= 0.3 * RATE


def test_sound_waits_for_pictures_that_an_encoder_holds(clip, tmp_path):
    pipe, got = tmp_path / "out.mkv", []
    os.mkfifo(pipe)
    reader = threading.Thread(target=lambda: got.append(pipe.read_bytes()), daemon=True)
    reader.start()
    copy(clip, pipe, codec="libx264")
    reader.join(20)
    (tmp_path / "got.mkv").write_bytes(got[0])
    with av.open(str(tmp_path / "got.mkv")) as result:
        times = [
            (packet.stream.type, packet.dts * packet.time_base)
            for packet in result.demux()
            if packet.dts is not None
        ]
    for number, (kind, moment) in enumerate(times):
        later = [time for other, time in times[number:] if other == "video"]
        if kind == "audio" and later:
            assert moment - min(later) < 0.1
