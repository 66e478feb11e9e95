"""What is known of a lens, and what it says of the linear lens model."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from nlens_video.core.errors import UsageError
from nlens_video.core.known_lens import NO_PRIOR, UNKNOWN_LENS, KnownLens, LensPrior, parse_lens
from nlens_video.core.lens_fit import LensFit


@pytest.mark.parametrize(
    ("text", "lens"),
    [
        ("50mm f/2.8 focus 2.4m sensor full-frame", KnownLens(
            focal_mm=50.0, f_number=2.8, focus_m=2.4, sensor_long_mm=36.0)),
        ("sensor 24.9x18.7mm, focus 80cm", KnownLens(focus_m=0.8, sensor_long_mm=24.9)),
        ("Sensor 20mm Focus 2M 50MM", KnownLens(focal_mm=50.0, focus_m=2.0, sensor_mm=20.0)),
        ("T/1.5", KnownLens(f_number=1.5)),
        ("focus inf 35mm", KnownLens(focal_mm=35.0, focus_m=math.inf)),
        ("focus 8ft", KnownLens(focus_m=8 * 0.3048)),
        ("50mm, f/2.8, focus 2.4m", KnownLens(focal_mm=50.0, f_number=2.8, focus_m=2.4)),
        ("50mm,f/2.8", KnownLens(focal_mm=50.0, f_number=2.8)),
        ("f/2.8,50mm", KnownLens(focal_mm=50.0, f_number=2.8)),
        ("sensor Super35", KnownLens(sensor_long_mm=24.9)),
    ],
)  # fmt: skip
def test_parts_of_a_lens_are_read_in_any_order(text, lens):
    assert parse_lens(text) == lens


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "no lens"),
        ("50", "'50' is no part"),
        ("50mm 35mm", "focal comes twice"),
        ("sensor 36mm sensor mft", "sensor comes twice"),
        ("f/0", "f is not from"),
        ("f/nan", "no part"),
        ("focus", "'focus' is no part"),
        ("focus far", "'focus far' is no part"),
        ("sensor huge", "sensors: full-frame, super35"),
        ("50mm focus 4cm", "focused nearer than its focal length"),
        ("0mm", "focal is not from"),
        ("sensor 23,6mm f/2.8 focus 2m", "'23,6': decimals have a point (23.6)"),
        ("f/4,5mm", "'4,5': decimals have a point (4.5)"),
        ("f/2,8 50mm", "'2,8': decimals have a point (2.8)"),
        ("focus 2,4m", "'2,4': decimals have a point (2.4)"),
        ("50mm,f/2.8,focus 0,5m", "'0,5': decimals have a point (0.5)"),
        ("f/4,50mm", "parts a space between them"),
        ("sensor 23,6x15,7", "'23,6': decimals have a point (23.6)"),
    ],
)
def test_what_is_no_lens_is_refused_with_an_example(text, said):
    with pytest.raises(UsageError, match="50mm f/2.8 focus 2.4m sensor full-frame") as refused:
        parse_lens(text)
    assert said in str(refused.value)


@pytest.mark.parametrize(("frame", "across"), [((16, 9), 36.0), ((2, 3), 24.0), ((9, 16), 20.25)])
def test_longer_side_of_a_sensor_lies_along_the_longer_side_of_the_frame(frame, across):
    lens = parse_lens("35mm f/2 sensor full-frame").across(*frame)
    assert lens == KnownLens(focal_mm=35.0, f_number=2.0, sensor_mm=across)
    stated = KnownLens(sensor_mm=36.0)
    assert stated.across(*frame) == stated


@given(
    focal=st.floats(4.0, 200.0), number=st.floats(1.2, 22.0), sensor=st.floats(4.0, 40.0),
    focus=st.floats(0.5, 50.0), depth=st.floats(0.3, 100.0), unit=st.floats(0.01, 100.0),
)  # fmt: skip
def test_prior_is_the_law_of_the_thin_lens(focal, number, sensor, focus, depth, unit):
    """coc = A f / (s - f) |d - s| / d on the sensor, in pixels of the frame."""
    lens = KnownLens(focal_mm=focal, f_number=number, focus_m=focus, sensor_mm=sensor)
    width, f = 960, 1e-3 * focal
    image = f * focus / (focus - f)
    focal_px = image / (1e-3 * sensor) * width
    prior = lens.prior(focal_px, width, unit)
    law = f / number * f / (focus - f) * (focus - depth) / depth / (1e-3 * sensor) * width
    there = prior.slope.value * (unit / depth - prior.focus.value)
    assert there == pytest.approx(law, rel=1e-6, abs=1e-6)
    assert lens.fov_x_deg == pytest.approx(2 * math.degrees(math.atan(0.5 * width / focal_px)))
    by_sensor = KnownLens(f_number=number, focus_m=focus, sensor_mm=sensor)
    assert by_sensor.prior(focal_px, width, unit).slope.value == pytest.approx(prior.slope.value)
    no_unit = lens.prior(focal_px, width, None)
    assert no_unit.intercept.value == pytest.approx(-prior.slope.value * prior.focus.value)
    fit = LensFit.of_known(prior, width, 512, 7)
    assert fit.coc_px(unit / depth) == pytest.approx(law, rel=1e-4, abs=1e-3)
    at_focus = fit.coc_stderr_px(prior.focus.value)
    assert at_focus == pytest.approx(prior.slope.value * prior.focus.error, rel=1e-6)


def test_usual_lenses_need_the_unit_and_grow_with_the_square_of_the_focal_length():
    usual = UNKNOWN_LENS.prior(960.0, 960, 1.0)
    assert usual.usual_slope == pytest.approx(0.012 * 960.0) and not usual.in_numbers
    assert UNKNOWN_LENS.prior(1920.0, 960, 1.0).usual_slope == pytest.approx(
        4.0 * usual.usual_slope
    )
    assert UNKNOWN_LENS.prior(960.0, 960, 0.01).usual_slope == pytest.approx(
        100.0 * usual.usual_slope
    )
    assert UNKNOWN_LENS.prior(960.0, 960, None) == NO_PRIOR


@pytest.mark.parametrize("prefer", ["near", "far"])
def test_preference_goes_along_with_what_is_known(prefer):
    lens = KnownLens(focal_mm=50.0, f_number=2.0, prefer=prefer)
    assert lens.prior(1333.0, 960, 1.0).prefer == prefer


def test_parts_tell_what_they_can():
    assert not KnownLens(focal_mm=50.0).prior(1333.0, 960, 1.0).in_numbers
    assert KnownLens(focus_m=2.0).prior(1333.0, 960, None) == NO_PRIOR
    aperture = KnownLens(focal_mm=50.0, f_number=2.0).prior(1333.0, 960, 1.0)
    assert aperture.slope.value == pytest.approx(0.025 * 1333.0)
    assert aperture.focus is None and not aperture.complete
    far = KnownLens(focus_m=math.inf).prior(1333.0, 960, 1.0)
    assert far.focus.value == 0.0 < far.focus.error
    with pytest.raises(ValueError, match="slope and focus"):
        LensFit.of_known(LensPrior(), 960, 512, 0)
