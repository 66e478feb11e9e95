"""The studio's page in a real browser: what hands and keys do, and what is drawn then."""

import itertools
import subprocess

import cv2
import numpy as np
import pytest
from support.browser import NODE_PACKAGES
from support.command import nlens
from support.folders import ROOT
from support.studio import WAIT_MS, changed_middle, opened, render_told, shown, write_shot
from support.studio_page import at_rest, canvas, drag, plate_seen, saved, seen

pytestmark = pytest.mark.slow
PAGE = ROOT / "nlens_video" / "studio" / "page"


@pytest.mark.needs_chromium
def test_object_follows_the_pointer_and_undo_brings_it_back(page, shot):
    plate, before = plate_seen(page), seen(page)
    at_rest(page, lambda: drag(page, page.locator("#move"), 0.25, 0.0))
    moved = seen(page)
    way = changed_middle(moved, plate)[0] - changed_middle(before, plate)[0]
    assert way == pytest.approx(0.25, abs=0.03)
    assert saved(page, shot)["place"]["at"] == pytest.approx([0.65, 0.8], abs=0.005)
    at_rest(page, lambda: page.keyboard.press("Control+z"))
    np.testing.assert_array_equal(seen(page), before)
    assert saved(page, shot)["place"]["at"] == [0.4, 0.8]
    at_rest(page, lambda: page.locator("#redo").click())
    np.testing.assert_array_equal(seen(page), moved)


@pytest.mark.needs_chromium
def test_object_becomes_smaller_towards_the_horizon(page, shot):
    at_rest(page, lambda: drag(page, page.locator("#move"), 0.0, -0.25))
    place = saved(page, shot)["place"]
    assert place["at"][1] == pytest.approx(0.55, abs=0.005)
    assert place["size"] == pytest.approx(0.3 * 0.25 / 0.5, rel=0.03)


@pytest.mark.needs_chromium
def test_handles_and_wheel_scale_turn_and_move_away(page, shot):
    at_rest(page, lambda: drag(page, page.locator("#scale"), 0.0, -0.1))
    assert saved(page, shot)["place"]["size"] == pytest.approx(0.4, abs=0.01)
    at_rest(page, lambda: drag(page, page.locator("#turn"), 0.1, 0.0))
    assert 20 < saved(page, shot)["place"]["yaw"] < 90
    page.locator("#move").hover()
    at_rest(page, lambda: page.mouse.wheel(0, -200))
    assert saved(page, shot)["place"]["size"] < 0.36


@pytest.mark.needs_chromium
def test_keys_place_the_object(page, shot):
    page.locator("#move").focus()
    at_rest(page, lambda: page.keyboard.press("Shift+ArrowRight"))
    at_rest(page, lambda: page.keyboard.press("+"))
    at_rest(page, lambda: page.keyboard.press("."))
    place = saved(page, shot)["place"]
    assert place["at"] == [0.42, 0.8]
    assert place["size"] > 0.3
    assert place["yaw"] == 1


@pytest.mark.needs_chromium
def test_keys_step_through_the_frames(browser, studio):
    ways = [{"frame": 0, "at": [0.3, 0.8]}, {"frame": 3, "at": [0.6, 0.8]}]
    studio.reset(object=[{"file": "bare.glb", "size": 0.3, "key": ways}], place={})
    with shown(browser, studio.server) as page:
        page.locator("#show-guides").uncheck()
        page.locator("#frame").focus()
        pictures = {}
        for key, number in (
            ("ArrowRight", 1), ("ArrowUp", 2), ("ArrowLeft", 1), ("ArrowDown", 0), ("End", 3),
            ("Home", 0),
        ):  # fmt: skip
            at_rest(page, lambda key=key: page.keyboard.press(key))
            assert page.locator("#frame-number").text_content() == str(number)
            picture = canvas(page, "#picture")
            np.testing.assert_array_equal(picture, pictures.setdefault(number, picture))
    for one, other in itertools.combinations(pictures.values(), 2):
        changed_middle(one, other)  # which asserts that something is elsewhere


@pytest.mark.needs_chromium
def test_horizon_sun_and_effects_become_the_shot(page, shot):
    before = seen(page)
    at_rest(page, lambda: page.locator("#horizon").press("ArrowLeft"))
    at_rest(page, lambda: page.locator("#sun").check())
    at_rest(page, lambda: page.locator("#effect-defocus").uncheck())
    tables = saved(page, shot)
    assert tables["camera"]["horizon"] == pytest.approx(0.295)
    assert len(tables["light"]["sun"]) == 3 and tables["light"]["sun"][2] == 2
    assert tables["effects"]["effects"] == "none"
    assert (seen(page) != before).any()
    assert nlens(shot, "--no-progress", "-q").returncode == 0


@pytest.mark.needs_chromium
def test_light_from_around_is_a_map_of_the_folder_that_can_be_turned(browser, studio, shot):
    west = np.full((32, 64, 3), 0.02, np.float32)
    west[:16, :16] = 12.0
    assert cv2.imwrite(str(shot.parent / "west.hdr"), west)
    with shown(browser, studio.server) as page:
        pictures = [seen(page)]
        at_rest(page, lambda: page.locator("#around").select_option("west.hdr"))
        pictures.append(seen(page))
        at_rest(page, lambda: page.locator("#around-turn").press("End"))
        pictures.append(seen(page))
        assert saved(page, shot)["light"] == {"env-map": "west.hdr", "env-rotation": 180}
        assert all((one != other).any() for one, other in itertools.pairwise(pictures))
        at_rest(page, lambda: page.locator("#around").select_option(""))
        np.testing.assert_array_equal(seen(page), pictures[0])
        assert "light" not in saved(page, shot)


@pytest.mark.needs_chromium
def test_strip_of_pictures_ground_grid_and_reasons_of_effects_are_shown(page):
    strip = page.locator("#thumbnails img")
    strip.evaluate_all("all => Promise.all(all.map(one => one.decode()))")
    assert strip.evaluate_all("all => all.map(one => one.naturalWidth > 50)") == [True] * 4
    rows = page.locator("#drawn line:not(.horizon)").evaluate_all(
        "all => all.flatMap(one => [one, one].map((line, end) => Number("
        "line.getAttribute(end ? 'y2' : 'y1'))))"
    )
    assert len(rows) > 10 and min(rows) > 0.3  # on the ground: below the horizon
    for effect in ("defocus", "grain"):
        assert page.locator(f"#why-{effect}").text_content()


@pytest.mark.needs_chromium
def test_render_is_begun_and_cancelled_by_the_keyboard_alone(browser, tmp_path):
    shot = write_shot(tmp_path, frames=3000)
    with opened(browser, shot) as (page, _):
        page.locator("#render").press("Enter")
        page.locator("#progress[value]").wait_for(timeout=WAIT_MS)
        page.keyboard.press("Enter")  # the focus went to the button that took the first one's place
        page.wait_for_selector("body[data-render=cancelled]", timeout=WAIT_MS)
        assert page.evaluate("document.activeElement.id") == "render"
        assert page.locator("#rendered").text_content() == "Cancelled; no result was written."
        assert page.locator("#render").is_visible() and page.locator("#result").is_hidden()
    assert not (tmp_path / "out.mp4").exists()


@pytest.mark.needs_chromium
def test_render_in_the_page_survives_its_tab(browser, tmp_path):
    shot = write_shot(tmp_path)
    with opened(browser, shot) as (page, server):
        page.locator("#render").click()
        page.wait_for_selector("body[data-render=running]")
        page.close()
        with server.live() as live:
            assert render_told(live)["render"] == "running"
            while (said := render_told(live))["render"] == "running":
                pass
    assert said["render"] == "done"
    assert (shot.parent / "out.mp4").exists()


@pytest.mark.needs_chromium
def test_tab_closed_while_its_picture_is_drawn_harms_no_other(browser, tmp_path):
    with opened(browser, write_shot(tmp_path)) as (page, server):
        page.locator("#preset").select_option("standard")
        page.locator("#turn").press("ArrowRight")
        page.close()
        other = browser.new_page()
        other.goto(server.address)
        other.wait_for_selector("body[data-kind=rest]", timeout=WAIT_MS)
        before = seen(other)
        at_rest(other, lambda: drag(other, other.locator("#move"), 0.2, 0.0))
        assert (seen(other) != before).any()
        other.close(run_before_unload=False)
        assert server.stop() == (0, "")


@pytest.mark.needs_chromium
def test_no_request_leaves_the_machine_and_each_control_has_a_name(browser, studio):
    studio.reset(light={"sun": [60, 40, 2]})
    asked, server = [], studio.server
    with shown(browser, server) as page:
        page.on("request", lambda request: asked.append(request.url))
        page.reload()
        page.wait_for_selector("body[data-kind=rest]", timeout=WAIT_MS)
        assert asked
        assert all(url.startswith((f"http://127.0.0.1:{server.port}/", "blob:")) for url in asked)
        for control in page.locator("button:visible, input:visible, select:visible").all():
            named = control.evaluate(
                "one => one.ariaLabel || one.textContent.trim() "
                "|| [...(one.labels ?? [])].map((label) => label.textContent.trim()).join('')"
            )
            assert named, control.evaluate("one => one.outerHTML")


@pytest.mark.needs_chromium
@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_page_fits_a_telephone(browser, studio, shot, scheme):
    narrow = {"width": 400, "height": 800}
    with shown(browser, studio.server, viewport=narrow, color_scheme=scheme) as page:
        assert page.evaluate("document.documentElement.scrollWidth") == 400
        at_rest(page, lambda: drag(page, page.locator("#move"), 0.1, 0.0))
        assert saved(page, shot)["place"]["at"][0] == pytest.approx(0.5, abs=0.01)


@pytest.mark.needs_node_packages
def test_modules_of_the_page_have_no_type_errors():
    checked = subprocess.run(
        [NODE_PACKAGES / ".bin" / "tsc", "--checkJs", "--allowJs", "--noEmit", "--strict",
         "--target", "es2022", "--module", "es2022", "--moduleResolution", "bundler",
         "--lib", "es2022,dom,dom.iterable", *map(str, sorted(PAGE.glob("*.js")))],
        capture_output=True, text=True,
    )  # fmt: skip
    assert checked.returncode == 0, checked.stdout
