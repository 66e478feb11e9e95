"""Keys and places on the studio's page: they are those of the frame that is shown."""

import numpy as np
import pytest
from support import shots
from support.studio import WAIT_MS, opened, shown, write_shot
from support.studio_page import at_rest, canvas, drag, saved

from nlens_video.cameras.solved import CameraKey, SolvedCamera

pytestmark = [pytest.mark.slow, pytest.mark.needs_chromium]

KEYS = [{"frame": 0, "at": [0.3, 0.9]}, {"frame": 3, "at": [0.7, 0.6]}]
LATE = """(() => {
  const Before = window.WebSocket;
  window.WebSocket = class extends Before {
    set onmessage(take) { super.onmessage = (event) => setTimeout(() => take(event), 1000); }
  };
})()"""
DRAWN = """() => {
  window.drawn = [];
  const note = () => window.drawn.push(document.body.dataset.kind);
  new MutationObserver(note).observe(document.body, { attributeFilter: ["data-drawn"] });
}"""


def go_to(page, frame):
    at_rest(page, lambda: page.locator("#frame").fill(str(frame)))


def numbers(page):
    return [float(page.locator(f"#{name}").input_value()) for name in ("at-x", "at-y", "size")]


def click(page, name):
    at_rest(page, lambda: page.locator(name).click())


@pytest.fixture
def keyed(browser, studio):
    """The page of an object that two keys move."""
    studio.reset(object=[{"file": "bare.glb", "size": 0.3, "key": KEYS}], place={})
    with shown(browser, studio.server) as page:
        yield page


def test_size_at_other_keys_stays_when_the_first_one_is_dragged_or_deleted(keyed):
    go_to(keyed, 3)
    before = numbers(keyed)
    go_to(keyed, 0)
    at_rest(keyed, lambda: drag(keyed, keyed.locator("#move"), 0.0, -0.25))
    assert numbers(keyed)[2] == pytest.approx(0.3 * 0.35 / 0.6, rel=0.03)
    go_to(keyed, 3)
    assert numbers(keyed) == pytest.approx(before, rel=0.03)
    click(keyed, "#undo")
    go_to(keyed, 0)
    click(keyed, "#delete-key")
    assert numbers(keyed) == pytest.approx(before, abs=2e-4)


def test_size_stays_when_an_earlier_key_is_set(browser, studio):
    ways = [{**KEYS[0], "frame": 2}, KEYS[1]]
    studio.reset(object=[{"file": "bare.glb", "size": 0.3, "key": ways}], place={})
    with shown(browser, studio.server) as page:
        go_to(page, 3)
        before = numbers(page)
        go_to(page, 1)
        at_rest(page, lambda: drag(page, page.locator("#move"), 0.0, -0.25))
        assert saved(page, studio.shot)["object"][0]["size"] == pytest.approx(0.175, abs=0.005)
        go_to(page, 0)
        click(page, "#set-key")
        go_to(page, 3)
        assert numbers(page) == pytest.approx(before, rel=0.03)


def turned_pose(index):
    """A camera that goes ahead, sideways and turns."""
    angle = np.radians(2.0 * index)
    c, s = np.cos(angle), np.sin(angle)
    pose = shots.camera_pose().copy()
    pose[:3, :3] = np.array([[c, 0, s], [0, 1, 0], [-s, 0, c]]) @ pose[:3, :3]
    pose[:3, 3] += (0.1 * index, 0.0, -0.1 * index)
    return pose


def write_moving_camera(path):
    fov = float(np.degrees(2.0 * np.arctan(0.5 * shots.WIDTH / shots.camera().fx)))
    poses = [np.linalg.inv(turned_pose(index)) for index in range(4)]
    keys = tuple(
        CameraKey(index=index, pts_s=index / 25, world_to_camera=pose, fov_x_deg=fov)
        for index, pose in enumerate(poses)
    )
    path.write_text(SolvedCamera(width=shots.WIDTH, height=shots.HEIGHT, keys=keys).to_json())


def test_keys_and_added_objects_stay_where_they_are_seen_under_a_moving_camera(browser, tmp_path):
    place = {"at": [0.4, 0.7], "size": 0.3, "yaw": 30}
    shot = write_shot(tmp_path, place=place, camera={"camera-from": "cam.json"})
    write_moving_camera(tmp_path / "cam.json")
    with opened(browser, shot) as (page, _):
        go_to(page, 3)
        page.locator("#show-guides").uncheck()
        before, picture = numbers(page), canvas(page, "#picture").astype(int)
        assert before[0] != pytest.approx(0.4, abs=0.02)
        for button in ("#set-key", "#delete-key"):
            click(page, button)
            assert numbers(page) == pytest.approx(before, abs=2e-4), button
            apart = np.abs(canvas(page, "#picture").astype(int) - picture).max(axis=2)
            assert np.quantile(apart, 0.99) < 12, button
            kept = saved(page, shot)["object"][0]
            kept = kept.get("key", [kept])[0]
            assert kept["yaw"] == pytest.approx(30 - 6, abs=0.05)  # the camera has turned by 6
        assert kept["at-frame"] == 3
        page.locator("#show-guides").check()
        at_rest(page, lambda: page.locator("#add-object").select_option("bare.glb"))
        assert numbers(page) == pytest.approx([before[0] + 0.2, *before[1:]], abs=2e-4)
        go_to(page, 0)
        page.locator("#object-0").check()
        assert numbers(page) == pytest.approx([0.4, 0.7, 0.3], abs=2e-3)


def test_key_is_set_where_a_typed_number_has_put_the_object(page, shot):
    page.locator("#at-x").fill("0.7")
    click(page, "#set-key")
    assert saved(page, shot)["object"][0]["key"] == [{"frame": 0, "at": [0.7, 0.8], "yaw": 0}]
    assert numbers(page) == pytest.approx([0.7, 0.8, 0.3], abs=1e-3)


def test_key_set_right_after_a_step_has_the_place_of_its_frame(keyed, studio):
    go_to(keyed, 2)
    there = numbers(keyed)
    go_to(keyed, 0)
    keyed.locator("#frame").fill("2")
    click(keyed, "#set-key")
    key = saved(keyed, studio.shot)["object"][0]["key"][1]
    assert [key["frame"], *key["at"]] == pytest.approx([2, *there[:2]], abs=2e-4)


def test_handle_waits_for_the_picture_after_undo_and_keeps_the_focus(keyed, studio):
    keyed.locator("#move").focus()
    at_rest(keyed, lambda: keyed.keyboard.press("Shift+ArrowRight"))
    keyed.keyboard.press("Control+z")
    keyed.keyboard.press("ArrowLeft")
    keyed.locator("#move").wait_for(timeout=WAIT_MS)
    assert keyed.evaluate("document.activeElement.id") == "move"
    at_rest(keyed, lambda: keyed.keyboard.press("ArrowLeft"))
    key = saved(keyed, studio.shot)["object"][0]["key"][0]
    assert key["at"] == pytest.approx([0.298, 0.9], abs=1e-4)


def test_pictures_that_come_late_do_not_move_the_object_back(keyed):
    keyed.add_init_script(LATE)
    keyed.reload()
    keyed.wait_for_selector("body[data-kind=rest]", timeout=WAIT_MS)
    drag(keyed, keyed.locator("#move"), 0.2, 0.0)
    released = numbers(keyed)
    keyed.evaluate(DRAWN)
    at_rest(keyed, lambda: keyed.wait_for_timeout(1))
    assert numbers(keyed) == pytest.approx(released, abs=1e-3)
    drag(keyed, keyed.locator("#move"), -0.1, 0.0)
    go_to(keyed, 3)
    assert numbers(keyed)[:2] == pytest.approx([0.7, 0.6], abs=1e-3)
    assert set(keyed.evaluate("window.drawn")) == {"rest"}


def test_click_on_a_handle_writes_nothing(browser, tmp_path):
    place = {"at": [0.4, 0.8], "height": "0.4m"}
    shot = write_shot(tmp_path, place=place, camera={"camera-from": "cam.json"})
    shots.camera_json(tmp_path / "cam.json", scale="metres")
    with opened(browser, shot) as (page, _):
        for handle in ("#move", "#scale", "#turn"):
            page.locator(handle).click()
            assert saved(page, shot)["place"] == place
        at_rest(page, lambda: drag(page, page.locator("#move"), 0.1, -0.1))
        moved = saved(page, shot)["place"]
        assert moved == {**place, "at": pytest.approx([0.5, 0.7], abs=5e-3)}


def test_height_in_metres_is_scaled_by_the_handle_where_keys_move_the_object(browser, tmp_path):
    keys = [{"frame": 0, "at": [0.4, 0.8]}, {"frame": 3, "at": [0.6, 0.7]}]
    held = {"file": "bare.glb", "height": "0.4m", "key": keys}
    shot = write_shot(tmp_path, place={}, object=[held], camera={"camera-from": "cam.json"})
    shots.camera_json(tmp_path / "cam.json", scale="metres")
    with opened(browser, shot) as (page, _):
        before = numbers(page)[2]
        at_rest(page, lambda: drag(page, page.locator("#scale"), 0.0, -0.1))
        assert numbers(page)[2] == pytest.approx(before + 0.1, rel=0.05)
        kept = saved(page, shot)["object"][0]
        assert kept == {**held, "height": kept["height"]}
        assert kept["height"].endswith("m") and float(kept["height"][:-1]) > 0.5
