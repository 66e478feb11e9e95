"""Several objects and keys on the studio's page: what is clicked is what the shot file says."""

import shutil

import numpy as np
import pytest
from support.command import nlens
from support.studio import WAIT_MS, shown
from support.studio_page import at_rest, drag, plate_seen, saved, seen

pytestmark = [pytest.mark.slow, pytest.mark.needs_chromium]


@pytest.fixture
def page(browser, studio, shot):
    shutil.copy(shot.parent / "bare.glb", shot.parent / "other.glb")
    with shown(browser, studio.server) as page:
        yield page


def go_to(page, frame):
    at_rest(page, lambda: page.locator("#frame").fill(str(frame)))


def test_objects_are_added_reordered_and_removed(page, shot):
    plate, before = plate_seen(page), seen(page)
    at_rest(page, lambda: page.locator("#add-object").select_option("other.glb"))
    after = seen(page)

    def columns(picture):
        return np.flatnonzero((np.abs(picture.astype(int) - plate).max(axis=2) > 40).any(axis=0))

    assert len(columns(after)) > 1.5 * len(columns(before))
    kept = saved(page, shot)
    assert kept["version"] == 2 and "place" not in kept
    assert [one["file"] for one in kept["object"]] == ["bare.glb", "other.glb"]
    assert kept["object"][1]["at"] == pytest.approx([0.6, 0.8], abs=1e-3)
    assert page.locator("#object-1").is_checked()
    at_rest(page, lambda: drag(page, page.locator("#move"), 0.1, 0.05))
    moved = saved(page, shot)["object"]
    assert moved[1]["at"] == pytest.approx([0.7, 0.85], abs=5e-3)
    assert moved[0] == kept["object"][0]
    at_rest(page, lambda: page.locator("#earlier").click())
    assert [one["file"] for one in saved(page, shot)["object"]] == ["other.glb", "bare.glb"]
    at_rest(page, lambda: page.locator("#remove-object").click())
    assert [one["file"] for one in saved(page, shot)["object"]] == ["bare.glb"]
    assert np.abs(seen(page).astype(int) - before).max() < 60
    at_rest(page, lambda: page.locator("#undo").click())
    assert page.locator("#objects input").count() == 2


def test_keys_are_set_by_moving_and_drawn_as_a_way_and_deleted(page, shot):
    page.locator("#set-key").click()
    page.locator("#key-0").wait_for()
    go_to(page, 3)
    assert page.locator("#delete-key").is_disabled()
    at_rest(page, lambda: drag(page, page.locator("#move"), 0.3, 0.0))
    kept = saved(page, shot)["object"][0]
    assert [key["frame"] for key in kept["key"]] == [0, 3]
    assert kept["key"][0]["at"] == pytest.approx([0.4, 0.8], abs=1e-3)
    assert kept["key"][1]["at"] == pytest.approx([0.7, 0.8], abs=5e-3)
    assert "at" not in kept and kept["size"] == pytest.approx(0.3)
    way = page.locator("#drawn polyline.way:not(.stop)")
    points = [tuple(map(float, one.split(","))) for one in way.get_attribute("points").split()]
    assert points[0] == pytest.approx((0.4, 0.8), abs=1e-3)
    assert points[-1] == pytest.approx((0.7, 0.8), abs=5e-3)
    assert page.locator("#drawn .stop").count() == 2
    run = nlens(shot, "-q", "-y")
    assert run.returncode == 0, run.stderr
    page.locator("#key-0").focus()
    at_rest(page, lambda: page.keyboard.press("Enter"))
    assert page.locator("#frame-number").text_content() == "0"
    page.locator("#delete-key").focus()
    at_rest(page, lambda: page.keyboard.press("Enter"))
    assert [key["frame"] for key in saved(page, shot)["object"][0]["key"]] == [3]


def test_shot_of_several_objects_opens_with_its_keys(browser, studio):
    keys = [{"time": 0, "at": [0.2, 0.8]}, {"time": 0.12, "at": [0.8, 0.8]}]
    listed = [
        {"file": "bare.glb", "at": [0.4, 0.8], "size": 0.3},
        {"file": "bare.glb", "size": 0.2, "key": keys},
    ]
    shot = studio.reset(object=listed, place={})
    with shown(browser, studio.server) as page:
        page.locator("#object-1").check()
        page.locator("#key-1").wait_for(timeout=WAIT_MS)
        assert page.locator("#key-1").text_content() == "Frame 3: place"
        at_rest(page, lambda: page.locator("#key-1").click())
        box, frame = (page.locator(one).bounding_box() for one in ("#move", "#picture"))
        x = (box["x"] + box["width"] / 2 - frame["x"]) / frame["width"]
        assert x == pytest.approx(0.8, abs=0.01)
        at_rest(page, lambda: page.locator("#interpolation").select_option("linear"))
        assert saved(page, shot)["object"][1]["interpolation"] == "linear"
