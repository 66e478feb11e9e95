"""A few seconds of `make fuzz`, and the failures that it has found."""

from pathlib import Path

import pytest
from hard.fuzz.campaign import summary, tried
from hard.fuzz.kinds import KINDS
from hard.fuzz.mutate import json_bytes
from hard.fuzz.worker import judged

CORPUS = Path(__file__).parent / "corpus"
FOUND = sorted(CORPUS.glob("*/*"))


@pytest.mark.parametrize("kind", KINDS)
def test_damaged_files_are_read_or_refused_in_one_line(kind):
    count = tried(kind, 1_000_000, 1_000_025)
    assert not count.faults, f"{summary(count)}\n{count.faults}"
    assert count.tried == count.read + count.refused == 25


@pytest.mark.parametrize("path", FOUND, ids=lambda path: path.name)
def test_recorded_fuzz_failures_are_read_or_refused(path, tmp_path):
    (kind,) = (name for name, one in KINDS.items() if path.parent.name == _folder(name))
    copy = tmp_path / f"input{KINDS[kind].suffix}"
    copy.write_bytes(path.read_bytes())
    assert judged(kind, copy) in ("read", "refused")


def _folder(kind):
    return "".join(letter if letter.isalnum() else "_" for letter in kind)


@pytest.mark.parametrize(
    "changes",
    [
        {"slope": 10**400},
        {"width": 10**400},
        {"intercept_stderr": -1e308},
        {"ground_seen": [[10**400, 1]]},
        {"track": {"stretch": float("nan"), "cuts": [], "keys": []}},
        {"track": {"stretch": 3, "cuts": [9, 2], "keys": [{"index": 0, "shot": 0}]}},
        {"track": {"stretch": 3, "cuts": [], "keys": [{"index": float("inf"), "shot": 0}]}},
    ],
)
def test_fit_file_of_random_numbers_is_refused_in_one_line(tmp_path, changes):
    fit = {"slope": 24.0, "intercept": -12.0, "width": 480, "height": 270}
    if "track" in changes:
        changes["track"]["keys"] = [{**key, "fit": fit} for key in changes["track"]["keys"]]
    (tmp_path / "fit.json").write_bytes(json_bytes({**fit, **changes}))
    assert judged("fit.json: its values", tmp_path / "fit.json") == "refused"


@pytest.mark.parametrize(
    ("kind", "text"),
    [
        ("fit.json: bytes", "[" * 100_000),
        ("pipeline: bytes", f"a = {'[' * 100_000}"),
        ("pipeline: bytes", f"a = {'9' * 5000}"),
        ("glb: bytes", "glTF"),
        ("shot file: bytes", f"a = {'[' * 100_000}"),
        ("shot file: bytes", 'version = 1\n[plate]\nfile = "a\\u0000b"\n'),
        ("list of shots", f"a = {'[' * 100_000}"),
        ("list of shots", '[[shot]]\nshot = "a\\u0000b.toml"\n'),
        ("camera.json: bytes", "[" * 100_000),
    ],
)
def test_endless_text_file_is_refused_in_one_line(tmp_path, kind, text):
    path = tmp_path / f"x{KINDS[kind].suffix}"
    path.write_text(text)
    assert judged(kind, path) == "refused"
