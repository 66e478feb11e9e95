"""From the pointer's motion to the new picture in the studio's page, in the system's Chromium.

python benchmarks/bench_studio.py [PICTURE.jpg]   # also keeps what the page shows
"""

from __future__ import annotations

import json
import os
import shutil
import statistics
import struct
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
sys.path[:0] = [str(ROOT), str(ROOT / "tests")]
SHOT = """\
version = 1
[plate]
file = "in.mp4"
[object]
file = "object.glb"
[place]
at = [0.55, 0.76]
size = 0.36
yaw = 20
[camera]
horizon = 0.15
[output]
file = "out.mp4"
"""
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


def without_camera(path: Path) -> bytes:
    """A GLB without its cameras."""
    data = path.read_bytes()
    (length,) = struct.unpack_from("<I", data, 12)
    scene = json.loads(data[20 : 20 + length])
    scene.pop("cameras", None)
    for node in scene["nodes"]:
        node.pop("camera", None)
    text = json.dumps(scene).encode()
    text += b" " * (-len(text) % 4)
    rest = data[20 + length :]
    head = struct.pack("<4sIIII", b"glTF", 2, 20 + len(text) + len(rest), len(text), 0x4E4F534A)
    return head + text + rest


def main() -> None:
    """Drag, wait for each picture, print the times."""
    from support.browser import driven
    from support.studio import running

    with tempfile.TemporaryDirectory() as name, driven() as chromium:
        folder = Path(name)
        shutil.copy(ROOT / "samples" / "in.mp4", folder)
        (folder / "object.glb").write_bytes(without_camera(ROOT / "samples" / "anim.glb"))
        (folder / "shot.toml").write_text(SHOT)
        with running(folder / "shot.toml") as server:
            page = chromium.new_page(viewport={"width": 1280, "height": 800})
            page.goto(server.address)
            page.wait_for_selector("body[data-kind=rest]", timeout=WAIT_MS)
            page.wait_for_timeout(2000)  # the strip of pictures
            if len(sys.argv) > 1:
                page.evaluate("document.getElementById('path').textContent = 'shot.toml'")
                page.screenshot(path=sys.argv[1], type="jpeg", quality=85)
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
