"""Pages in headless Chromium: what a script found in them, or a print of them."""

from __future__ import annotations

import json
import re
import shutil
import subprocess
from html import unescape
from pathlib import Path


def chromium(folder: Path, *arguments: str) -> str:
    """Run Chromium on local files, with a profile in `folder` and without a network."""
    return subprocess.run(
        [shutil.which("chromium"), "--headless", "--no-sandbox", "--disable-gpu",
         "--allow-file-access-from-files", "--proxy-server=127.0.0.1:9",
         f"--user-data-dir={folder / 'profile'}", "--virtual-time-budget=20000", *arguments],
        capture_output=True, text=True, timeout=120, check=True,
    ).stdout  # fmt: skip


def seen(page: Path, *arguments: str) -> dict:
    """The JSON that the script of a page leaves in the attribute `data-seen` of its body."""
    dumped = chromium(page.parent, *arguments, "--dump-dom", page.as_uri())
    return json.loads(unescape(re.search(r'data-seen="([^"]*)"', dumped).group(1)))
