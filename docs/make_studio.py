"""Make docs/studio.jpg and docs/studio-focus.jpg: the studio's page in the system's Chromium.

python docs/make_studio.py
"""

from __future__ import annotations

import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "tests")]
SIZE = {"width": 1280, "height": 800}
WAIT_MS = 300_000
CORNERS = ((0.08, 0.72), (0.3, 0.5), (0.72, 0.5), (0.8, 0.72), (0.72, 0.95), (0.2, 0.95))
"""Of the region that is drawn: tiles, without the cup and the fruit."""


def main() -> None:
    """Open the page of the sample's shot, and keep what it shows."""
    from support.browser import driven
    from support.studio import running
    from support.studio_demo import demo_shot

    with tempfile.TemporaryDirectory() as name, driven() as chromium:
        with running(demo_shot(Path(name))) as server:
            page = chromium.new_page(viewport=SIZE, color_scheme="light")
            page.goto(server.address)
            page.wait_for_selector("body[data-kind=rest]", timeout=WAIT_MS)
            page.evaluate("document.getElementById('path').textContent = 'shot.toml'")
            page.wait_for_timeout(2000)  # the strip of pictures
            page.screenshot(path=ROOT / "docs" / "studio.jpg", type="jpeg", quality=85)
            page.locator(".views").get_by_text("Focus", exact=True).click()
            page.wait_for_selector("body[data-kind=focus]", timeout=WAIT_MS)
            page.locator("#draw-region").click()
            frame = page.locator("#picture").bounding_box()
            for x, y in CORNERS:
                page.mouse.click(frame["x"] + x * frame["width"], frame["y"] + y * frame["height"])
            before = page.evaluate("document.body.dataset.drawn")
            page.keyboard.press("Enter")
            page.wait_for_selector(f"body:not([data-drawn='{before}'])", timeout=WAIT_MS)
            page.set_viewport_size({"width": 1280, "height": 1180})
            page.evaluate("window.scrollTo(0, 0)")
            page.screenshot(path=ROOT / "docs" / "studio-focus.jpg", type="jpeg", quality=85)
    print("Look at docs/studio.jpg and docs/studio-focus.jpg")


if __name__ == "__main__":
    main()
