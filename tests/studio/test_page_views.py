"""Views of the studio's page: sharp, compared, the blur of the plate and the fit of the lens."""

import json

import numpy as np
import pytest
from support.command import nlens
from support.studio import WAIT_MS, shown
from support.studio_page import at_rest, canvas, plate_seen, saved, seen, view

pytestmark = [pytest.mark.slow, pytest.mark.needs_chromium]

LINE_OF_THE_WIPE = """picture => {
    const row = picture.getContext("2d").getImageData(0, 9, picture.width, 1).data;
    const white = [...Array(picture.width).keys()].filter(
        at => row.slice(4 * at, 4 * at + 3).every(value => value === 255));
    return white.reduce((sum, at) => sum + (at + 0.5), 0) / white.length / picture.width;
}"""


@pytest.fixture
def blurred(browser, studio):
    """The page of a shot whose object is far out of focus."""
    lens = json.loads((studio.shot.parent / "fit.json").read_text())
    (studio.shot.parent / "far.json").write_text(json.dumps({**lens, "intercept": -30.0}))
    studio.reset(lens={"fit": "far.json"})
    with shown(browser, studio.server) as page:
        yield page


def differs(one, other, levels=30):
    """Share of the pixels that differ by more than some levels."""
    return (np.abs(one.astype(np.int16) - other).max(axis=2) > levels).mean()


def test_sharp_is_the_object_without_its_lens(blurred):
    page = blurred
    plate, final = plate_seen(page), seen(page)
    at_rest(page, lambda: view(page, "Sharp"))
    sharp = seen(page)
    assert 0.001 < differs(sharp, final) < differs(sharp, plate)
    assert differs(final, plate, 6) > 1.1 * differs(sharp, plate, 6)  # blur reaches farther


def compare(page, how):
    at_rest(page, lambda: page.locator("#compare").select_option(how))


def test_wipe_and_beside_compare_final_sharp_and_plate(blurred):
    page = blurred
    plate, final = plate_seen(page), seen(page)
    at_rest(page, lambda: view(page, "Sharp"))
    sharp = seen(page)
    at_rest(page, lambda: view(page, "Final"))
    middle = final.shape[1] // 2
    for name, other in (("plate", plate), ("sharp", sharp)):
        compare(page, f"wipe {name}")
        page.locator("#wipe").evaluate("one => { one.style.opacity = 0; }")
        wiped = seen(page)
        np.testing.assert_array_equal(wiped[:, : middle - 4], other[:, : middle - 4])
        np.testing.assert_array_equal(wiped[:, middle + 4 :], final[:, middle + 4 :])
        compare(page, f"beside {name}")
        left, right = canvas(page, "#beside"), seen(page)
        assert left.shape[1] < 0.55 * final.shape[1]
        assert differs(left, right[: left.shape[0], : left.shape[1]]) > 0.001


@pytest.mark.parametrize("scale", [1, 2])
def test_line_of_the_wipe_is_under_the_pointer(browser, studio, shot, scale):
    with shown(browser, studio.server, device_scale_factor=scale) as page:
        compare(page, "wipe plate")
        page.locator("#show-guides").uncheck()
        frame, slider = (page.locator(name).bounding_box() for name in ("#picture", "#wipe"))
        row = slider["y"] + slider["height"] / 2
        page.mouse.move(frame["x"] + frame["width"] / 2, row)
        page.mouse.down()
        for part in (0.0, 0.02, 0.103, 0.5, 0.777, 0.98, 1.0):
            page.mouse.move(frame["x"] + part * frame["width"], row)
            line = page.locator("#picture").evaluate(LINE_OF_THE_WIPE)
            pixels = frame["width"] * abs(line - part)
            assert pixels < 1.5, (part, line)
        page.mouse.up()


def test_controls_agree_with_the_picture_after_the_browser_goes_back(page):
    final = seen(page)
    page.locator("#hand").check()
    compare(page, "wipe sharp")
    page.locator("#wipe").fill("20")
    page.locator("#show-guides").uncheck()
    view(page, "Plate")
    page.goto("about:blank")
    page.go_back()
    page.wait_for_selector("body[data-kind=rest]", timeout=WAIT_MS)
    assert page.locator("input[name=view]:checked").get_attribute("value") == "final"
    assert page.locator("#compare").input_value() == ""
    assert page.locator("#wipe").input_value() == "50"
    assert page.locator("#wipe").is_hidden() and page.locator("#hand-ends").is_hidden()
    assert not page.locator("#hand").is_checked() and page.locator("#show-guides").is_checked()
    assert page.locator("#move").is_visible()
    np.testing.assert_array_equal(seen(page), final)


def test_region_that_is_drawn_is_the_one_that_the_lens_is_fitted_on(browser, studio, tmp_path):
    shot = studio.reset(lens={})
    with shown(browser, studio.server) as page:
        whole = page.locator("#lens").text_content()
        at_rest(page, lambda: view(page, "Focus"), "focus")
        points = page.locator("#plot path.plane").count()
        assert points > 0
        assert page.locator("#plot .fit").count() == 1

        def at(x, y):
            box = page.locator("#picture").bounding_box()
            return box["x"] + x * box["width"], box["y"] + y * box["height"]

        page.locator("#draw-region").click()
        page.mouse.move(*at(0.1, 0.55))
        page.mouse.down()
        page.mouse.move(*at(0.6, 0.9), steps=4)
        at_rest(page, page.mouse.up, "focus")
        part = page.locator("#lens").text_content()
        assert part != whole
        assert saved(page, shot)["lens"]["fit-region"] == pytest.approx(
            [0.1, 0.55, 0.6, 0.9], abs=2e-3
        )
        at_rest(page, lambda: view(page, "Final"))
        assert page.locator("#lens").text_content() == part
        fit = nlens("fit", shot, tmp_path / "found.json")
        assert fit.returncode == 0, fit.stderr
        slope = json.loads((tmp_path / "found.json").read_text())["slope"]
        assert f"coc_px = {slope:.3g}" in part

        page.locator("#draw-region").click()
        for x, y in ((0.1, 0.6), (0.9, 0.6), (0.5, 0.9)):
            page.mouse.click(*at(x, y))
        at_rest(page, lambda: page.keyboard.press("Enter"))
        assert len(saved(page, shot)["lens"]["fit-region"]) == 6
        page.locator("#draw-region").click()
        page.keyboard.press("Escape")
        assert len(saved(page, shot)["lens"]["fit-region"]) == 6
        at_rest(page, lambda: page.locator("#clear-region").click())
        assert "lens" not in saved(page, shot)
        assert page.locator("#lens").text_content() == whole


def test_region_by_keys_and_one_that_is_wrong(page, shot):
    page.locator("#region").fill("0.2 0.5 0.9 0.95")
    at_rest(page, lambda: page.keyboard.press("Tab"))
    assert saved(page, shot)["lens"]["fit-region"] == [0.2, 0.5, 0.9, 0.95]
    page.locator("#region").fill("0.9, 0.5, 1.2, 0.9")
    page.keyboard.press("Tab")
    page.get_by_text("a region lies in the frame").wait_for()


def test_region_that_is_no_numbers_is_named_as_it_was_typed_and_not_taken(page, shot):
    told = page.locator("#region-wrong")
    for typed, word in (("abc", "abc"), ("0.2, 0.5, x, 0.9", "x")):
        page.locator("#region").fill(typed)
        page.keyboard.press("Tab")
        page.get_by_text(f"{word} is no number; the region is left as it was").wait_for()
        assert "fit-region" not in saved(page, shot)["lens"]
        assert page.locator("#trouble").is_hidden() and told.is_visible()
    page.locator("#region").fill("0.2 0.5 0.9 0.95")
    at_rest(page, lambda: page.keyboard.press("Tab"))
    assert told.is_hidden()
    assert saved(page, shot)["lens"]["fit-region"] == [0.2, 0.5, 0.9, 0.95]


def test_times_of_the_nodes_are_shown_against_the_budget(browser, studio):
    studio.reset(quality={"preset": "standard", "budget-ms": 25})
    with shown(browser, studio.server) as page:
        assert "the budget of a frame is 25 ms" in page.locator("#time-sum").text_content()
        rows = page.locator("#times li").all_text_contents()
        assert len(rows) > 2  # the sum, the nodes below a millisecond, and some above
        times = [float(row.split()[-2]) for row in rows if "once" not in row]
        assert sum(times[1:]) == pytest.approx(times[0], abs=0.6 * len(times))


def test_region_is_closed_by_a_double_click_or_enter_with_an_area_alone(page, shot):
    def at(x, y):
        box = page.locator("#picture").bounding_box()
        return box["x"] + x * box["width"], box["y"] + y * box["height"]

    button = page.locator("#draw-region")
    square = [0.2, 0.6, 0.8, 0.6, 0.8, 0.95, 0.2, 0.95]
    button.click()
    for x, y in ((0.2, 0.6), (0.8, 0.6), (0.8, 0.95)):
        page.mouse.click(*at(x, y))
    at_rest(page, lambda: page.mouse.dblclick(*at(0.2, 0.95)))
    assert saved(page, shot)["lens"]["fit-region"] == pytest.approx(square, abs=3e-3)
    page.locator("#clear-region").focus()
    at_rest(page, lambda: page.keyboard.press("Enter"))
    assert button.evaluate("one => one === document.activeElement")
    page.keyboard.press("Enter")  # begins to draw
    page.mouse.click(*at(0.2, 0.6))
    page.mouse.dblclick(*at(0.8, 0.6))
    assert button.get_attribute("aria-pressed") == "true"  # two corners are no region yet
    assert "fit-region" not in saved(page, shot)["lens"]
    page.mouse.click(*at(0.8, 0.95))
    button.focus()
    at_rest(page, lambda: page.keyboard.press("Enter"))
    assert button.get_attribute("aria-pressed") == "false"
    assert saved(page, shot)["lens"]["fit-region"] == pytest.approx(square[:6], abs=3e-3)
