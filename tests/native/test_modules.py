"""The compiled modules: one for each level of processors, all with the functions of the stub."""

import ast
import importlib
from pathlib import Path

import pytest

from nlens_video import native

FOLDER = Path(native.__file__).parent
LEVELS = sorted(path.name.partition(".")[0] for path in FOLDER.glob("_*.so"))
BEST = native.kernels.__name__.rpartition(".")[2]
RUN_HERE = [level for level in LEVELS if level <= BEST]
"""Levels of this processor; a module of a higher one may not even be imported."""


def public_names(module):
    return {name for name in dir(module) if not name.startswith("_")}


def test_the_module_for_this_processor_is_one_of_those_that_are_there():
    assert BEST in LEVELS


@pytest.mark.parametrize("level", RUN_HERE)
def test_the_stub_lists_what_a_module_holds(level):
    stub = ast.parse((FOLDER / "kernels.pyi").read_text(encoding="utf-8"))
    listed = {node.name for node in stub.body if isinstance(node, ast.FunctionDef)}
    listed |= {node.target.id for node in stub.body if isinstance(node, ast.AnnAssign)}
    module = importlib.import_module(f"nlens_video.native.{level}")
    assert public_names(module) == listed
