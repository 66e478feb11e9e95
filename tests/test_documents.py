"""What is written for people is finished and true."""

import inspect
import json
import re

import pytest
from support.folders import ROOT

from nlens_video.graph.diagram import mermaid
from nlens_video.graph.node_registry import NODES
from nlens_video.graph.pipeline_file import FORMER_NAMES, load_pipeline
from nlens_video.options.parser import COMMANDS, parser_of

PAGES = [
    path
    for path in sorted(ROOT.rglob("*.md"))
    if not {"node_modules", "runs"} & set(path.relative_to(ROOT).parts)
    and not path.relative_to(ROOT).parts[0].startswith(".venv")
]


@pytest.mark.parametrize("page", PAGES, ids=lambda path: str(path.relative_to(ROOT)))
def test_document_has_no_placeholder_and_no_dead_link(page):
    text = page.read_text()
    assert not re.search(r"@@?[A-Z]+@|\bTODO\b|\bTBD\b|^POINTS$", text, re.MULTILINE)
    for target in re.findall(r"\]\(([^)#]+)\)", text):
        if "://" not in target:
            assert (page.parent / target).exists(), f"{page}: {target} is not there"


def test_options_named_in_the_readme_exist():
    known = {name for one in ("render", "check") for name in parser_of(one)._option_string_actions}
    named = set(re.findall(r"--[a-z][a-z-]+", (ROOT / "README.md").read_text()))
    assert named <= known, named - known
    for command in re.findall(
        r"^nlens-video (\w+) ", (ROOT / "README.md").read_text(), re.MULTILINE
    ):
        assert command in COMMANDS or command == "in"


def test_gallery_shows_every_picture_of_its_script_and_is_small():
    folder = ROOT / "docs" / "gallery"
    pictures = {path.name for path in folder.glob("*.jpg")}
    script = (ROOT / "docs" / "make_gallery.py").read_text()
    made = re.findall(r'^    "(\w+)": \w+,$', script, re.MULTILINE)
    shown = re.findall(r"\]\((\w+\.jpg)\)", (folder / "README.md").read_text())
    assert len(made) >= 8 and pictures == {f"{name}.jpg" for name in made} == set(shown)
    assert sum((folder / name).stat().st_size for name in pictures) < 2e6


def test_architecture_page_shows_the_current_frame_graph():
    page = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    diagram = mermaid(load_pipeline("standard"))
    assert f"```mermaid\n{diagram}```" in page, "write it anew: python docs/make_graph.py"


def test_pipeline_file_in_the_documentation_loads(tmp_path):
    page = (ROOT / "docs" / "pipelines.md").read_text(encoding="utf-8")
    (shown,) = re.findall(r"^```toml\n(.*?)^```", page, re.M | re.S)
    path = tmp_path / "mine.toml"
    path.write_text(shown, encoding="utf-8")
    assert load_pipeline(str(path)).notes == ()


def test_pipelines_page_lists_node_options_and_former_names():
    page = (ROOT / "docs" / "pipelines.md").read_text(encoding="utf-8")
    for former, today in FORMER_NAMES.items():
        assert f"| `{former}` | `{today}` |" in page
    for name, node in NODES.items():
        for option in inspect.signature(node.__init__).parameters.values():
            if option.kind is option.KEYWORD_ONLY:
                default = json.dumps(option.default)
                assert re.search(rf"^\| `{name}` \|.*`{option.name} = {default}`", page, re.M)


def test_architecture_page_lists_the_folders_in_import_order():
    page = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
    (table,) = re.findall(r"^\| folder \| holds \|\n.*?\n\n", page, re.M | re.S)
    listed = re.findall(r"`(\w+)`", "".join(re.findall(r"^\| (`.*?) \|", table, re.M)))
    order = (ROOT / "tests" / "test_import_directions.py").read_text(encoding="utf-8")
    (folders,) = re.findall(r'^FOLDERS = """\n(.*?)^\.$', order, re.M | re.S)
    assert listed == list(dict.fromkeys(folder.split("/")[0] for folder in folders.split()))


DECISIONS = sorted((ROOT / "docs" / "decisions").glob("[0-9]*.md"))


@pytest.mark.parametrize("page", DECISIONS, ids=lambda path: path.stem)
def test_decision_record_fits_on_a_page_and_is_listed(page):
    text = page.read_text(encoding="utf-8")
    sections = re.findall(r"^## (.*)$", text, re.M)
    assert sections[:4] == ["Context", "Decision", "Evidence", "Rejected alternatives"]
    assert len(text.split()) <= 400
    index = (page.parent / "README.md").read_text(encoding="utf-8")
    number, title = re.match(r"# (\d+)\. (.*)", text).groups()
    assert page.stem.startswith(f"{number}-") and f"- [{number}]({page.name}) {title}\n" in index
