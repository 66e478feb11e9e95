"""An object that stands still for a moment, by itself or because the camera does."""

import pytest
from support import takes

from nlens_video.check.command import compare
from nlens_video.core.settings import SourceSettings

FRAMES = 24


@pytest.fixture
def checked(tmp_path):
    """Composite a disc at some places onto plates panned by some, and compare."""

    def run(places, pans):
        shown = [takes.plate(1, pan=pan) for pan in pans]
        source = takes.encode(tmp_path / "in.mp4", shown)
        pictures = [
            takes.with_object(picture, n, place=places[n])
            for n, picture in enumerate(takes.decode(source))
        ]
        result = takes.encode(tmp_path / "out.mp4", pictures)
        verdict = compare(str(result), SourceSettings(spec=str(source))).verdict
        return [(one.frame, one.last) for one in verdict.of("freeze")]

    return run


def pausing(n):
    """A number that stops from 10 to 13."""
    return n - min(max(n - 10, 0), 3)


def test_what_stands_on_the_ground_stands_still_when_the_camera_pauses(checked):
    pans = [3.0 * pausing(n) for n in range(FRAMES)]
    assert checked([(200 - pan, 96) for pan in pans], pans) == []


def test_what_moves_by_itself_and_stands_still_with_the_camera_is_reported(checked):
    pans = [3.0 * pausing(n) for n in range(FRAMES)]
    assert checked([(80 + 4.0 * pausing(n), 96) for n in range(FRAMES)], pans) == [(11, 13)]


@pytest.mark.parametrize("length", [3, 8])
def test_object_that_is_frozen_and_then_where_it_would_be_is_reported(checked, length):
    frozen = range(10, 10 + length)
    places = [(80 + 4.0 * (9 if n in frozen else n), 96) for n in range(FRAMES)]
    assert checked(places, [0.0] * FRAMES) == [(10, 9 + length)]


def test_long_stop_on_the_way_is_not_reported(checked):
    places = [(80 + 4.0 * (n - min(max(n - 10, 0), 8)), 96) for n in range(FRAMES)]
    assert checked(places, [0.0] * FRAMES) == []
