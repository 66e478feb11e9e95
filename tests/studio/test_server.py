"""The studio's server: who may speak to it, what it draws, saves and renders, and how it ends."""

import copy
import json
import socket
import subprocess
import sys
import time
import tomllib
from contextlib import ExitStack

import cv2
import numpy as np
import pytest
from support.command import nlens, one_line
from support.studio import (
    TABLES,
    changed_middle,
    drawn,
    received,
    render_told,
    running,
    write_shot,
)
from websockets.exceptions import WebSocketException

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def server(tmp_path_factory):
    with running(write_shot(tmp_path_factory.mktemp("studio"))) as started:
        yield started


def placed(x, y=0.8, **more):
    tables = copy.deepcopy(TABLES)
    tables["place"].update(at=[x, y], **more)
    return tables


def plate_of(server, frame=0):
    status, data = server.get(f"/frame/{frame}")
    assert status == 200
    return cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)


def test_page_is_served_to_its_token(server):
    status, page = server.request(f"/?token={server.token}")
    assert status == 200
    assert f'<base href="/{server.token}/">'.encode() in page
    assert server.get("/page/main.js")[0] == server.get("/page/style.css")[0] == 200


@pytest.mark.parametrize(
    "path",
    ["/", "/?token=", "/?token=wrong", "/page/main.js", "/shot", "/wrong/shot", "/frame/0",
     "//shot", "/?token={token}&token=wrong"],
)  # fmt: skip
def test_nothing_is_served_without_the_token(server, path):
    assert server.request(path.format(token=server.token))[0] == 403


def test_requests_of_other_sites_are_refused(server):
    assert server.get("/shot", origin="http://evil.example")[0] == 403
    assert server.get("/shot", origin="null")[0] == 403
    assert server.get("/shot", origin=f"http://127.0.0.1:{server.port + 1}")[0] == 403
    assert server.get("/shot", origin=f"http://127.0.0.1:{server.port}")[0] == 200


def test_names_that_are_made_to_lead_here_are_refused(server):
    assert server.get("/shot", host=f"rebound.example:{server.port}")[0] == 403
    assert server.get("/shot", host=f"localhost:{server.port}")[0] == 200


def test_another_address_is_served_by_its_name_and_to_its_token_alone(tmp_path):
    with running(write_shot(tmp_path, frames=1), "--host", "127.0.0.2") as other:
        assert (other.host, other.get("/shot")[0]) == ("127.0.0.2", 200)
        assert other.request("/shot")[0] == 403
        assert other.get("/shot", host=f"127.0.0.1:{other.port}")[0] == 403
        with pytest.raises(OSError):
            socket.create_connection(("127.0.0.1", other.port), timeout=5).close()


def test_address_that_others_reach_needs_a_word_more(tmp_path):
    words = ("studio", write_shot(tmp_path, frames=1), "--no-browser", "--host", "192.0.2.1")
    assert "add --i-know-it-is-unencrypted" in one_line(nlens(*words), 2)
    line = one_line(nlens(*words, "--i-know-it-is-unencrypted"), 2)
    assert "cannot be used" in line  # for this machine has another address


@pytest.mark.parametrize("token", ["", "wrong"])
def test_pictures_need_the_token(server, token):
    with pytest.raises((WebSocketException, EOFError)), server.live(token):
        pass


def test_pictures_are_not_sent_to_other_sites(server):
    with pytest.raises(WebSocketException), server.live(origin="http://evil.example"):
        pass


@pytest.mark.parametrize(
    "name", ["../shot_state.py", "..%2fshot_state.py", "%2e%2e%2fapp.py", "index.html", "none.js"]
)
def test_only_files_of_the_page_are_served(server, name):
    assert server.get(f"/page/{name}")[0] == 404


def test_object_is_drawn_where_the_shot_places_it(server):
    plate = plate_of(server)
    with server.live() as live:
        for kind in ("drag", "rest"):
            left, right = (drawn(live, placed(x), kind) for x in (0.3, 0.6))
            assert left[0]["guides"]["objects"][0]["at"] == pytest.approx([0.3, 0.8], abs=1e-6)
            assert left[0]["guides"]["objects"][0]["size"] == pytest.approx(0.3, abs=1e-6)
            way = changed_middle(right[1], plate)[0] - changed_middle(left[1], plate)[0]
            assert way == pytest.approx(0.3, abs=0.03)


def test_effects_come_with_reasons(server):
    with server.live() as live:
        said, _ = drawn(live, TABLES)
    assert {one["name"]: one["on"] for one in said["effects"]}["defocus"]
    assert all(one["reason"] for one in said["effects"])
    assert "coc_px" in said["lens"]


def test_shot_that_cannot_be_drawn_is_told_in_words(server):
    with server.live() as live:
        said, picture = drawn(live, placed(0.4, 0.1))
        assert "above the horizon" in said["error"]
        assert picture is None
        assert "did you mean size" in drawn(live, {**TABLES, "place": {"siz": 1}})[0]["error"]
        assert drawn(live, TABLES)[1] is not None


@pytest.mark.parametrize("text", ["", "{", "[]", '{"number": 1}', '{"number": 1, "frame": -1}'])
def test_nonsense_is_ignored(server, text):
    with server.live() as live:
        live.send(text)
        assert drawn(live, TABLES)[1] is not None


def test_only_the_latest_wish_counts(server):
    with server.live() as live:
        for number in range(1, 30):
            wish = {"number": number, "tables": placed(0.01 * number), "frame": 0, "kind": "drag"}
            live.send(json.dumps(wish))
        said, _ = received(live, 29)
    assert said["guides"]["objects"][0]["at"][0] == pytest.approx(0.29, abs=1e-6)


@pytest.mark.parametrize("kind", ["drag", "rest"])
def test_many_pages_are_each_answered(server, kind):
    places = [0.2, 0.35, 0.5, 0.65]
    with ExitStack() as stack:
        pages = [stack.enter_context(server.live()) for _ in places]
        for page, x in zip(pages, places, strict=True):
            wish = {"number": 7, "tables": placed(x), "frame": 1, "kind": kind}
            page.send(json.dumps(wish))
        for page, x in zip(pages, places, strict=True):
            assert received(page, 7)[0]["guides"]["objects"][0]["at"][0] == pytest.approx(
                x, abs=1e-6
            )


def test_focus_shows_the_blur_in_colours(server):
    with server.live() as live:
        said, picture = drawn(live, TABLES, "focus")
    assert said["top_px"] >= 1.0
    assert picture.shape == plate_of(server).shape


@pytest.mark.parametrize(
    ("table", "key", "value"),
    [("plate", "file", "/etc/passwd"), ("lens", "fit", "../fit.json"),
     ("output", "file", "/tmp/elsewhere.mp4"), ("output", "report", "../report"),
     ("output", "file", "shot.toml"), ("output", "file", "rtmp://example.com/live"),
     ("light", "env-map", "/etc/sky.hdr")],
)  # fmt: skip
def test_files_outside_the_shot_are_neither_read_nor_written(server, table, key, value):
    tables = copy.deepcopy(TABLES)
    tables.setdefault(table, {})[key] = value
    for path in ("/save", "/render", "/command"):
        status, said = server.get(path, method="POST", body=tables)
        assert status == 422, path
        assert "error" in json.loads(said)


def test_port_that_is_taken_is_one_line(tmp_path):
    shot = write_shot(tmp_path, frames=1)
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = taken.getsockname()[1]
        line = one_line(nlens("studio", shot, "--no-browser", "--port", port), 2)
    assert f"--port {port}: cannot be used" in line


def test_missing_library_is_one_line(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "uvicorn", None)
    run = nlens("studio", write_shot(tmp_path, frames=1), "--no-browser")
    assert "pip install 'nlens-video[studio]'" in one_line(run, 2)


@pytest.mark.parametrize(
    ("words", "code"),
    [(("none.mp4", "bare.glb"), 3), (("none.toml",), 2), (("in.mp4",), 2), (("-", "bare.glb"), 2),
     (("in.mp4", "bare.glb", "--shot", "in.mp4"), 2), (("in.mp4", "bare.glb"), 2)],
)  # fmt: skip
def test_wrong_words_are_one_line(tmp_path, monkeypatch, words, code):
    write_shot(tmp_path, frames=1)
    monkeypatch.chdir(tmp_path)
    more = () if "--shot" in words or len(words) == 1 else ("--shot", "new.toml")
    if words == ("in.mp4", "bare.glb"):
        more = ()  # the folder has a shot.toml already
    one_line(nlens("studio", *words, *more, "--no-browser"), code)


def test_render_equals_that_of_the_command_line_and_the_end_leaves_nothing(tmp_path):
    shot = write_shot(tmp_path)
    tables = placed(0.55, yaw=20)
    with running(shot) as server, server.live() as live:
        assert server.get("/render", method="POST", body=tables)[0] == 200
        told = [render_told(live)]
        assert told[0]["render"] in ("none", "running")
        while told[-1]["render"] in ("none", "running"):
            told.append(render_told(live))
        assert told[-1]["render"] == "done", told[-1]
        assert any(one.get("of") == 4 for one in told)
        status, film = server.get("/result")
        assert status == 200
        code, error = server.stop()
    assert (code, error) == (0, "")
    assert film == (tmp_path / "out.mp4").read_bytes()
    assert tomllib.loads(shot.read_text()) == {"version": 1, **tables}
    (tmp_path / "out.mp4").rename(tmp_path / "studio.mp4")
    assert nlens(shot, "--no-progress", "-q").returncode == 0
    assert film == (tmp_path / "out.mp4").read_bytes()


def rendered(server, live, tables, more=""):
    """The answer to a wish for a render, and how it ends."""
    status, said = server.get(f"/render{more}", method="POST", body=tables)
    if status != 200:
        return status, json.loads(said)
    while (told := render_told(live))["render"] in ("none", "running"):
        pass
    return status, told


def test_result_that_the_studio_has_not_rendered_is_replaced_only_where_that_is_asked_for(tmp_path):
    shot, kept = write_shot(tmp_path, frames=1), tmp_path / "out.mp4"
    kept.write_bytes(b"footage")
    with running(shot) as server, server.live() as live:
        status, said = rendered(server, live, TABLES)
        assert (status, said["holds"]) == (409, "result") and "out.mp4 exists" in said["error"]
        assert kept.read_bytes() == b"footage"
        assert rendered(server, live, TABLES, "?replace=1")[1]["render"] == "done"
        first = kept.read_bytes()
        assert rendered(server, live, placed(0.6))[1]["render"] == "done"  # its own
        assert kept.read_bytes() not in (first, b"footage")
        kept.write_bytes(b"edited elsewhere")
        assert rendered(server, live, TABLES)[0] == 409


def test_result_shown_is_that_of_the_last_render_whatever_the_shot_names_now(tmp_path):
    shot, other = write_shot(tmp_path, frames=1), tmp_path / "other.mp4"
    other.write_bytes(b"footage")
    with running(shot) as server, server.live() as live:
        assert server.get("/result")[0] == 404
        assert rendered(server, live, TABLES)[1]["render"] == "done"
        named = {**TABLES, "output": {"file": "other.mp4"}}
        assert server.get("/save", method="POST", body=named)[0] == 200
        assert server.get("/result") == (200, (tmp_path / "out.mp4").read_bytes())


def test_cancelled_render_leaves_no_result_and_the_end_ends_a_running_one(tmp_path):
    shot = write_shot(tmp_path, frames=400)
    with running(shot) as server, server.live() as live:
        for ends in ("cancel", "close"):
            assert server.get("/render", method="POST", body=TABLES)[0] == 200
            assert server.get("/render", method="POST", body=TABLES)[0] == 422  # one at a time
            while not render_told(live).get("frames"):
                pass
            if ends == "cancel":
                assert server.get("/render", method="DELETE")[0] == 200
                while (said := render_told(live))["render"] == "running":
                    pass
                assert said["render"] == "cancelled"
        assert server.stop()[0] == 0
    assert not runs(shot)
    assert_nothing_was_written(shot)


def test_server_that_is_killed_takes_its_render_with_it(tmp_path):
    shot = write_shot(tmp_path, frames=1000)
    with running(shot) as server, server.live() as live:
        assert server.get("/render", method="POST", body=TABLES)[0] == 200
        while not render_told(live).get("frames"):
            pass
        assert runs(shot)
        server.process.kill()
        server.process.wait()
        until = time.monotonic() + 60
        while runs(shot):
            assert time.monotonic() < until
            time.sleep(0.1)
    assert_nothing_was_written(shot)


def runs(shot):
    """Whether a process of the shot is left."""
    return str(shot) in subprocess.check_output(["ps", "-ww", "-eo", "args"], text=True)


def assert_nothing_was_written(shot):
    names = {one.name for one in shot.parent.iterdir()}
    assert names == {"in.mp4", "bare.glb", "fit.json", "shot.toml"}


def test_render_that_ends_before_its_interrupt_arrives_is_done():
    from nlens_video.studio.render_job import RenderJob

    told = []
    job = RenderJob(told.append)
    says = "import sys; sys.exit('nlens-video: interrupted; /a folder/out.mp4 is complete')"
    pipe = subprocess.PIPE
    job._cancelled = True
    words = [sys.executable, "-c", says]
    with subprocess.Popen(words, stdout=pipe, stderr=pipe, text=True) as process:
        job._follow(process)
    assert told == [{"render": "done", "output": "/a folder/out.mp4", "frames": 0, "notes": []}]
