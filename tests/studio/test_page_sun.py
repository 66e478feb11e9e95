"""The sun on the studio's page: on its disc, by the end of its shadow, by keys."""

import math
import re

import numpy as np
import pytest
from support.studio import WAIT_MS, shown
from support.studio_page import at_rest, canvas, plate_seen, saved, seen

pytestmark = [pytest.mark.slow, pytest.mark.needs_chromium]
LIT = {
    "light": {"sun": [90, 45, 2]},
    "effects": {"effects": "shadow"},
    "quality": {"preset": "standard"},
}


@pytest.fixture
def sunny(browser, studio):
    studio.reset(**LIT)
    with shown(browser, studio.server) as page:
        yield page


def middle(page, name):
    box = page.locator(name).bounding_box()
    return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2


def dragged(page, name, way, check):
    """Drag a handle, and look at the picture of the moving sun before the pointer is up."""
    x, y = middle(page, name)
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + way[0] / 2, y + way[1] / 2)
    page.mouse.move(x + way[0], y + way[1])
    page.wait_for_selector("body[data-kind=light]", timeout=WAIT_MS)
    page.wait_for_timeout(500)
    check()
    at_rest(page, page.mouse.up)


def shadow_side(picture, plate):
    """Mean column of what is darker than the plate, from the object's foot [frame width]."""
    darker = np.clip(plate.astype(float) - picture, 0, None).min(axis=2)
    columns = np.arange(picture.shape[1]) / picture.shape[1]
    return float((darker.sum(axis=0) * columns).sum() / darker.sum()) - 0.4


def sun_of(shot, page):
    return saved(page, shot)["light"]["sun"]


def test_sun_is_dragged_and_its_shadow_drawn_meanwhile(sunny, studio):
    page, plate = sunny, plate_seen(sunny)
    before = seen(page)
    assert shadow_side(before, plate) < -0.03
    meanwhile = []
    disc = page.locator("#sky").bounding_box()
    way = (-disc["width"] / 2, 0)  # from 45 degrees on the right to 45 on the left

    def look():
        page.evaluate("document.querySelectorAll('#stage > :not(canvas)').forEach("
                      "one => one.style.visibility = 'hidden')")  # fmt: skip
        meanwhile.append(canvas(page, "#picture"))
        page.evaluate("document.querySelectorAll('#stage > *').forEach("
                      "one => one.style.visibility = '')")  # fmt: skip

    dragged(page, "#sun-handle", way, look)
    assert shadow_side(meanwhile[0], plate) > 0.03
    after = seen(page)
    assert shadow_side(after, plate) > 0.03
    assert sun_of(studio.shot, page) == pytest.approx([-90, 45, 2], abs=2)
    at_rest(page, lambda: page.keyboard.press("Control+z"))  # the whole drag is one step
    assert sun_of(studio.shot, page) == [90, 45, 2]
    np.testing.assert_array_equal(seen(page), before)


def test_end_of_the_shadow_follows_the_pointer(sunny, studio):
    page = sunny
    start = middle(page, "#shadow-tip")
    outlines = []
    dragged(page, "#shadow-tip", (40, 30),
            lambda: outlines.append(page.locator("#sunlight .shade").count()))  # fmt: skip
    assert outlines == [1]
    assert middle(page, "#shadow-tip") == pytest.approx((start[0] + 40, start[1] + 30), abs=4)
    azimuth, height, strength = sun_of(studio.shot, page)
    assert 10 < azimuth < 90 and strength == 2  # the shadow came nearer: the sun went ahead
    assert page.locator("#sunlight .shade").count() == 0
    # the sun stands where the ray from the end of the shadow over the top of the object goes
    assert 2 <= height <= 90 and not math.isclose(height, 45, abs_tol=0.5)


def test_keys_turn_lift_and_strengthen_the_sun(sunny, studio):
    page = sunny
    for handle, key in (("#sun-handle", "Shift+ArrowLeft"), ("#sun-handle", "ArrowUp"),
                        ("#sun-handle", "+"), ("#shadow-tip", "ArrowRight"),
                        ("#shadow-tip", "Shift+ArrowUp")):  # fmt: skip
        page.locator(handle).focus()
        at_rest(page, lambda key=key: page.keyboard.press(key))
    assert sun_of(studio.shot, page) == [81, 36, 2.25]
    said = page.locator("#sun-handle").get_attribute("aria-valuetext")
    assert said == "81 degrees to the right of the view, 36 high, strength 2.25"
    at_rest(page, lambda: page.locator("#sun-strength").press("ArrowRight"))
    assert sun_of(studio.shot, page) == [81, 36, 2.5]
    assert page.locator("#strength").input_value() == "2.5"


def test_disc_is_shown_with_a_sun_and_guides_alone(sunny):
    page = sunny
    assert page.locator("#sun-dial").is_visible()
    page.locator("#show-guides").uncheck()
    assert page.locator("#sun-dial").is_hidden()
    page.locator("#show-guides").check()
    at_rest(page, lambda: page.locator("#sun").uncheck())
    assert page.locator("#sun-dial").is_hidden()
    assert page.locator("#shadow-tip").is_hidden()


def test_a_shot_without_any_sun_shows_no_handle_and_keeps_saying_so(browser, studio):
    studio.reset(**(LIT | {"light": {"sun": "none"}}))
    with shown(browser, studio.server) as page:
        assert not page.locator("#sun").is_checked()
        assert page.locator("#sun-dial").is_hidden() and page.locator("#sun-rows").is_hidden()
        at_rest(page, lambda: page.locator("#shadow").select_option(index=1))
        assert saved(page, studio.shot)["light"]["sun"] == "none"


def test_a_sun_that_is_switched_on_begins_where_the_plate_tells_it(browser, studio):
    studio.reset(**(LIT | {"light": {}}))
    with shown(browser, studio.server) as page:
        told = re.search(r"--sun (-?\d+),(\d+) \(", page.locator("#notes").inner_text())
        assert told is not None
        at_rest(page, lambda: page.locator("#sun").check())
        assert sun_of(studio.shot, page) == [int(told[1]), int(told[2]), 2]


def test_a_slider_keeps_what_the_others_can_only_show_rounded(browser, studio):
    studio.reset(**(LIT | {"light": {"sun": [120.4, 40.3, 12]}}))
    with shown(browser, studio.server) as page:
        at_rest(page, lambda: page.locator("#azimuth").press("ArrowRight"))
        assert sun_of(studio.shot, page) == [121, 40.3, 12]
        at_rest(page, lambda: page.locator("#elevation").press("ArrowRight"))
        assert sun_of(studio.shot, page) == [121, 41, 12]
