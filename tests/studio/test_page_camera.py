"""Guides of the camera on the studio's page: the horizon, lines of the solve, lines by hand."""

import math

import numpy as np
import pytest
from support import shots
from support.command import nlens
from support.misleading_lines import LINES, PITCH_DEG, angles_deg, plate
from support.studio import opened, shown, write_shot
from support.studio_page import at_rest, drag, saved, seen

pytestmark = [pytest.mark.slow, pytest.mark.needs_chromium]


def at(page, x, y):
    box = page.locator("#picture").bounding_box()
    return box["x"] + x * box["width"], box["y"] + y * box["height"]


def test_horizon_is_dragged_and_by_keys(page, shot):
    before = seen(page)
    at_rest(page, lambda: drag(page, page.locator("#horizon-handle"), 0.0, 0.1))
    assert saved(page, shot)["camera"]["horizon"] == pytest.approx(0.4, abs=0.005)
    assert (seen(page) != before).any()
    row = page.locator("#lines .horizon").get_attribute("y1")
    assert float(row) == pytest.approx(0.4, abs=0.005)
    at_rest(page, lambda: page.locator("#horizon-handle").press("Shift+ArrowUp"))
    assert saved(page, shot)["camera"]["horizon"] == pytest.approx(0.38, abs=0.005)
    at_rest(page, lambda: page.keyboard.press("Control+z"))
    at_rest(page, lambda: page.keyboard.press("Control+z"))
    assert saved(page, shot)["camera"]["horizon"] == 0.3
    np.testing.assert_array_equal(seen(page), before)


def test_horizon_is_rolled_by_its_handle_by_keys_and_by_its_slider(page, shot):
    before, aspect = seen(page), shots.WIDTH / shots.HEIGHT
    at_rest(page, lambda: drag(page, page.locator("#roll-handle"), 0.0, 0.05))
    camera = saved(page, shot)["camera"]
    roll = math.degrees(math.atan(0.05 / (0.2 * aspect)))
    assert camera == {"horizon": 0.3, "roll": pytest.approx(roll, abs=0.5)}
    assert (seen(page) != before).any()
    line = page.locator("#lines .horizon")
    left, right = (float(line.get_attribute(name)) for name in ("y1", "y2"))
    assert (left + right) / 2 == pytest.approx(0.3, abs=2e-3)
    assert right - left == pytest.approx(aspect * math.tan(math.radians(roll)), abs=0.02)
    at_rest(page, lambda: page.locator("#roll-handle").press("ArrowUp"))
    assert saved(page, shot)["camera"]["roll"] < camera["roll"]
    at_rest(page, lambda: page.locator("#roll").press("Home"))
    assert saved(page, shot)["camera"]["roll"] == -45
    for _ in range(3):
        at_rest(page, lambda: page.keyboard.press("Control+z"))
    assert saved(page, shot)["camera"] == {"horizon": 0.3}
    np.testing.assert_array_equal(seen(page), before)


def test_lines_that_are_left_out_are_left_out_of_the_solve(browser, tmp_path):
    shot = write_shot(
        tmp_path, frames=1, plate={"file": "in.png"}, camera={}, place={}, lens={},
        effects={"effects": "none"}, output={"file": "out.png"},
    )  # fmt: skip
    shots.write_png(tmp_path / "in.png", plate())
    with opened(browser, shot) as (page, _):
        page.locator("#show-found").check()
        found = page.locator("#lines .found").count()
        assert found > 50
        # one by a click; again, and it is taken
        middles = [((x0 + x1) / 2, (y0 + y1) / 2) for x0, y0, x1, y1 in LINES]
        hit = next(
            middle for middle in middles
            if page.evaluate("([x, y]) => document.elementFromPoint(x, y)?.parentElement"
                             "?.classList.contains('found')", list(at(page, *middle)))
        )  # fmt: skip
        at_rest(page, lambda: page.mouse.click(*at(page, *hit)))
        assert len(saved(page, shot)["camera"]["ignore-lines"]) == 4
        at_rest(page, lambda: page.locator("#all-lines").click())
        assert page.evaluate("document.activeElement.id") == "show-found"  # not lost with it
        assert "camera" not in saved(page, shot)
        # one by keys
        page.locator("#line").focus()
        page.keyboard.press("ArrowDown")
        assert page.locator("#lines .chosen").count() == 1
        assert page.locator("#line option:checked").text_content().startswith("1 ")
        page.locator("#toggle-line").focus()
        at_rest(page, lambda: page.keyboard.press("Enter"))
        assert len(saved(page, shot)["camera"]["ignore-lines"]) == 4
        assert page.locator("#lines .chosen.left-out").count() == 1
        assert page.locator("#toggle-line").text_content() == "Take again"
        # those of the direction that misleads
        named = page.locator("#lines .found:has(.seen)").evaluate_all(
            "all => all.map(one => [one.classList[1], ...['x1', 'y1', 'x2', 'y2'].map("
            "key => Number(one.lastChild.getAttribute(key)))])"
        )
        steep = [name for name, x0, y0, x1, y1 in named if abs(y1 - y0) > 0.8]
        wrong = max(set(steep), key=steep.count)
        number = {"upright": "0"}.get(wrong, wrong.removeprefix("level-"))
        at_rest(page, lambda: page.locator(f"#direction-{number}").click())
        ignored = saved(page, shot)["camera"]["ignore-lines"]
        assert len(ignored) >= 4 * len(LINES) // 2
        assert page.locator("#lines .left-out").count() == len(ignored) // 4
        row = float(page.locator("#lines .horizon").get_attribute("y1"))
    camera = tmp_path / "camera.json"
    listed = ",".join(map(str, ignored))
    assert nlens("solve", tmp_path / "in.png", camera, f"--ignore-lines={listed}").returncode == 0
    pitch, _, fov = angles_deg(camera)
    assert pitch == pytest.approx(PITCH_DEG, abs=5.0)
    height, width = plate().shape[:2]
    half = math.tan(math.radians(fov) / 2) * height / width
    level = 0.5 + 0.5 * math.tan(math.radians(pitch)) / half
    assert row == pytest.approx(level, abs=0.05)


def test_two_pairs_of_lines_by_hand_set_horizon_and_field_of_view(page, shot):
    horizon, fov, aspect = 0.25, 50.0, shots.WIDTH / shots.HEIGHT
    focal, down = 0.5 / math.tan(math.radians(fov / 2)), (horizon - 0.5) / aspect
    right = 0.9
    left = -(focal**2 + down**2) / right
    ways = [((0.3, 0.95), 0.5 + right), ((0.1, 0.8), 0.5 + right),
            ((0.9, 0.95), 0.5 + left), ((0.8, 0.7), 0.5 + left)]  # fmt: skip
    page.locator("#hand").check()
    ends = page.locator("#hand-ends button")
    for line, ((x, y), far) in enumerate(ways):
        share = 0.45 / abs(far - x)
        for end, place in enumerate([(x, y), (x + share * (far - x), y + share * (horizon - y))]):
            handle = ends.nth(2 * line + end)
            box = handle.bounding_box()
            page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
            page.mouse.down()
            page.mouse.move(*at(page, *place), steps=3)
            if (line, end) == (3, 1):
                at_rest(page, page.mouse.up)
            else:
                page.mouse.up()
    camera = saved(page, shot)["camera"]
    assert camera["horizon"] == pytest.approx(horizon, abs=0.01)
    assert camera["fov"] == pytest.approx(fov, abs=1.5)
    assert camera.get("roll", 0.0) == pytest.approx(0.0, abs=0.5)
    at_rest(page, lambda: page.locator("#own-horizon").uncheck())
    assert "camera" not in saved(page, shot)


def test_slider_of_the_horizon_keeps_the_roll_and_that_of_the_roll_the_horizon(browser, studio):
    given = {"horizon": 0.3034, "roll": 1.23}
    shot = studio.reset(camera=given)
    with shown(browser, studio.server) as page:
        at_rest(page, lambda: page.locator("#roll").press("ArrowRight"))
        assert saved(page, shot)["camera"] == {"horizon": 0.3034, "roll": 1.5}
        at_rest(page, lambda: page.locator("#undo").click())
        at_rest(page, lambda: page.locator("#horizon").press("ArrowRight"))
        assert saved(page, shot)["camera"] == {"horizon": 0.31, "roll": 1.23}


def test_end_of_a_line_by_hand_that_is_grabbed_beside_its_middle_does_not_jump(page):
    page.locator("#hand").check()
    end = page.locator("#hand-ends button").first
    before = end.bounding_box()
    page.mouse.move(before["x"] + 4, before["y"] + 12)
    page.mouse.down()
    page.mouse.move(before["x"] + 9, before["y"] + 15)
    after = end.bounding_box()
    page.mouse.up()
    assert after["x"] - before["x"] == pytest.approx(5, abs=0.1)
    assert after["y"] - before["y"] == pytest.approx(3, abs=0.1)
