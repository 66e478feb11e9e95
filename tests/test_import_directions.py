"""Import directions: a module imports from its own line or from a line below."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parents[1] / "nlens_video"

LAYERS = [
    ["__main__"],
    ["cli"],
    ["side_commands"],
    ["check", "completion", "compositor", "doctor", "evaluate", "farm", "place", "show", "study"],
    ["run"],
    ["beside", "follow", "place_choices", "preflight"],
    ["intake", "zoom_check"],
    [
        "look_ahead",
        "frame_loop",
        "loop_arguments",
        "loop_frames",
        "notebook",
        "observers",
        "outcome",
        "own_thread",
        "parameter_names",
        "report",
        "trim",
    ],
    ["arguments", "graph"],
    ["farm_arguments", "measure_arguments", "side_arguments"],
    ["object_arguments"],
    ["effect_arguments", "real_arguments"],
    ["light_arguments", "live_arguments"],
    ["argument_parser"],
    ["existing_outputs", "overwriting"],
    ["command_paths"],
    ["effects", "settings"],
    ["backends"],
    ["stages"],
    ["model_store", "scene", "video"],
    ["kernels"],
    ["fit_track"],
    ["aperture", "color", "lens", "optics", "placing", "playback", "radius", "shutter", "v_fit"],
    ["chunk_feed"],
    ["chunk_mark"],
    ["frames"],
    ["box"],
    ["standard_names", "standard_output"],
    ["memory"],
    ["errors", "interrupts"],
]
LEVEL = {name: level for level, names in enumerate(reversed(LAYERS)) for name in names}

FILES = sorted(PACKAGE.rglob("*.py"))
FRONT_DOOR = PACKAGE / "__init__.py"  # loads the compositor, lazily


def layer_of(module: str) -> str | None:
    parts = module.split(".")
    return parts[1] if parts[0] == "nlens_video" and len(parts) > 1 else None


def imports(path: Path) -> list[tuple[str, bool]]:
    """Imported modules, and whether only a type checker sees the import."""
    tree = ast.parse(path.read_text())
    for_types = {
        id(node)
        for branch in ast.walk(tree)
        if isinstance(branch, ast.If) and "TYPE_CHECKING" in ast.unparse(branch.test)
        for node in ast.walk(branch)
    }
    found = []
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and node.module:
            found.append((node.module, id(node) in for_types))
        elif isinstance(node, ast.Import):
            found.extend((name.name, id(node) in for_types) for name in node.names)
    return found


def own_layer(path: Path) -> str:
    relative = path.relative_to(PACKAGE)
    return relative.parts[0].removesuffix(".py")


def test_every_module_has_a_layer():
    assert {own_layer(path) for path in FILES} - {"__init__"} <= set(LEVEL)


@pytest.mark.parametrize(
    "path", [p for p in FILES if p != FRONT_DOOR], ids=lambda path: str(path.relative_to(PACKAGE))
)
def test_module_imports_nothing_from_above(path):
    layer = own_layer(path)
    for module, type_only in imports(path):
        target = layer_of(module)
        if target is not None and target != "__init__" and not type_only:
            assert LEVEL[target] <= LEVEL[layer], f"{layer} imports {module}, which lies above it"


def test_stages_do_not_import_graph_or_backends():
    for path in (PACKAGE / "stages").glob("*.py"):
        modules = [module for module, _ in imports(path)]
        assert not any("nlens_video.graph" in m or "nlens_video.backends" in m for m in modules)


@pytest.mark.parametrize(
    ("library", "files"),
    [
        ("onnxruntime", {"backends/onnx_session.py"}),
        ("torch", {"backends/device.py", "backends/scatter_torch.py"}),
    ],
)
def test_heavy_library_is_imported_in_its_one_file(library, files):
    using = {
        str(path.relative_to(PACKAGE))
        for path in FILES
        if any(module.split(".")[0] == library for module, _ in imports(path))
    }
    assert using <= files


def test_pyrender_is_imported_in_backends_only():
    using = {
        own_layer(path)
        for path in FILES
        if any(module.split(".")[0] in ("pyrender", "OpenGL") for module, _ in imports(path))
    }
    assert using <= {"backends"}


def test_the_command_lines_help_loads_no_heavy_library():
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


def test_modules_stay_small():
    long = {
        str(path.relative_to(PACKAGE)): lines
        for path in FILES
        if (lines := len(path.read_text().splitlines())) > 300
    }
    assert not long
