"""What presses, clicks, fingers and the wheel do on the studio's picture."""

import shutil

import pytest
from support.folders import ROOT
from support.studio import opened, shown
from support.studio_page import at_rest, drag, saved, view

pytestmark = [pytest.mark.slow, pytest.mark.needs_chromium]
SAVED = "· saved"


def middle(handle):
    box = handle.bounding_box()
    return box["x"] + box["width"] / 2, box["y"] + box["height"] / 2


def test_click_on_a_handle_changes_nothing_and_gives_it_the_keys(browser, studio):
    sun = [59.6, 40.3, 2]
    studio.reset(light={"sun": sun}, camera={"horizon": 0.2034, "roll": 1.23})
    with shown(browser, studio.server) as page:
        page.locator("#hand").check()
        handles = ["move", "scale", "turn", "horizon-handle", "roll-handle", "sun-handle",
                   "shadow-tip"]  # fmt: skip
        ends = page.locator("#hand-ends button").all()
        for handle in (*(page.locator(f"#{name}") for name in handles), *ends):
            page.mouse.click(*middle(handle))
            assert handle.evaluate("one => one === document.activeElement")
        page.mouse.click(*middle(page.locator("#grip")))
        assert page.locator("#saved").text_content() == SAVED
        assert page.locator("#undo").is_disabled()
        x, y = middle(page.locator("#sky"))
        left = 0.2 * page.locator("#sky").bounding_box()["width"]
        at_rest(page, lambda: page.mouse.click(x - left, y))
        assert saved(page, studio.shot)["light"]["sun"] == pytest.approx([-90, 54, 2], abs=2)
        at_rest(page, lambda: page.locator("#undo").click())
        assert saved(page, studio.shot)["light"]["sun"] == sun


def test_click_on_the_horizon_keeps_the_camera_of_the_file(browser, tmp_path):
    for name in ("in.mp4", "anim.glb", "in.json"):
        shutil.copy(ROOT / "samples" / name, tmp_path / name)
    shot = tmp_path / "shot.toml"
    shot.write_text(
        'version = 1\n[plate]\nfile = "in.mp4"\n[object]\nfile = "anim.glb"\n[lens]\n'
        'fit = "in.json"\n[quality]\npreset = "draft"\n[output]\nfile = "out.mp4"\n'
    )
    with opened(browser, shot) as (page, _):
        page.mouse.click(*middle(page.locator("#horizon-handle")))
        assert page.locator("#saved").text_content() == SAVED
        assert page.locator("#of-file").is_visible()


def test_wheel_moves_the_object_only_where_it_is_shown_as_movable(page, shot):
    before = saved(page, shot)["place"]

    def rolled():
        page.mouse.move(*middle(page.locator("#picture")))
        page.mouse.wheel(0, 100)

    view(page, "Plate")
    rolled()
    assert saved(page, shot)["place"] == before
    at_rest(page, lambda: view(page, "Focus"), "focus")
    rolled()
    assert saved(page, shot)["place"] == before
    at_rest(page, lambda: view(page, "Final"))
    page.locator("#show-guides").uncheck()
    rolled()
    assert saved(page, shot)["place"] == before
    page.locator("#show-guides").check()
    page.locator("#draw-region").click()
    rolled()
    assert saved(page, shot)["place"] == before
    page.keyboard.press("Escape")
    at_rest(page, rolled)
    assert saved(page, shot)["place"] != before


def test_second_finger_leaves_the_drag_of_the_first_as_it_is(browser, studio, shot):
    with shown(browser, studio.server, has_touch=True) as page:
        hand = page.context.new_cdp_session(page)
        width = page.locator("#picture").bounding_box()["width"]
        box, (_, y) = page.locator("#grip").bounding_box(), middle(page.locator("#grip"))
        first, second = (box["x"] + part * box["width"] for part in (0.3, 0.7))

        def touch(kind, **fingers):
            points = [{"x": x, "y": y, "id": int(name[1:])} for name, x in fingers.items()]
            hand.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})
            page.wait_for_timeout(100)  # motions of fingers wait for the next frame

        def is_moved_by(way):
            where = float(page.locator("#at-x").input_value())
            return where == pytest.approx(0.4 + way / width, abs=1e-3)

        touch("touchStart", f0=first)
        touch("touchMove", f0=first + 20)
        assert is_moved_by(20)
        touch("touchStart", f0=first + 20, f1=second)
        touch("touchMove", f0=first + 20, f1=second + 9)
        assert is_moved_by(20)
        touch("touchMove", f0=first + 60)  # a finger that is not named is lifted
        assert is_moved_by(60)
        at_rest(page, lambda: touch("touchEnd"))
        at = saved(page, shot)["place"]["at"]
        assert at == pytest.approx([0.4 + 60 / width, 0.8], abs=1e-3)
        at_rest(page, lambda: page.locator("#undo").click())
        assert saved(page, shot)["place"]["at"] == [0.4, 0.8]
        at_rest(page, lambda: drag(page, page.locator("#scale"), 0.0, -0.1))
        assert saved(page, shot)["place"]["size"] > 0.35
