"""The pictures of the studio's page that its documents show."""

from __future__ import annotations

import tempfile
from pathlib import Path

import cv2
import numpy as np
from support.studio import WAIT_MS, running
from support.studio_demo import demo_shot
from support.studio_page import at_rest, view

WIDE = {"width": 1280, "height": 800}
HIGH = {"width": 1280, "height": 1280}
CORNERS = ((0.08, 0.72), (0.3, 0.5), (0.72, 0.5), (0.8, 0.72), (0.72, 0.95), (0.2, 0.95))
"""Of the region that is drawn: tiles, without the cup and the fruit."""
BLOCK_PX, APART_LEVELS = 16, 8
"""What is compared: mean levels of blocks, so that how letters are smoothed means nothing."""


def draw(browser: object, folder: Path) -> list[Path]:
    """Write `studio.jpg` and `studio-focus.jpg` to a folder: the page of the sample's shot."""
    whole, focus = folder / "studio.jpg", folder / "studio-focus.jpg"
    with tempfile.TemporaryDirectory() as name, running(demo_shot(Path(name))) as server:
        page = browser.new_page(viewport=WIDE, color_scheme="light")
        page.goto(server.address)
        page.wait_for_selector("body[data-kind=rest]", timeout=WAIT_MS)
        page.evaluate("document.getElementById('path').textContent = 'shot.toml'")
        strip = page.locator("#thumbnails img")
        strip.evaluate_all("all => Promise.all(all.map(one => one.decode()))")
        page.screenshot(path=whole, type="jpeg", quality=85)
        at_rest(page, lambda: view(page, "Focus"), "focus")
        page.locator("#draw-region").click()
        page.locator("#stage").scroll_into_view_if_needed()
        frame = page.locator("#picture").bounding_box()
        for x, y in CORNERS:
            page.mouse.click(frame["x"] + x * frame["width"], frame["y"] + y * frame["height"])
        at_rest(page, lambda: page.keyboard.press("Enter"), "focus")
        page.set_viewport_size(HIGH)
        page.locator("aside").evaluate("one => one.scrollTo(0, 0)")
        page.screenshot(path=focus, type="jpeg", quality=85)
        page.close(run_before_unload=False)
    return [whole, focus]


def difference(one: Path, other: Path) -> float:
    """Share of the blocks of two pictures of a size that look otherwise, 0 to 1."""
    first, second = (blocks(path) for path in (one, other))
    assert first.shape == second.shape, (first.shape, second.shape)
    return float((np.abs(first - second).max(axis=2) > APART_LEVELS).mean())


def blocks(path: Path) -> np.ndarray:
    """Mean levels of the blocks of a picture (H, W, 3), 0 to 255."""
    picture = cv2.imread(str(path)).astype(np.float32)
    height, width = (size // BLOCK_PX for size in picture.shape[:2])
    return cv2.resize(picture, (width, height), interpolation=cv2.INTER_AREA)
