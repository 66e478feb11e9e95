"""The aperture as a user states it, and the shutter that is assumed."""

import math
from pathlib import Path

import pytest

from nlens_video.core.errors import UsageError
from nlens_video.core.optics import Aperture, assumed_shutter, parse_aperture


@pytest.mark.parametrize(
    ("text", "aperture"),
    [
        ("auto", None),
        ("round", Aperture()),
        ("6", Aperture(blades=6)),
        ("7:15", Aperture(blades=7, rotation_deg=15.0)),
        ("7:-15.5:0.3", Aperture(blades=7, rotation_deg=-15.5, roundness=0.3)),
        ("heart.PNG", Aperture(image=Path("heart.PNG"))),
    ],
)
def test_aperture_text_is_parsed(text, aperture):
    assert parse_aperture(text) == aperture


def test_cat_eye_can_be_combined_with_blades():
    assert parse_aperture("auto", cat_eye=0.4) == Aperture(cat_eye=0.4)
    assert parse_aperture("5", cat_eye=0.4) == Aperture(blades=5, cat_eye=0.4)


@pytest.mark.parametrize(
    "text", ["", "oval", "2", "0", "33", "6:x", "6:1:0.2:9", "6:nan", "6:0:1.5", "6:inf", "6.5"]
)
def test_invalid_aperture_text_is_refused_in_one_line(text):
    with pytest.raises(UsageError) as error:
        parse_aperture(text)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("strength", [-0.1, 1.1, math.nan])
def test_cat_eye_strength_out_of_range_is_refused(strength):
    with pytest.raises(UsageError, match="cat-eye"):
        Aperture(cat_eye=strength)


def test_cat_eye_with_a_picture_of_the_aperture_is_refused():
    with pytest.raises(UsageError, match="picture"):
        parse_aperture("heart.png", cat_eye=0.2)


@pytest.mark.parametrize(
    ("aperture", "is_round"),
    [
        (Aperture(), True),
        (Aperture(blades=6, roundness=1.0), True),
        (Aperture(blades=6), False),
        (Aperture(cat_eye=0.1), False),
        (Aperture(image=Path("a.png")), False),
    ],
)
def test_aperture_reports_whether_it_is_a_round_disc(aperture, is_round):
    assert aperture.round is is_round


@pytest.mark.parametrize(
    ("rate", "angle"), [(10, 75.0), (23.976, 179.82), (24, 180.0), (60, 180.0)]
)
def test_assumed_shutter_is_open_for_half_a_frame_and_at_most_a_48th_of_a_second(rate, angle):
    shutter = assumed_shutter(1 / rate)
    assert shutter.angle_deg == pytest.approx(angle)
    assert shutter.open_s <= 1 / 48 + 1e-12
    assert assumed_shutter(0.0).open_s == 0.0
