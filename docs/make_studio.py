"""Make docs/studio.jpg and docs/studio-focus.jpg: the studio's page in the system's Chromium.

tests/studio/test_pictures.py makes them too, and fails where the page has come to look otherwise.

python docs/make_studio.py
"""

from __future__ import annotations

import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "tests")]


def main() -> None:
    """Draw them into this folder."""
    from support.browser import driven
    from support.studio_pictures import draw

    with driven() as browser:
        made = draw(browser, ROOT / "docs")
    print("Look at", *(path.relative_to(ROOT) for path in made))


if __name__ == "__main__":
    main()
