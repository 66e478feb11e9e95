"""Pages of the site that live beside their code: README, model cards, changes, contributing.

A hook of mkdocs. Links are written for who reads the repository; here they are turned to the
site's own pages, and code is named without a link, because the site holds none.
"""

from __future__ import annotations

import posixpath
import re
from pathlib import Path

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

ROOT = Path(__file__).parents[1]
PAGES = {
    "README.md": "index.md",
    "models/coc/README.md": "models/coc.md",
    "models/lens/README.md": "models/lens.md",
    "models/reblur/README.md": "models/reblur.md",
    "models/camera/README.md": "models/camera.md",
    "models/sun/README.md": "models/sun.md",
    "models/paper/README.md": "models/paper.md",
    "benchmarks/README.md": "benchmarks.md",
    "CHANGELOG.md": "changes.md",
    "CONTRIBUTING.md": "contributing.md",
    "SECURITY.md": "security.md",
}
"""Path in the repository to path in the site."""

_LINK = re.compile(r"(\]\()([^)#:]+)(#[^)]*)?\)")
_LINKED = re.compile(r"(!?)\[([^\]]*)\]\(([^)#:]+)(#[^)]*)?\)")


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages, and the pictures that they show."""
    for source, page in PAGES.items():
        files.append(File.generated(config, page, abs_src_path=str(ROOT / source)))
    for source in PAGES:
        for _, target, _ in _LINK.findall((ROOT / source).read_text()):
            picture = posixpath.normpath(posixpath.join(posixpath.dirname(source), target))
            if picture.endswith((".png", ".jpg")) and not picture.startswith("docs/"):
                files.append(File.generated(config, picture, abs_src_path=str(ROOT / picture)))
    return files


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Turn links of the repository into links of the site."""
    here = page.file.src_uri
    source = {site: source for source, site in PAGES.items()}.get(here, f"docs/{here}")

    def turned(match: re.Match[str]) -> str:
        picture, words, target, anchor = match.groups()
        if target.startswith("http"):
            return match[0]
        path = posixpath.normpath(posixpath.join(posixpath.dirname(source), target))
        found = _on_site(path, files)
        if found is None:
            return words
        link = posixpath.relpath(found, posixpath.dirname(here) or ".")
        return f"{picture}[{words}]({link}{anchor or ''})"

    return _LINKED.sub(turned, markdown)


def _on_site(path: str, files: Files) -> str | None:
    """Path in the site of a path in the repository; None for code and folders.

    Raises:
        FileNotFoundError: the repository has no such path either.
    """
    if path in PAGES:
        return PAGES[path]
    on_site = path.removeprefix("docs/")
    if files.get_file_from_path(on_site) is not None:
        return on_site
    for index in (f"{path}/README.md", f"{on_site}/README.md"):
        if index in PAGES:
            return PAGES[index]
        if files.get_file_from_path(index) is not None:
            return index
    if not (ROOT / path).exists():
        raise FileNotFoundError(f"a page links to {path}, which is not there")
    return None
