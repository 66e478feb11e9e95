"""The part of the frame on whose ground the lens is fitted (`--fit-region`)."""

import cv2
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from support.planes import HEIGHT, WIDTH, ground

from nlens_video.core.errors import LensFitError, UsageError
from nlens_video.core.layers import CocMap
from nlens_video.core.placement import Region
from nlens_video.stages.r_regression import FitLens
from nlens_video.stages.r_samples import inside, sample_plane

EDGE = WIDTH // 4
LEFT, LEAST = Region.of((0.0, 0.0, 0.25, 1.0)), 1 / 1024
fractions = st.integers(0, 1024).map(lambda at: at / 1024)


def misread_on_the_right(plane, slope=30.0, focus=0.4):
    """A plate whose left quarter shows the lens; the rest is read as more blurred than it is."""
    coc = np.abs(slope * (plane.disparity - focus)).astype(np.float32)
    coc[:, EDGE:] = 3.0 * coc[:, EDGE:] + 4.0
    return CocMap(coc_px=coc, sigma_px=np.full_like(coc, 0.5))


def test_ground_outside_of_the_region_tells_nothing_of_the_lens():
    plane = ground()
    coc = misread_on_the_right(plane)
    found = FitLens(region=LEFT)(coc, plane).fit
    assert found.slope == pytest.approx(30.0, rel=1e-3)
    assert found.intercept == pytest.approx(-12.0, abs=0.02)
    assert "region" in found.method
    assert abs(FitLens()(coc, plane).fit.slope - 30.0) > 5.0
    coc.coc_px[:, EDGE:] = 77.0
    assert FitLens(region=LEFT)(coc, plane).fit == found


def test_small_region_is_sampled_more_densely():
    plane = ground()
    small = Region.of((0.4, 0.8, 0.45, 0.85))
    samples = sample_plane(misread_on_the_right(plane), plane, whole_plane=True, region=small)
    assert len(samples.coc_px) >= 48


def test_region_without_ground_says_so():
    sky = Region.of((0.0, 0.0, 1.0, 0.05))
    plane = ground()
    plane.disparity[: HEIGHT // 10] = 0.0
    with pytest.raises(LensFitError, match="only 0 samples .* in the region of --fit-region"):
        FitLens(region=sky)(misread_on_the_right(plane), plane)


@given(
    corners=st.lists(st.tuples(fractions, fractions), min_size=3, max_size=7),
    point=st.tuples(fractions, fractions),
)
def test_inside_is_as_opencv_has_it(corners, point):
    """Hulls only: of polygons that cross themselves OpenCV's rule is another."""
    hull = cv2.convexHull(np.array(corners, np.float32))
    assume(len(hull) >= 3)
    distance = cv2.pointPolygonTest(hull, point, measureDist=True)
    assume(abs(distance) > LEAST)
    region = Region(tuple(map(tuple, hull[:, 0].tolist())))
    assert inside(region, np.array(point[0]), np.array(point[1])) == (distance > 0)


def test_part_that_a_polygon_covers_twice_is_outside():
    star = [(0.5 + 0.4 * np.sin(a), 0.5 - 0.4 * np.cos(a)) for a in np.arange(5) * 0.8 * np.pi]
    region = Region(tuple(star))
    columns, rows = np.array([0.5, 0.5, 0.02]), np.array([0.5, 0.2, 0.02])
    np.testing.assert_array_equal(inside(region, columns, rows), [False, True, False])


@pytest.mark.parametrize(
    "numbers",
    [(0, 0, 1), (1, 0, 0, 1), (0, 0, 1, 0), (0, 0, 1, 1, 0.5), (0, 0, 1, 1.1), (0, 0, 1, np.nan)],
)
def test_what_is_no_region_is_refused(numbers):
    with pytest.raises(UsageError):
        Region.of(numbers)
