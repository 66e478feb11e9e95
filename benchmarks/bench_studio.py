"""The studio: to its first page, from the pointer's motion to the new picture, memory of a scrub.

python benchmarks/bench_studio.py
"""

from __future__ import annotations

import json
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from playwright.sync_api import Page
    from support.studio import Server

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT), str(ROOT / "tests")]
DRAGS, STEP_PX = 60, 3
LONG = 21  # times that the demo's plate is repeated for the scrub
SCRUBS, APART = (60, 60, 60, 60), 397  # requests of frames, and how far from one to the next
WAIT_MS, LEAST_PX = 300_000, 400  # columns of a canvas on which something is drawn
# the time of each motion is kept until a picture that was asked for after it is drawn
WATCH = """(id) => {
  window.waits = [];
  let moved = null;
  document.getElementById(id).addEventListener("pointermove", () => {
    moved ??= performance.now();
  });
  new MutationObserver(() => {
    if (moved !== null) window.waits.push(performance.now() - moved);
    moved = null;
  }).observe(document.body, { attributeFilter: ["data-drawn"] });
}"""


def main() -> None:
    """Open the page, drag object and sun, scrub; print times and memory."""
    from support.browser import driven
    from support.studio import running
    from support.studio_demo import demo_shot

    with tempfile.TemporaryDirectory() as name, driven() as chromium:
        shot = demo_shot(Path(name))
        shot.write_text(shot.read_text() + "[light]\nsun = [60, 40, 2]\n")
        with running(shot) as server:
            page = chromium.new_page(viewport={"width": 1280, "height": 800})
            first_page(page, server)
            page.wait_for_selector("body[data-kind=rest]", timeout=WAIT_MS)
            page.wait_for_timeout(2000)  # the strip of pictures
            drag(page, "move", -STEP_PX)
            drag(page, "shadow-tip", STEP_PX)
        subprocess.run(
            ["ffmpeg", "-v", "error", "-stream_loop", str(LONG - 1), "-i", ROOT / "samples/in.mp4",
             "-c", "copy", "-y", Path(name) / "in.mp4"], check=True,
        )  # fmt: skip
        with running(shot) as server:
            scrub(server)
    print(f"{os.cpu_count()} processors, load average {os.getloadavg()[0]:.1f}")


def first_page(page: Page, server: Server) -> None:
    """To the plate in the page, with the browser's start behind it."""
    before, started = processor_s(server), time.perf_counter()
    page.goto(server.address)
    while page.evaluate("document.getElementById('picture').width") < LEAST_PX:
        page.wait_for_timeout(2)
    spent = time.perf_counter() - started
    print(f"first page: {spent:.2f} s, {processor_s(server) - before:.2f} s of processor time")


def drag(page: Page, handle: str, step_px: int) -> None:
    """From a handle's motion to the picture that was asked for after it."""
    page.evaluate(WATCH, handle)
    box = page.locator(f"#{handle}").bounding_box()
    assert box is not None
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    for number in range(1, DRAGS + 1):
        before = page.evaluate("window.waits.length")
        page.mouse.move(x + step_px * number, y)
        while page.evaluate("window.waits.length") == before:
            page.wait_for_timeout(2)
    waits = sorted(page.evaluate("window.waits")[2:])
    page.mouse.up()
    median, late = statistics.median(waits), waits[int(0.95 * len(waits))]
    print(f"drag of {handle}: median {median:.0f} ms, 95th percentile {late:.0f} ms")


def scrub(server: Server) -> None:
    """Frames of a long plate, far from each other."""
    frames, number = json.loads(server.get("/shot")[1])["plate"]["frames"], 0
    print(f"scrub through {frames} frames: {resident_mb(server):.0f} MB before")
    for many in SCRUBS:
        for _ in range(many):
            number = (number + APART) % frames
            assert server.get(f"/frame/{number}")[0] == 200
        print(f"  {resident_mb(server):.0f} MB after {many} more")


def processor_s(server: Server) -> float:
    """Processor time of the server so far [s]."""
    fields = Path(f"/proc/{server.process.pid}/stat").read_text().rsplit(")", 1)[1].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


def resident_mb(server: Server) -> float:
    """Memory of the server."""
    pages = int(Path(f"/proc/{server.process.pid}/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


if __name__ == "__main__":
    main()
