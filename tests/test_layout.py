"""Tests mirror the package, and share code through tests/support alone."""

import ast

from support.folders import ROOT, TESTS

MODULES = sorted(TESTS.rglob("test_*.py"))
SUITES = {"hard", "end_to_end", "training", "support"}


def imported(path):
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.module:
            yield from (node.module, *(f"{node.module}.{alias.name}" for alias in node.names))
        elif isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)


def test_no_test_module_is_imported():
    tests = {module.stem for module in MODULES}
    for path in TESTS.rglob("*.py"):
        names = {part for module in imported(path) for part in module.split(".")}
        assert not names & tests, path.relative_to(TESTS)


def test_every_test_folder_mirrors_a_package_folder_or_is_a_suite():
    folders = {path.relative_to(TESTS).parts[0] for path in MODULES if path.parent != TESTS}
    package = {path.name for path in (ROOT / "nlens_video").iterdir() if path.is_dir()}
    assert folders <= package | SUITES


def test_every_folder_of_the_package_has_tests():
    """A folder that only names what another one holds, as `vapoursynth` does, needs none."""
    package = {path.parent.name for path in (ROOT / "nlens_video").glob("*/[!_]*.py")} | {"native"}
    tested = {path.relative_to(TESTS).parts[0] for path in MODULES}
    assert package <= tested, package - tested
