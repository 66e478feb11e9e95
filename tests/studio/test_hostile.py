"""Messages that no page sends: each is answered in a line or ignored, and the terminal is quiet."""

import copy
import http.client
import json

import pytest
from support.studio import TABLES, drawn, running, write_shot

pytestmark = pytest.mark.slow

DEEP = "[" * 100_000


@pytest.fixture(scope="module")
def server(tmp_path_factory):
    """A server that must not have said anything when it ends."""
    with running(write_shot(tmp_path_factory.mktemp("studio"))) as started:
        yield started
        assert started.stop() == (0, "")


def posted(server, path, data):
    connection = http.client.HTTPConnection(server.host, server.port, timeout=60)
    connection.request("POST", f"/{server.token}{path}", body=data)
    answer = connection.getresponse()
    found = answer.status, json.loads(answer.read())["error"]
    connection.close()
    return found


@pytest.mark.parametrize("path", ["/save", "/command", "/render"])
@pytest.mark.parametrize(
    "body", [DEEP, "\xff", json.dumps({**TABLES, "output": {"file": "\ud800.mp4"}})]
)
def test_what_is_no_shot_is_refused_in_a_line(server, path, body):
    assert posted(server, path, body.encode("latin-1")) == (
        422, "expected the shot's tables as JSON"
    )  # fmt: skip


@pytest.mark.parametrize("size", [2_000_000, 30_000_000])
def test_shot_of_any_size_is_told_to_be_too_large(server, size):
    assert posted(server, "/save", b"x" * size) == (422, "the shot is too large")


@pytest.mark.parametrize(
    "message",
    [
        DEEP,
        b"\x00binary",
        '{"number": 1e999, "frame": 0, "kind": "rest", "tables": {}}',
        '{"number": 1, "frame": 1e999, "kind": "rest", "tables": {}}',
        '{"number": 1, "frame": 0, "kind": [], "tables": {}}',
    ],
)
def test_message_that_is_no_wish_is_ignored(server, message):
    with server.live() as live:
        live.send(message)
        assert drawn(live, TABLES)[1] is not None


def test_numbers_of_frames_are_told_to_be_none(server):
    for number in ("9" * 9, "9" * 400, "9" * 5000, "-1", "x"):
        status, said = server.get(f"/frame/{number}")
        assert status == 422 and "error" in json.loads(said)
    with server.live() as live:
        assert "has no frame" in drawn(live, TABLES, frame=2**31 - 1)[0]["error"]


@pytest.mark.parametrize("path", ["/save", "/command", "/render"])
@pytest.mark.parametrize(
    ("table", "key", "value", "said"),
    [
        ("plate", "file", "a\0b", "has a NUL character"),
        ("output", "file", "in.mp4", "is the plate as well"),
        ("output", "file", "bare.glb", "is the scene as well"),
        ("output", "timings", "in.mp4", "is the plate as well"),
        ("place", "at", [float("nan"), 0.5], "--at nan,0.5"),
    ],
)
def test_shot_that_the_command_line_refuses_is_refused(server, path, table, key, value, said):
    tables = copy.deepcopy(TABLES)
    tables[table][key] = value
    status, answer = server.get(path, method="POST", body=tables)
    assert status == 422 and said in json.loads(answer)["error"]
