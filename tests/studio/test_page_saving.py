"""Saving a shot file that another page or program has changed: nothing is lost without a word."""

import copy
import json
import tomllib

import pytest
from support.studio import TABLES, WAIT_MS, running, shown, write_shot
from support.studio_page import at_rest, saved

from nlens_video.studio.shot_state import ShotChangedError, ShotState

pytestmark = pytest.mark.slow
CHANGED = "was changed by another page or program"


def moved(tables=TABLES, **place):
    made = copy.deepcopy(tables)
    made["place"].update(place)
    return made


def told(server):
    status, said = server.get("/shot")
    return status, json.loads(said)


def set_number(page, name, value):
    page.locator(f"#{name}").fill(value)
    at_rest(page, lambda: page.locator(f"#{name}").press("Tab"))


def place_of(shot):
    return tomllib.loads(shot.read_text())["place"]


@pytest.mark.needs_chromium
@pytest.mark.parametrize("deed", ["save", "render"])
def test_second_page_reloads_or_overwrites_what_the_first_has_saved(browser, tmp_path, deed):
    shot = write_shot(tmp_path)
    with (
        running(shot) as server,
        shown(browser, server, refuses=True) as first,
        shown(browser, server, refuses=True) as second,
    ):
        set_number(first, "at-x", "0.2")
        assert saved(first, shot)["place"] == {"at": [0.2, 0.8], "size": 0.3}
        set_number(second, "yaw", "45")
        second.locator(f"#{deed}").click()
        second.get_by_text(CHANGED).wait_for()
        assert "yaw" not in place_of(shot) and not (tmp_path / "out.mp4").exists()
        at_rest(second, lambda: second.get_by_text("Reload it").click())
        assert second.get_by_text(CHANGED).is_hidden()
        assert second.locator("#saved").text_content() == "· saved"
        assert [second.locator(name).input_value() for name in ("#at-x", "#yaw")] == ["0.2", "0"]
        at_rest(second, lambda: second.locator("#undo").click())  # its own work is not lost
        assert [second.locator(name).input_value() for name in ("#at-x", "#yaw")] == ["0.4", "45"]
        saved(second, shot)
        set_number(first, "size", "0.25")
        first_refused = first.get_by_text(CHANGED)
        assert first_refused.is_hidden()
        saved_by_second = shot.read_bytes()
        with first.expect_response(lambda answer: "save" in answer.url) as answer:
            first.locator("#save").click()
        assert answer.value.status == 409
        first_refused.wait_for()
        assert shot.read_bytes() == saved_by_second
        first.get_by_text("Overwrite it").click()
        first.get_by_text("· saved", exact=True).wait_for()
        assert place_of(shot) == {"at": [0.2, 0.8], "size": 0.25}
        assert first_refused.is_hidden()


def test_page_asks_before_it_replaces_a_result_that_it_has_not_rendered(browser, tmp_path):
    shot, kept = write_shot(tmp_path, frames=1), tmp_path / "out.mp4"
    kept.write_bytes(b"footage")
    with running(shot) as server, shown(browser, server, refuses=True) as page:
        page.locator("#render").click()
        page.get_by_text("out.mp4 exists").wait_for()
        assert page.locator("#reload").is_hidden() and kept.read_bytes() == b"footage"
        page.locator("#overwrite").click()
        page.wait_for_selector("body[data-render=done]", timeout=WAIT_MS)
        assert page.locator("#refused").is_hidden() and kept.read_bytes() != b"footage"


def test_change_of_the_file_on_disk_is_seen_unless_it_is_of_comments_alone(tmp_path):
    shot = write_shot(tmp_path, frames=1)
    with running(shot) as server:
        revision = told(server)[1]["revision"]
        save = f"/save?revision={revision}"
        shot.write_text("# the corner\n" + shot.read_text())
        status, said = server.get(save, method="POST", body=moved(yaw=5))
        assert status == 200 and shot.read_text().startswith("# the corner\n")
        now = json.loads(said)["revision"]
        shot.write_text(shot.read_text().replace("yaw = 5", "yaw = 6"))
        for path in ("/save", "/render"):
            status, said = server.get(f"{path}?revision={now}", method="POST", body=moved(yaw=7))
            assert status == 409 and CHANGED in json.loads(said)["error"]
        assert place_of(shot)["yaw"] == 6
        status, about = told(server)
        assert status == 200 and about["tables"]["place"]["yaw"] == 6
        again = f"/save?revision={about['revision']}"
        assert server.get(again, method="POST", body=moved(yaw=7))[0] == 200
        assert place_of(shot)["yaw"] == 7


def test_file_that_appears_beside_an_unsaved_shot_is_not_replaced(tmp_path):
    other = write_shot(tmp_path, frames=1)
    shot = tmp_path / "new.toml"
    state = ShotState.opened(shot, str(tmp_path / "in.mp4"), tmp_path / "bare.glb")
    _, revision = state.read()
    shot.write_bytes(other.read_bytes())
    with pytest.raises(ShotChangedError, match=CHANGED):
        state.save(moved(yaw=5), revision)
    assert shot.read_bytes() == other.read_bytes()
    shot.unlink()
    state.save(moved(yaw=5), revision)
    assert place_of(shot)["yaw"] == 5


def test_file_that_was_broken_or_names_another_plate_is_told_in_a_line(tmp_path):
    shot = write_shot(tmp_path, frames=1)
    before = shot.read_text()
    with running(shot) as server:
        for text, word in (
            ("version = ", "cannot be read as a shot file"),
            (before.replace("in.mp4", "other.mp4"), "names another plate now, other.mp4"),
            (before.replace("[plate]", "[plates]"), "plates"),
        ):
            shot.write_text(text)
            status, said = told(server)
            assert status == 422 and word in said["error"], (text, said)
            status, _ = server.get("/save?revision=x", method="POST", body=TABLES)
            assert status in (409, 422) and shot.read_text() == text
        for line in ('file = "in.mp4"', 'file = "bare.glb"', 'file = "out.mp4"'):
            shot.write_text(before.replace(line, "").replace("0.4", "0.6"))
            assert told(server)[1]["tables"] == moved(at=[0.6, 0.8])  # what is left out stays


def test_render_while_one_runs_saves_nothing(tmp_path):
    shot = write_shot(tmp_path, frames=400)
    with running(shot) as server:
        assert server.get("/render", method="POST", body=TABLES)[0] == 200
        before = shot.read_bytes()
        assert server.get("/render", method="POST", body=moved(yaw=5))[0] == 422
        assert shot.read_bytes() == before
        server.get("/render", method="DELETE")
