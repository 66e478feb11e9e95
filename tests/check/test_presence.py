"""An object that is gone at once is found; one that leaves, shrinks or is covered is not."""

import cv2
import numpy as np
import pytest
from support import takes

from nlens_video.check.command import compare
from nlens_video.core.settings import SourceSettings

FRAMES = 24


@pytest.fixture(scope="module")
def source(tmp_path_factory):
    folder = tmp_path_factory.mktemp("plate")
    return takes.encode(folder / "in.mp4", [takes.plate(0)] * FRAMES, audio=False)


def texts(path, pictures, source, **options):
    result = takes.encode(path, pictures, audio=False)
    verdict = compare(str(result), SourceSettings(spec=str(source)), **options).verdict
    return [one.text for one in verdict.findings]


@pytest.mark.parametrize(
    ("lost", "text"),
    [
        (range(9, 12), "frames 9 to 11: the object is missing"),
        (range(9, 19), "frames 9 to 18: the object is missing"),
        (range(1), "frame 0: the object is missing, or switched on at once"),
        (range(23, 24), "frame 23: the object is missing, or switched off at once"),
        (range(12, 24), "frames 12 to 23: the object is missing, or switched off at once"),
    ],
)
def test_object_that_is_gone_at_once_is_reported(source, tmp_path, lost, text):
    pictures = [
        plate if n in lost else takes.with_object(plate, n)
        for n, plate in enumerate(takes.decode(source))
    ]
    assert texts(tmp_path / "o.mp4", pictures, source) == [text]


def shrunk(plate, number):
    """The object, which becomes nothing within six frames, and comes back so."""
    size = abs(12 - number) / 6
    if size < 0.1:
        return plate
    layer = cv2.resize(takes.SKIN, None, fx=min(size, 1.0), fy=min(size, 1.0))
    height, width = layer.shape[:2]
    picture = plate.copy()
    picture[60 : 60 + height, 100 : 100 + width] = layer
    return picture


def behind(plate, number):
    """The object, which goes behind a wall and comes out of it."""
    shown = takes.with_object(plate, number, place=(60 + 9.0 * number, 96))
    shown[:, 120:210] = plate[:, 120:210]
    return shown


def outside(plate, number):
    """The object, which leaves the frame to the right and comes back from the left."""
    x = (200 + 30.0 * number) if number < 12 else 30.0 * (number - 18)
    return takes.with_object(plate, number, place=(x, 96))


@pytest.mark.parametrize("way", [shrunk, behind, outside])
def test_object_that_is_gone_by_its_way_is_not_reported_as_missing(source, tmp_path, way):
    pictures = [way(plate, n) for n, plate in enumerate(takes.decode(source))]
    said = texts(tmp_path / "o.mp4", pictures, source)
    assert not [one for one in said if "missing" in one], said


def test_object_that_the_next_shot_does_not_show_is_not_missing(tmp_path):
    rooms = [takes.plate(0)] * 12 + [np.ascontiguousarray(takes.plate(0)[::-1, ::-1])] * 12
    plate = takes.encode(tmp_path / "in.mp4", rooms, audio=False)
    pictures = [
        takes.with_object(shown, n) if n < 12 else shown
        for n, shown in enumerate(takes.decode(plate))
    ]
    assert texts(tmp_path / "o.mp4", pictures, plate) == []


def test_two_objects_that_meet_are_not_missing(source, tmp_path):
    pictures = [
        takes.with_object(takes.with_object(plate, n, place=(60 + 4.0 * n, 90)), n, place=(220, 90))
        for n, plate in enumerate(takes.decode(source))
    ]
    said = texts(tmp_path / "o.mp4", pictures, source, objects=2)
    assert not [one for one in said if "missing" in one], said
