"""A plate from standard input is read as it comes, through a real pipe."""

import io
import os
import queue
import sys
import threading
import time

import av
import pytest
from support.clips import noise_frame

from nlens_video.video.input.source import open_source

FRAMES = 96
HELD = 48
"""Frames by which decoding is behind at the most: probing, and a decoder's threads [1]."""


@pytest.fixture
def pipe(monkeypatch):
    """The writing end of a pipe that is standard input."""
    reading, writing = os.pipe()
    with os.fdopen(reading) as stdin, os.fdopen(writing, "wb", buffering=0) as pipe:
        monkeypatch.setattr("sys.stdin", stdin)
        yield pipe


@pytest.fixture
def came(pipe):
    """The numbers of the frames that are read from standard input, as they come; last None."""
    numbers = queue.Queue()

    def read():
        with open_source("-") as plate:
            for frame in plate:
                numbers.put(frame.index)
        numbers.put(None)

    reader = threading.Thread(target=read, daemon=True)
    reader.start()
    yield numbers
    pipe.close()
    reader.join(20)
    assert not reader.is_alive()


@pytest.fixture(scope="module")
def packets():
    """The bytes of each packet of a stream, the header with the first; 3 kB in all."""
    made, parts, written = io.BytesIO(), [], 0
    picture = noise_frame(32, 32, "yuv420p")
    with av.open(made, "w", format="nut", options={"flush_packets": "1"}) as out:
        stream = out.add_stream("mpeg4", rate=25)
        stream.width, stream.height, stream.pix_fmt = 32, 32, "yuv420p"
        for number in range(FRAMES):
            picture.pts = number
            out.mux(stream.encode(picture))
            parts.append(made.getvalue()[written:])
            written = len(made.getvalue())
    return parts


def test_frames_of_a_live_stream_come_before_its_later_packets_are_there(packets, pipe, came):
    pipe.write(b"".join(packets[:HELD]))
    for number in range(HELD, FRAMES):
        pipe.write(packets[number])
        assert came.get(timeout=20) == number - HELD


def test_pipe_that_another_program_made_non_blocking_is_waited_for(packets, pipe, came):
    os.set_blocking(sys.stdin.fileno(), False)
    pipe.write(b"".join(packets[:HELD]))
    assert came.get(timeout=20) == 0
    time.sleep(0.2)  # nothing is there
    pipe.write(b"".join(packets[HELD:]))
    pipe.close()
    assert [came.get(timeout=20) for _ in range(FRAMES)] == [*range(1, FRAMES), None]
