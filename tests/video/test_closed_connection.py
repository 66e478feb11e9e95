"""Receivers that go away: a server is missed, the reader of a pipe has seen enough."""

import os
import socket
import threading

import pytest
from support.clips import copy, noise_frame, write_clip

from nlens_video.core.errors import OutputError, ReaderGone


@pytest.fixture
def clip(tmp_path):
    made = [noise_frame(352, 288, "yuv420p", seed) for seed in range(40)]
    return write_clip(tmp_path / "in.mkv", made)


@pytest.mark.parametrize("taken", [0, 20000])
def test_server_that_closes_the_connection_is_an_error(clip, taken):
    with socket.create_server(("127.0.0.1", 0)) as server:

        def serve():
            connection, _ = server.accept()
            with connection:
                received = 0
                while received < taken:
                    received += len(connection.recv(4096))

        thread = threading.Thread(target=serve)
        thread.start()
        with pytest.raises(OutputError, match="the other side closed the connection") as caught:
            copy(clip, f"tcp://127.0.0.1:{server.getsockname()[1]}")
        thread.join()
    assert (caught.value.exit_code, "\n" in str(caught.value)) == (6, False)


def test_reader_of_a_named_pipe_that_leaves_is_no_error(clip, tmp_path):
    pipe = tmp_path / "out.nut"
    os.mkfifo(pipe)

    def read():
        with pipe.open("rb") as reader:
            reader.read(20000)

    thread = threading.Thread(target=read)
    thread.start()
    with pytest.raises(ReaderGone) as caught:
        copy(clip, pipe)
    thread.join()
    assert caught.value.exit_code == 0


def test_address_that_nobody_serves_is_told_and_not_the_disk(clip):
    with socket.create_server(("127.0.0.1", 0)) as closed:
        port = closed.getsockname()[1]
    with pytest.raises(OutputError, match="check the address and what listens there") as caught:
        copy(clip, f"tcp://127.0.0.1:{port}")
    assert not any(word in str(caught.value) for word in ("disk", "--codec", "\n"))
