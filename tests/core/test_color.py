"""Transfer functions, matrices and tags against hand-worked values and against their inverses."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from nlens_video.core.color import (
    PRIMARIES,
    TRANSFERS,
    ColorTags,
    luma,
    primaries_from_bt709,
    rgb_from_yuv,
    transfer,
)
from nlens_video.core.errors import InputError

CURVES = sorted(set(TRANSFERS.values()))


@pytest.mark.parametrize("name", CURVES)
@given(code=st.floats(-0.25, 1.09))
def test_transfer_function_and_its_inverse_cancel(name, code):
    curve = transfer(name)
    assert float(curve.to_coded(curve.to_linear(np.float64(code)))) == pytest.approx(code, abs=1e-6)


@pytest.mark.parametrize("name", CURVES)
def test_transfer_function_is_odd_and_monotone(name):
    curve = transfer(name)
    codes = np.linspace(0.0, 1.2, 5001)
    light = curve.to_linear(codes)
    assert np.all(np.diff(light) >= 0.0)
    np.testing.assert_array_equal(curve.to_linear(-codes), -light)


@pytest.mark.parametrize(
    ("name", "code", "light"),
    [
        ("iec61966-2-1", 0.5, 0.2140411),
        ("bt709", 0.5, 0.2597194),
        ("bt709", 0.045, 0.01),
        ("gamma22", 0.5, 0.2176376),
        ("smpte2084", 0.5806889, 1.0),  # 203 nits lies at 58 %
        ("smpte2084", 1.0, 10000.0 / 203.0),
        ("arib-std-b67", 0.75, 1.0),
    ],
)
def test_transfer_function_gives_published_values(name, code, light):
    assert float(transfer(name).to_linear(np.float64(code))) == pytest.approx(light, rel=2e-6)


def test_bt709_red_has_the_published_luma_and_chroma():
    yuv = np.linalg.solve(rgb_from_yuv("bt709"), [1.0, 0.0, 0.0])
    np.testing.assert_allclose(yuv, [0.2126, -0.2126 / 1.8556, 0.5], atol=1e-12)


@pytest.mark.parametrize("name", sorted(PRIMARIES.values()))
def test_white_is_kept_between_all_primaries(name):
    np.testing.assert_allclose(primaries_from_bt709(name) @ np.ones(3), 1.0, atol=1e-4)


def test_bt709_red_in_bt2020_has_the_values_of_bt2087():
    np.testing.assert_allclose(
        primaries_from_bt709("bt2020")[:, 0], [0.6274, 0.0691, 0.0164], atol=1e-4
    )


def test_luma_weights_sum_to_one():
    for name in ("bt709", "smpte170m", "bt2020nc", "fcc", "smpte240m"):
        assert luma(name).sum() == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("size", "matrix"), [((640, 360), "smpte170m"), ((1280, 536), "bt709"), ((960, 720), "bt709")]
)
def test_untagged_video_gets_its_matrix_by_size_and_reports_the_assumption(size, matrix):
    tags = ColorTags.resolve("yuv", size, matrix=2, transfer=2, primaries=2, range_=0)
    assert (tags.matrix, tags.full_range) == (matrix, False)
    assert f"matrix={matrix}" in tags.assumed


def test_complete_tags_need_no_assumption():
    tags = ColorTags.resolve("yuv", (64, 64), matrix=9, transfer=16, primaries=9, range_=1)
    assert (tags.matrix, tags.transfer, tags.primaries) == ("bt2020nc", "smpte2084", "bt2020")
    assert tags.assumed == ()


def test_untagged_rgb_is_taken_as_srgb():
    tags = ColorTags.resolve("rgb", (64, 64), matrix=2, transfer=2, primaries=2, range_=0)
    assert (tags.matrix, tags.transfer, tags.full_range) == ("gbr", "iec61966-2-1", True)


@pytest.mark.parametrize("tag", [10, 12, 14])
def test_refusal_of_a_matrix_of_wide_colours_advises_that_of_bt2020(tag):
    with pytest.raises(InputError, match="zscale=matrix=bt2020nc "):
        ColorTags.resolve("yuv", (320, 180), matrix=tag, transfer=1, primaries=9, range_=1)
