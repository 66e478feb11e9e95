"""Pages in headless Chromium: what a script found in them, a print of them, or driven by hand."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from html import unescape
from pathlib import Path

from support.folders import TESTS

NODE_PACKAGES = TESTS / "studio" / "node_modules"
_NAMES = ("chromium", "chromium-browser", "google-chrome")


def browser_path() -> str | None:
    """The browser's program, None where there is none."""
    return next((path for name in _NAMES if (path := shutil.which(name))), None)


@contextmanager
def driven() -> Iterator[object]:
    """A browser that Playwright drives."""
    from playwright.sync_api import sync_playwright

    with sync_playwright() as playwright:
        with launched(playwright.chromium) as started:
            yield started


@contextmanager
def launched(kind: object, *arguments: str) -> Iterator[object]:
    """A browser of a kind that Playwright knows, with more arguments of its command line."""
    started = kind.launch(executable_path=browser_path(), args=["--no-sandbox", *arguments])
    yield started
    started.close()


def chromium(folder: Path, *arguments: str) -> str:
    """Run Chromium on local files, with a profile in `folder` and without a network."""
    return subprocess.run(
        [browser_path(), "--headless", "--no-sandbox", "--disable-gpu",
         "--allow-file-access-from-files", "--proxy-server=127.0.0.1:9",
         f"--user-data-dir={folder / 'profile'}", "--virtual-time-budget=20000", *arguments],
        capture_output=True, text=True, timeout=120, check=True,
    ).stdout  # fmt: skip


def seen(page: Path, *arguments: str) -> dict:
    """The JSON that the script of a page leaves in the attribute `data-seen` of its body."""
    dumped = chromium(page.parent, *arguments, "--dump-dom", page.as_uri())
    return json.loads(unescape(re.search(r'data-seen="([^"]*)"', dumped).group(1)))
