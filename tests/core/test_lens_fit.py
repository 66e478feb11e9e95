"""The linear lens model refuses numbers that float32 arithmetic cannot square."""

import math
import tomllib
from pathlib import Path

import pytest

from nlens_video.core.errors import LensFitError
from nlens_video.core.lens_fit import LensFit

ROOT = Path(__file__).parents[2]


@pytest.mark.parametrize("value", [1e30, 1.01e18, math.inf, math.nan])
@pytest.mark.parametrize("name", ["slope", "intercept"])
def test_fit_out_of_range_is_refused(name, value):
    numbers = {"slope": 1.0, "intercept": 0.0, name: value}
    with pytest.raises(LensFitError, match="out of range"):
        LensFit(**numbers, width=8, height=8)


def test_file_with_a_number_out_of_range_is_refused():
    text = '{"slope": 1e30, "intercept": 0.0, "width": 8, "height": 8}'
    with pytest.raises(LensFitError, match='"slope" is 1e\\+30'):
        LensFit.from_json(text)


def test_largest_fit_is_accepted():
    fit = LensFit(slope=1e18, intercept=-1e18, width=8, height=8)
    assert fit.focus_disparity == 1.0


def test_numba_is_bounded_to_the_tested_range():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    tested = dict(
        line.split("==")
        for line in (ROOT / "constraints.txt").read_text().splitlines()
        if "==" in line and not line.startswith("#")
    )
    major, minor = map(int, tested["numba"].split(".")[:2])
    assert f"numba>={major}.{minor},<{major}.{minor + 1}" in project["dependencies"]
