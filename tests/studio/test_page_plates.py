"""Plates as people have them: large, odd-sized, deep, turned by a phone, a still picture."""

import contextlib

import av
import cv2
import numpy as np
import pytest
from support import shots
from support.clips import write_clip
from support.studio import changed_middle, opened, write_shot
from support.studio_page import at_rest, drag, plate_seen, saved, seen

from nlens_video.video.input.seek import open_seekable

pytestmark = [pytest.mark.slow, pytest.mark.needs_chromium]


def large(folder):
    rgb = cv2.resize(shots.plate(), (3840, 2160), interpolation=cv2.INTER_LINEAR)
    return shots.write_video(folder / "in.mp4", frames=2, rgb=rgb, audio=False)


def odd(folder):
    return shots.write_png(folder / "in.png", shots.plate()[:-1, :-1])


def deep(folder):
    return shots.write_video(folder / "in.mp4", codec="libx265", pix_fmt="yuv420p10le", frames=3)


def turned(folder):
    """As telephones write them: the samples lie on their side, and the display turns them."""
    lying = np.ascontiguousarray(np.rot90(shots.plate(), -1))
    frames = [av.VideoFrame.from_ndarray(lying, "rgb24").reformat(
        format="yuv420p", dst_colorspace="ITU709", dst_color_range="MPEG") for _ in range(3)
    ]  # fmt: skip
    return write_clip(folder / "in.mp4", frames, codec="libx264", rotation=90)


def still(folder):
    return shots.write_png(folder / "in.jpg", shots.plate())


@pytest.mark.parametrize("write", [large, odd, deep, turned, still])
def test_object_is_dragged_and_rendered_on(browser, tmp_path, write):
    name = "in.png" if write is odd else "in.jpg" if write is still else "in.mp4"
    result, lens = f"out{name[2:]}", {"fallback": "constant"}
    shot = write_shot(tmp_path, plate={"file": name}, output={"file": result}, lens=lens)
    write(tmp_path)
    with opened(browser, shot) as (page, server):
        assert page.locator("#reduced").is_visible() == (write is large)
        box = page.locator("#stage").bounding_box()
        assert box["width"] / box["height"] == pytest.approx(shots.WIDTH / shots.HEIGHT, rel=0.02)
        bare, before = plate_seen(page), seen(page)
        at_rest(page, lambda: drag(page, page.locator("#move"), 0.2, 0.0))
        shown = seen(page)
        way = changed_middle(shown, bare)[0] - changed_middle(before, bare)[0]
        assert way == pytest.approx(0.2, abs=0.03)
        saved(page, shot)
        page.locator("#render").click()
        page.wait_for_selector("body[data-render=done], body[data-render=failed]", timeout=120_000)
        assert "failed" not in page.locator("#rendered").text_content()
        assert page.locator("body").get_attribute("data-render") == "done"
        single = write in (odd, still)
        assert page.locator("#film").is_hidden() == single
        if write is not deep:  # no browser here plays H.265
            page.locator("#result-picture" if single else "#result").wait_for()
    with contextlib.closing(open_seekable(str(tmp_path / result))) as rendered:
        first = 255.0 * next(iter(rendered)).picture.shown()[..., ::-1]
    small = cv2.resize(first, shown.shape[1::-1], interpolation=cv2.INTER_AREA)
    assert np.abs(small - shown)[20:-20, 20:-20].mean() < 6.0
