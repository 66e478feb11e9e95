"""Steps of the history of the studio's page: where they begin and where they end."""

import cv2
import numpy as np
import pytest
from support.studio import WAIT_MS, shown
from support.studio_page import at_rest, saved

pytestmark = [pytest.mark.slow, pytest.mark.needs_chromium]
KEYS = [{"frame": 0, "at": [0.3, 0.8]}, {"frame": 3, "at": [0.6, 0.7]}]
THUMB_PX = 16


def thumb(slider):
    """Where the thumb of a slider is, in the window."""
    slider.scroll_into_view_if_needed()
    box = slider.bounding_box()
    least, most, value = (
        float(slider.evaluate(f"one => one.{name}")) for name in ("min", "max", "value")
    )
    part = (value - least) / (most - least)
    x = box["x"] + THUMB_PX / 2 + part * (box["width"] - THUMB_PX)
    return x, box["y"] + box["height"] / 2


def away_and_back(page, name):
    """Drag a slider, and let it go where it was."""
    x, y = thumb(page.locator(name))
    value = page.locator(name).input_value()
    page.mouse.move(x, y)
    page.mouse.down()
    for way in (12, 24, 12, 0):
        page.mouse.move(x + way, y)
    assert page.locator(name).input_value() == value
    page.mouse.up()


@pytest.mark.parametrize(
    "slider",
    ["#azimuth", "#elevation", "#strength", "#sun-strength", "#horizon", "#roll", "#around-turn"],
)
def test_slider_that_is_let_go_where_it_began_is_no_step_and_the_next_change_is_one(
    browser, studio, slider
):
    light = {"sun": [60, 40, 2], "env-map": "grey.hdr"}
    shot = studio.reset(light=light)
    assert cv2.imwrite(str(shot.parent / "grey.hdr"), np.full((16, 32, 3), 0.5, np.float32))
    with shown(browser, studio.server) as page:
        away_and_back(page, slider)
        assert page.locator("#undo").is_disabled()
        at_rest(page, lambda: page.locator("#shadow").select_option("0.5"))
        at_rest(page, lambda: page.locator("#preset").select_option("realtime"))
        at_rest(page, lambda: page.locator("#undo").click())
        tables = saved(page, shot)
        assert tables["light"] == {**light, "shadow-strength": 0.5}
        assert tables["quality"] == {"preset": "draft"}
        assert tables["camera"] == {"horizon": 0.3}


def test_object_follows_its_keys_after_a_slider_that_is_let_go_where_it_began(browser, studio):
    shot = studio.reset(
        object=[{"file": "bare.glb", "size": 0.3, "key": KEYS}],
        place={},
        light={"sun": [60, 40, 2]},
    )
    with shown(browser, studio.server) as page:
        away_and_back(page, "#azimuth")
        page.locator("#key-1").click()
        page.locator("#move[style*='left: 60%']").wait_for(timeout=WAIT_MS)
        at_rest(page, lambda: page.locator("#move").press("ArrowRight"))
        assert saved(page, shot)["object"][0]["key"][1] == {"frame": 3, "at": [0.602, 0.7]}


@pytest.mark.parametrize("by", ["keys", "button"])
def test_undo_right_after_the_wheel_takes_back_the_wheel_alone(page, shot, by):
    at_rest(page, lambda: page.locator("#move").press("ArrowRight"))
    before = saved(page, shot)["place"]
    page.locator("#move").hover()
    page.mouse.wheel(0, 100)
    page.get_by_text("· not saved", exact=True).wait_for()
    if by == "keys":
        page.keyboard.press("Control+z")
    else:
        page.locator("#undo").click()
    page.wait_for_timeout(400)  # longer than the wheel waits for more
    assert saved(page, shot)["place"] == before
    assert page.locator("#redo").is_enabled()
    at_rest(page, lambda: page.keyboard.press("Control+y"))
    assert saved(page, shot)["place"]["size"] > before["size"]


def test_undo_during_a_drag_takes_back_the_drag_and_not_the_step_before(page, shot):
    at_rest(page, lambda: page.locator("#move").press("ArrowRight"))
    page.locator("#move").hover()
    box = page.locator("#move").bounding_box()
    page.mouse.down()
    page.mouse.move(box["x"] + 60, box["y"] + 12)
    assert float(page.locator("#at-x").input_value()) > 0.42
    page.keyboard.press("Control+z")
    assert page.locator("#at-x").input_value() == "0.402"
    page.mouse.up()


def test_undo_in_a_field_takes_back_the_shot_once_its_number_is_taken(page, shot):
    before = saved(page, shot)["place"]
    field = page.locator("#size")
    shown_before = field.input_value()
    field.fill("0.25")
    at_rest(page, lambda: field.press("Enter"))
    assert saved(page, shot)["place"]["size"] == 0.25
    at_rest(page, lambda: field.press("Control+z"))
    assert field.input_value() == shown_before
    assert saved(page, shot)["place"] == before


def test_undo_while_a_number_is_typed_is_the_fields_own(page, shot):
    at_rest(page, lambda: page.locator("#move").press("ArrowRight"))
    before = saved(page, shot)["place"]
    field = page.locator("#size")
    field.focus()
    field.press("End")
    field.press("5")
    field.press("Control+z")
    assert saved(page, shot)["place"] == before
    assert page.locator("#redo").is_disabled()


def test_keyboard_stays_on_the_buttons_of_the_history(page, shot):
    at_rest(page, lambda: page.locator("#move").press("ArrowRight"))
    page.locator("#undo").focus()
    at_rest(page, lambda: page.keyboard.press("Enter"))
    assert page.evaluate("document.activeElement.id") == "redo"
    at_rest(page, lambda: page.keyboard.press("Enter"))
    assert page.evaluate("document.activeElement.id") == "undo"
