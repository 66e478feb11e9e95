"""A shot and a running studio, as its tests use them."""

from __future__ import annotations

import http.client
import json
import signal
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import parse_qs, urlsplit

import cv2
import numpy as np
from support import shots
from support.command import process
from websockets.sync.client import connect

TABLES = {
    "plate": {"file": "in.mp4"},
    "object": {"file": "bare.glb"},
    "place": {"at": [0.4, 0.8], "size": 0.3},
    "camera": {"horizon": 0.3},
    "lens": {"fit": "fit.json"},
    "effects": {"effects": "defocus"},
    "quality": {"preset": "draft"},
    "output": {"file": "out.mp4"},
}
"""A shot that needs no network: its lens and its horizon are given."""
WAIT_MS = 120_000


def write_shot(folder: Path, frames: int = 4, **tables: dict[str, object]) -> Path:
    """Plate, object, lens and shot file in a folder; returns the shot file.

    `tables` are in place of those of `TABLES`; an empty one takes its table away.
    """
    from nlens_video.options.shot_writer import save_tables

    shots.write_video(folder / "in.mp4", frames=frames)
    shots.cube_glb(folder / "bare.glb", camera=False, sun=False)
    shots.fit_json(folder / "fit.json")
    held = {name: table for name, table in {**TABLES, **tables}.items() if table}
    save_tables(folder / "shot.toml", held)
    return folder / "shot.toml"


@dataclass
class Server:
    """A studio that runs."""

    port: int
    token: str
    process: object
    host: str = "127.0.0.1"

    @property
    def address(self) -> str:
        return f"http://{self.host}:{self.port}/?token={self.token}"

    def request(self, path, method="GET", body=None, **headers):
        """Status and body of an answer; `host` and `origin` as headers of that name."""
        connection = http.client.HTTPConnection(self.host, self.port, timeout=60)
        named = {name.replace("_", "-"): value for name, value in headers.items()}
        connection.putrequest(method, path, skip_host="host" in named)
        data = b"" if body is None else json.dumps(body).encode()
        for name, value in {**named, "content-length": str(len(data))}.items():
            connection.putheader(name, value)
        connection.endheaders(data)
        answer = connection.getresponse()
        found = answer.status, answer.read()
        connection.close()
        return found

    def get(self, path, **options):
        return self.request(f"/{self.token}{path}", **options)

    def live(self, token=None, **options):
        named = self.token if token is None else token
        return connect(f"ws://{self.host}:{self.port}/{named}/live", **options)

    def stop(self) -> tuple[int, str]:
        self.process.send_signal(signal.SIGINT)
        _, error = self.process.communicate(timeout=60)
        return self.process.returncode, error.decode()


@contextmanager
def running(shot: Path, *words):
    """A server of a shot file, in a process of its own."""
    import subprocess

    started = process("studio", shot, "--no-browser", *words, stdout=subprocess.PIPE)
    line = started.stdout.readline().decode().strip()
    parts = urlsplit(line)
    try:
        assert parts.hostname is not None, (line, started.poll())
        yield Server(parts.port, parse_qs(parts.query)["token"][0], started, parts.hostname)
    finally:
        if started.poll() is None:
            started.send_signal(signal.SIGINT)
        if not started.stdout.closed:
            started.communicate(timeout=60)


@dataclass
class Studio:
    """A server that several tests share, one after the other."""

    server: Server
    shot: Path

    def reset(self, **tables: dict[str, object]) -> Path:
        """Make the shot that of `write_shot` again, with other tables; returns its file."""
        held = {name: table for name, table in {**TABLES, **tables}.items() if table}
        status, said = self.server.get("/save", method="POST", body=held)
        assert status == 200, said
        return self.shot


@contextmanager
def shown(browser, server, *, address="", reached=True, refuses=False, **more):
    """The page of a server whose first picture is drawn; it must tell of no error.

    Args:
        browser: a browser.
        server: a server.
        address: by which the browser asks for it, in place of its own.
        reached: whether it is always there; else requests may come to nothing.
        refuses: whether it may refuse what the page asks for.
        more: of the browser's context.
    """
    wrong = []
    context = browser.new_context(**{"viewport": {"width": 1280, "height": 900}, **more})
    page = context.new_page()
    page.on("pageerror", lambda error: wrong.append(str(error)))
    page.on("console", lambda said: wrong.append(said.text) if said.type == "error" else None)
    page.goto(address or server.address)
    page.wait_for_selector("body[data-kind=rest]", timeout=WAIT_MS)
    yield page
    context.close()
    told = (*(() if reached else ("net::ERR_",)), *(("status of 4",) if refuses else ()))
    assert not [one for one in wrong if not any(word in one for word in told)]


@contextmanager
def opened(browser, shot, **more):
    """As `shown`, of a server of its own; page and server."""
    with running(shot) as server, shown(browser, server, **more) as page:
        yield page, server


def drawn(socket, tables, kind="rest", frame=0, number=1):
    """What the server says of a picture, and the picture (H, W, 3); None where it has none."""
    wish = {"number": number, "tables": tables, "frame": frame, "kind": kind}
    socket.send(json.dumps(wish))
    return received(socket, number)


def received(socket, number):
    while True:
        data = socket.recv(timeout=120)
        if isinstance(data, str):
            continue
        length = int.from_bytes(data[:4], "big")
        said = json.loads(data[4 : 4 + length])
        if said["number"] == number:
            rest = np.frombuffer(data[4 + length :], np.uint8)
            return said, cv2.imdecode(rest, cv2.IMREAD_COLOR) if rest.size else None


def render_told(socket):
    """What the server says next of a render: first, at a connection, how far it is by then."""
    while True:
        data = socket.recv(timeout=300)
        if isinstance(data, str) and "render" in (said := json.loads(data)):
            return said


def changed_middle(picture, plate):
    """Middle of what differs between two pictures, in fractions of the frame."""
    differs = np.abs(picture.astype(np.int16) - plate).max(axis=2) > 40
    rows, columns = np.nonzero(differs)
    assert rows.size > 50
    return columns.mean() / picture.shape[1], rows.mean() / picture.shape[0]
