"""From the pointer's motion to the new picture in the studio's page, in the system's Chromium.

python benchmarks/bench_studio.py
"""

from __future__ import annotations

import os
import statistics
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT), str(ROOT / "tests")]
DRAGS, STEP_PX = 60, 3
WAIT_MS = 300_000
# the time of each motion is kept until a picture that was asked for after it is drawn
WATCH = """() => {
  window.waits = [];
  let moved = null;
  document.getElementById("move").addEventListener("pointermove", () => { moved ??= performance.now(); });
  new MutationObserver(() => {
    if (moved !== null) window.waits.push(performance.now() - moved);
    moved = null;
  }).observe(document.body, { attributeFilter: ["data-drawn"] });
}"""  # noqa: E501


def main() -> None:
    """Drag, wait for each picture, print the times."""
    from support.browser import driven
    from support.studio import running
    from support.studio_demo import demo_shot

    with tempfile.TemporaryDirectory() as name, driven() as chromium:
        with running(demo_shot(Path(name))) as server:
            page = chromium.new_page(viewport={"width": 1280, "height": 800})
            page.goto(server.address)
            page.wait_for_selector("body[data-kind=rest]", timeout=WAIT_MS)
            page.wait_for_timeout(2000)  # the strip of pictures
            page.evaluate(WATCH)
            box = page.locator("#move").bounding_box()
            assert box is not None
            x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
            page.mouse.move(x, y)
            page.mouse.down()
            for number in range(1, DRAGS + 1):
                before = page.evaluate("window.waits.length")
                page.mouse.move(x - STEP_PX * number, y)
                while page.evaluate("window.waits.length") == before:
                    page.wait_for_timeout(2)
            waits = sorted(page.evaluate("window.waits")[2:])
    median, late = statistics.median(waits), waits[int(0.95 * len(waits))]
    print(f"drag to picture: median {median:.0f} ms, 95th percentile {late:.0f} ms")
    print(f"{os.cpu_count()} processors, load average {os.getloadavg()[0]:.1f}")


if __name__ == "__main__":
    main()
