"""Folders import in one direction: a module imports from its own folder or from one above."""

import ast
import functools
import subprocess
import sys
from pathlib import Path

import pytest
from support.folders import ROOT

PACKAGE = ROOT / "nlens_video"

FOLDERS = """
core
native
kernels  kernels/scatter
video/pixels  video  video/stills  video/input  video/times  video/output
scene/gltf  scene  cameras  solve/still  solve/points  solve/paths  solve
render/base  render/software  render/opengl  render
stages/texture  stages/whole_ground  stages
networks
options
effects  effects/foreground  effects/shadow  effects/camera
graph/base  graph/nodes  graph
report
run/checks  run
compositor
adapters
vapoursynth
check
evaluate  evaluate/camera  evaluate/coc  evaluate/bench  evaluate/composite  evaluate/study
farm
studio
cli
.
""".split()
MODULES = sorted(PACKAGE.rglob("*.py"))
FRONT_DOOR = {"__init__.py", "__main__.py", "py.typed"}
MOST_MODULES = 15


def folder_of(path: Path) -> str:
    return str(path.parent.relative_to(PACKAGE))


@functools.cache
def imported_modules(path: Path) -> list[str]:
    """Modules of all import statements, those for type checkers included."""
    found = []
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom) and node.module:
            found += [node.module, *(f"{node.module}.{name.name}" for name in node.names)]
        elif isinstance(node, ast.Import):
            found += [name.name for name in node.names]
    return found


def imported_folders(path: Path) -> set[str]:
    found = set()
    for module in imported_modules(path):
        parts = module.split(".")
        if parts[0] == PACKAGE.name:
            file = PACKAGE.joinpath(*parts[1:]).with_suffix(".py")
            if file.is_file():
                found.add(folder_of(file))
    return found


def test_every_folder_of_the_package_is_listed():
    assert {folder_of(path) for path in MODULES} == set(FOLDERS)


@pytest.mark.parametrize("folder", FOLDERS)
def test_folder_imports_nothing_from_a_folder_below_it_in_the_list(folder):
    allowed = set(FOLDERS[: FOLDERS.index(folder) + 1])
    for path in PACKAGE.joinpath(folder).glob("*.py"):
        assert imported_folders(path) <= allowed, path.relative_to(PACKAGE)


def test_package_root_holds_only_its_entry_points():
    assert {path.name for path in PACKAGE.iterdir() if path.is_file()} == FRONT_DOOR


@pytest.mark.parametrize("folder", FOLDERS)
def test_folders_hold_at_most_fifteen_modules(folder):
    modules = [path for path in MODULES if folder_of(path) == folder]
    assert len([path for path in modules if path.name != "__init__.py"]) <= MOST_MODULES


def test_modules_have_at_most_300_lines():
    lengths = {path: len(path.read_text().splitlines()) for path in MODULES}
    assert not {str(path): length for path, length in lengths.items() if length > 300}


@pytest.mark.parametrize(
    ("library", "folders"),
    [
        ("onnxruntime", {"networks"}),
        ("torch", {"networks", "kernels/scatter"}),
        ("pyrender", {"render/opengl", "render/base"}),
        ("OpenGL", {"render/opengl"}),
    ],
)
def test_heavy_library_is_imported_in_its_own_folder(library, folders):
    using = {
        folder_of(path)
        for path in MODULES
        if any(module.split(".")[0] == library for module in imported_modules(path))
    }
    assert using <= folders


def test_help_loads_no_heavy_library():
    code = (
        "import sys; sys.argv = ['nlens-video', '--help']\n"
        "from nlens_video.cli.main import main\n"
        "try: main()\n"
        "except SystemExit: pass\n"
        "heavy = {'numpy', 'av', 'cv2', 'torch', 'onnxruntime', 'numba', 'pyrender', 'rich'}\n"
        "print('LOADED', sorted(heavy & set(sys.modules)))"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stdout.rstrip().endswith("LOADED []"), run.stdout[-200:]
