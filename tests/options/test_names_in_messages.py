"""Messages give options the names that the help gives them today."""

import ast
import re
from pathlib import Path

import nlens_video
from nlens_video.options.table import ROWS

PACKAGE = Path(nlens_video.__file__).parent
FORMER = sorted(
    {
        flag
        for row in ROWS
        if row.flags[:1] and row.flags[0].startswith("--")
        for flag in row.flags[1:]
    }
)


def literals(path):
    """Texts of a module, without its docstrings."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    documents = {
        id(node.body[0].value)
        for node in ast.walk(tree)
        if isinstance(node, ast.Module | ast.ClassDef | ast.FunctionDef)
        and node.body
        and isinstance(node.body[0], ast.Expr)
    }
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str):
            if id(node) not in documents:
                yield node.value


def test_no_message_gives_a_former_name_of_an_option():
    assert {"--reflect", "--env", "--late"} <= set(FORMER)
    former = re.compile(rf"({'|'.join(map(re.escape, FORMER))})(?![\w-])")
    found = [
        f"{path.relative_to(PACKAGE)}: {text}"
        for path in sorted(PACKAGE.rglob("*.py"))
        if not path.name.endswith("_rows.py")
        for text in literals(path)
        if former.search(text)
    ]
    assert not found, "\n".join(found)
