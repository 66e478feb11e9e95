"""The studio's page and its server: result, copied command, lost connection, killed server."""

import tomllib
from pathlib import Path

import pytest
from support.browser import launched
from support.command import nlens
from support.live_shot import succeeded
from support.relay import Relay
from support.studio import TABLES, WAIT_MS, opened, render_told, running, shown, write_shot
from support.studio_page import at_rest, drag, saved, seen

pytestmark = [pytest.mark.slow, pytest.mark.needs_chromium]
RELAYED = "127.0.0.3"
"""What the browser takes `localhost` for where a relay stands between it and the server."""
LOST = "#lost:visible"


def test_result_is_played_and_the_copied_command_makes_its_bytes(browser, tmp_path):
    folder = tmp_path / "a shot's folder"
    folder.mkdir()
    shot = write_shot(folder, light={"sun": [60, 40, 2]}, effects={"effects": "auto,-grain"})
    allowed = ["clipboard-read", "clipboard-write"]
    with opened(browser, shot, permissions=allowed) as (page, _):
        at_rest(page, lambda: drag(page, page.locator("#move"), 0.1, 0.05))
        page.locator("#render").click()
        page.wait_for_selector("body[data-render=done]", timeout=WAIT_MS)
        played = page.locator("#result:visible").evaluate(
            "film => new Promise((end) => { film.onended = () => end(film.currentTime);"
            " void film.play(); })"
        )
        assert played == pytest.approx(4 / 25, abs=0.05)
        page.locator("#copy").click()
        page.get_by_text("· command copied").wait_for()
        assert page.locator("#command-row").is_hidden()
        line = page.evaluate("navigator.clipboard.readText()")
    assert "shot.toml" not in line and "\n" not in line
    rendered = (folder / "out.mp4").read_bytes()
    (folder / "out.mp4").unlink()
    succeeded(line, Path("/"))
    assert (folder / "out.mp4").read_bytes() == rendered


def test_command_is_shown_where_the_browser_lets_no_page_copy(browser, studio, shot):
    """As of an address that is not this machine's own: to browsers the page is insecure."""
    with shown(browser, studio.server) as page:
        page.evaluate("Object.defineProperty(navigator, 'clipboard', { value: undefined })")
        page.locator("#copy").click()
        line = page.locator("#command")
        line.wait_for()
        assert line.input_value().startswith(f"cd {shot.parent} && nlens-video in.mp4 bare.glb ")
        chosen = line.evaluate("one => one.value.slice(one.selectionStart, one.selectionEnd)")
        assert chosen == line.input_value()


@pytest.mark.parametrize(
    ("result", "words"),
    [("in.mp4", "is the plate as well"), ("bare.glb", "is the scene as well"),
     ("fit.json", "is --fit as well")],
)  # fmt: skip
def test_refused_render_is_told_until_the_shot_is_changed(browser, studio, shot, result, words):
    with shown(browser, studio.server, refuses=True) as page:
        before = shot.read_bytes()
        page.locator("#output").fill(result)
        page.locator("#render").click()
        told = page.get_by_text(words)
        told.wait_for()
        at_rest(page, lambda: page.locator("#compare").select_option("wipe sharp"))
        assert told.is_visible()
        assert shot.read_bytes() == before
        page.locator("#output").fill("other.mp4")
        at_rest(page, lambda: page.keyboard.press("Tab"))
        assert told.is_hidden()


def test_connection_that_is_lost_is_told_and_comes_back_with_nothing_lost(browser, tmp_path):
    shot = write_shot(tmp_path, frames=60)
    with (
        running(shot) as server,
        launched(browser.browser_type, f"--host-resolver-rules=MAP localhost {RELAYED}") as relayed,
    ):
        relay = Relay(RELAYED, server.host, server.port)
        address = server.address.replace(server.host, "localhost")
        with shown(relayed, server, address=address, reached=False) as page:
            before = seen(page)
            page.locator("#render").click()
            page.wait_for_selector("body[data-render=running]")
            relay.cut()
            page.locator(LOST).wait_for()
            drag(page, page.locator("#move"), 0.2, 0.0)
            page.locator("#frame").press("ArrowRight")
            assert page.locator("#busy").text_content() == ""
            with server.live() as live:  # the render goes on, and ends unseen
                while (said := render_told(live))["render"] == "running":
                    pass
            assert said["render"] == "done"
            assert page.locator("body").get_attribute("data-render") == "running"
            at_rest(page, relay.mend)
            assert page.locator(LOST).count() == 0
            page.wait_for_selector("body[data-render=done]")
            assert page.locator("#result").is_visible()
            assert (seen(page) != before).any()
            assert saved(page, shot)["place"]["at"] == pytest.approx([0.6, 0.8], abs=0.005)
            assert page.locator("#frame-number").text_content() == "1"
            at_rest(page, lambda: page.keyboard.press("Control+z"))
            at_rest(page, lambda: page.locator("#frame").press("Home"))
            assert (seen(page) == before).all()


def test_server_that_is_killed_is_told_and_the_shot_can_be_kept(browser, tmp_path):
    keys = [{"frame": 0, "at": [0.2, 0.8]}, {"frame": 3, "at": [0.6, 0.9]}]
    several = [
        {"file": "bare.glb", "at": [0.4, 0.8], "size": 0.3},
        {"file": "bare.glb", "size": 0.2, "key": keys},
    ]
    shot = write_shot(tmp_path, object=several, place={}, light={"sun": [60, 40, 2]})
    before = shot.read_text()
    with running(shot) as server, shown(browser, server, reached=False) as page:
        server.process.kill()
        page.locator(LOST).wait_for()
        drag(page, page.locator("#move"), 0.1, 0.0)
        page.locator("#save").click()
        page.get_by_text("the server does not answer", exact=True).wait_for()
        assert page.get_by_text("· not saved").count() == 1
        with page.expect_download() as kept:
            page.locator("#keep").click()
        assert kept.value.suggested_filename == "shot.toml"
        kept.value.save_as(tmp_path / "kept.toml")
    assert shot.read_text() == before
    tables = tomllib.loads((tmp_path / "kept.toml").read_text())
    at = tables["object"][0].pop("at")
    assert at == pytest.approx([0.5, 0.8], abs=0.005)
    held = {name: table for name, table in TABLES.items() if name not in ("object", "place")}
    assert {**several[0], **tables["object"][0]} == several[0]
    assert tables["object"][1] == several[1]
    del tables["object"]
    assert tables == {"version": 2, **held, "light": {"sun": [60, 40, 2]}}
    assert nlens(tmp_path / "kept.toml", "-q", "--frame", "3").returncode == 0
