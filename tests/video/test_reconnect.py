"""A lost source is opened again: through a real server that drops its line in the middle."""

import contextlib
import socket
import threading
import time
from contextlib import ExitStack
from fractions import Fraction
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from support import shots

from nlens_video.cli.main import main
from nlens_video.core.settings import SourceSettings
from nlens_video.run.plate_source import opened
from nlens_video.video.input.reconnect import Arrivals, Reconnecting
from nlens_video.video.input.source import open_source


@pytest.fixture(scope="module")
def clips(tmp_path_factory):
    folder = tmp_path_factory.mktemp("clips")
    shots.write_video(folder / "whole.mkv", frames=12)
    shots.write_video(folder / "wide.mkv", frames=4, rgb=shots.plate()[:, :320])
    return folder


class Server:
    """Gives each caller the next of its answers, then hangs up; later ones are not let in."""

    def __init__(self, *answers: bytes) -> None:
        self._socket = socket.create_server(("127.0.0.1", 0))
        self.url = f"tcp://127.0.0.1:{self._socket.getsockname()[1]}"
        self._thread = threading.Thread(target=self._serve, args=(answers,), daemon=True)
        self._thread.start()

    def _serve(self, answers) -> None:
        for answer in answers:
            line, _ = self._socket.accept()
            with line:
                line.sendall(answer)
                line.shutdown(socket.SHUT_WR)
                with contextlib.suppress(ConnectionResetError):  # it closes before it has read all
                    while line.recv(1024):
                        pass
        self._socket.close()

    def __enter__(self):
        return self

    def __exit__(self, *_):
        self._thread.join(10)
        self._socket.close()
        assert not self._thread.is_alive()


@pytest.mark.slow
def test_video_and_audio_resume_after_a_lost_connection_with_the_gap_in_time(clips):
    whole = (clips / "whole.mkv").read_bytes()
    packets = []
    with Server(whole, whole) as server, ExitStack() as stack:
        source = Reconnecting(partial(open_source, server.url), 1.0)
        stack.enter_context(source)
        source.packet_sink = lambda packet: packets.append(
            (packet.stream.index, packet.dts * packet.time_base)
        )
        frames = [(f.index, f.pts * f.time_base, f.time_s, f.picture.srgb()) for f in source]
    assert source.lost == 1
    assert [index for index, *_ in frames] == list(range(24))
    times = [moment for _, moment, *_ in frames]
    assert all(later > earlier for earlier, later in zip(times, times[1:], strict=False))
    assert times[12] - times[0] >= Fraction(1, 2)  # how long it took to look for it again
    assert frames[-1][2] == pytest.approx(float(times[-1] - times[0]), abs=1e-3)
    assert np.array_equal(frames[0][3], frames[12][3])
    sound = [moment for _, moment in packets]
    assert sound == sorted(sound) and sound[-1] > times[12]
    # sound begins 21 ms before its pictures, and a gap may be shorter than the two together
    assert sum(moment < times[12] - Fraction(1, 40) for moment in sound) == len(sound) // 2


@pytest.mark.parametrize("opening_s", [0.0, 0.8])
@pytest.mark.parametrize("timeout_s", [0.0, 1.0])
def test_gap_is_as_long_as_no_frame_was_sent(opening_s, timeout_s):
    """FFmpeg holds the first frames until it knows the streams, the last until a timeout."""
    step, begins, again = 0.04, 100.0, 108.0  # when the first frames are sent, by the clock [s]
    arrivals = Arrivals(begins + opening_s, Fraction(7))
    for number in range(100):
        sent = begins + step * number
        held = timeout_s if number > 97 else 0.0
        came = max(begins + opening_s, sent + held)
        arrivals.see(Fraction(7) + number * Fraction(1, 25), came)
    assert arrivals.following(again + opening_s) == pytest.approx(7 + again - begins)


def test_clock_of_a_source_that_drifts_does_not_change_the_length_of_a_gap():
    arrivals = Arrivals(0.0, Fraction(0))
    hour = 25 * 3600
    for number in range(1, hour):
        arrivals.see(Fraction(number, 25), number * 0.04 * 1.0005)  # 1.8 s an hour slow
    last, came = (hour - 1) / 25, (hour - 1) * 0.04 * 1.0005
    assert arrivals.following(came + 3.0) - last == pytest.approx(3.0, abs=0.02)


@pytest.mark.slow
def test_source_that_does_not_return_ends_the_stream(clips):
    whole = (clips / "whole.mkv").read_bytes()
    with Server(whole) as server, Reconnecting(partial(open_source, server.url), 0.6) as source:
        assert len(list(source)) == 12
        assert source.lost == 0


def test_source_whose_opening_blocks_is_given_up_in_time(clips):
    """A listener waits for a caller who does not come."""
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    sender = threading.Thread(target=_send, args=(port, clips / "whole.mkv"), daemon=True)
    sender.start()
    url = f"tcp://127.0.0.1:{port}?listen=1"
    ended = []

    def read() -> None:
        with Reconnecting(partial(open_source, url), 1.0) as source:
            ended.append(len(list(source)))

    reader = threading.Thread(target=read, daemon=True)
    reader.start()
    reader.join(10)
    assert ended == [12]


def _send(port: int, path: Path) -> None:
    """Send a file as soon as somebody listens."""
    for _ in range(100):
        with contextlib.suppress(ConnectionRefusedError):
            with socket.create_connection(("127.0.0.1", port)) as line:
                line.sendall(path.read_bytes())
                return
        time.sleep(0.05)


def test_source_that_returns_in_another_size_goes_on_in_that_of_the_first_with_a_note(clips):
    answers = [(clips / name).read_bytes() for name in ("whole.mkv", "wide.mkv")]
    with Server(*answers) as server, Reconnecting(partial(open_source, server.url), 1.0) as source:
        shapes = [frame.picture.srgb().shape for frame in source]
        (note,) = (one for one in source.warnings() if "another form" in one)
    assert shapes == 16 * [(shots.HEIGHT, shots.WIDTH, 3)]
    assert f"4 frames had another form (from frame 12 on, 320x{shots.HEIGHT} " in note
    assert any("as wide as high" in one for one in source.warnings())


@pytest.mark.parametrize("spec", ["-", "whole.mkv"])
def test_source_that_cannot_be_reopened_is_refused(spec, clips, capsys):
    spec = spec if spec == "-" else str(clips / spec)
    words = [spec, str(clips / "none.glb"), str(clips / "out.mkv"), "--reconnect", "2"]
    assert main(words) == 2
    assert "for devices and URLs" in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.needs_gl
def test_run_resumes_and_reports_the_interruption(clips, tmp_path, capsys):
    shots.cube_glb(tmp_path / "cube.glb")
    shots.fit_json(tmp_path / "fit.json")
    whole = (clips / "whole.mkv").read_bytes()
    with Server(whole, whole) as server:
        code = main(
            [server.url, str(tmp_path / "cube.glb"), str(tmp_path / "out.mkv"),
             "--fit", str(tmp_path / "fit.json"), "--reconnect", "0.8", "--preset", "draft"]
        )  # fmt: skip
    said = capsys.readouterr()
    assert code == 0, said.err
    assert "opened again once" in said.err + said.out
    assert len(shots.read_planes(tmp_path / "out.mkv")) == 24


def test_url_without_the_reconnect_option_ends_with_its_connection(clips):
    with Server((clips / "whole.mkv").read_bytes()) as server:
        with opened(SourceSettings(spec=server.url)) as source:
            assert len(list(source)) == 12
