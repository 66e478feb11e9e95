"""Connections that fall silent or break: said as what they are, and not as damage."""

import contextlib
import socket
import struct
import threading

import pytest
from support import shots
from support.clips import noise_frame, write_clip

from nlens_video.cli.main import main
from nlens_video.core.errors import InputError
from nlens_video.video.input.source import open_source

FRAMES = 12


@pytest.fixture(scope="module")
def clip(tmp_path_factory):
    frames = [noise_frame(32, 24, "yuv420p", seed) for seed in range(FRAMES)]
    return write_clip(tmp_path_factory.mktemp("clip") / "in.mkv", frames).read_bytes()


@contextlib.contextmanager
def server(answer, *, breaks=False):
    """Sends what it has to whoever calls, then falls silent, or breaks the line when told "go"."""
    with socket.create_server(("127.0.0.1", 0)) as listening:

        def serve():
            line, _ = listening.accept()
            with line:
                line.sendall(answer)
                if breaks:
                    go.wait(20)
                    line.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
                    return
                with contextlib.suppress(ConnectionResetError):  # it closes before it has read all
                    while line.recv(1024):
                        pass

        go = threading.Event()
        thread = threading.Thread(target=serve, daemon=True)
        thread.start()
        yield f"tcp://127.0.0.1:{listening.getsockname()[1]}", go
        thread.join(20)
        assert not thread.is_alive()


def free_udp_port():
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        return probe.getsockname()[1]


def test_source_that_falls_silent_ends_without_damage(clip):
    with server(clip) as (url, _), open_source(f"{url}?timeout=300000") as plate:
        assert len(list(plate)) == FRAMES
        assert plate.damaged == 0
        (note,) = plate.warnings()
        assert note.startswith("the source ended: nothing arrived for 0.")


def test_connection_that_breaks_ends_the_source_without_damage(clip):
    with server(clip, breaks=True) as (url, go), open_source(url) as plate:
        frames = iter(plate)
        next(frames)
        go.set()
        assert 1 + len(list(frames)) == FRAMES  # all had arrived
        assert plate.damaged == 0
        reset = "the source ended: the connection failed (Connection reset by peer)"
        assert plate.warnings() == (reset,)


def test_source_that_falls_silent_before_its_first_frame_is_not_called_damaged(clip):
    header = clip[: clip.index(b"\x1f\x43\xb6\x75")]  # up to Matroska's first cluster
    with server(header) as (url, _):
        with pytest.raises(InputError, match="no frame came: nothing arrived for") as caught:
            open_source(f"{url}?timeout=300000")
    assert "damaged" not in str(caught.value)


@pytest.mark.parametrize("words", [(), ("--input-format", "h264")], ids=["probed", "given"])
def test_address_on_which_nothing_arrives_is_refused_in_one_line(words, tmp_path, capsys):
    shots.cube_glb(tmp_path / "cube.glb")
    url = f"udp://127.0.0.1:{free_udp_port()}?timeout=600000"
    assert main([url, str(tmp_path / "cube.glb"), str(tmp_path / "out.mkv"), *words]) == 3
    said = capsys.readouterr().err
    assert said.startswith(f"nlens-video: {url}: no frame came: nothing arrived for")
    assert "check the address and what sends there, or raise its timeout" in said
    assert said.count("\n") == 1


def test_address_without_a_server_is_refused_as_a_failed_connection():
    with socket.create_server(("127.0.0.1", 0)) as closed:
        url = f"tcp://127.0.0.1:{closed.getsockname()[1]}"
    with pytest.raises(InputError, match=r"the connection failed \(Connection refused\)"):
        open_source(url)
