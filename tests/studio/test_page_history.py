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
