"""How far the lens of a stream lags behind a focus that is pulled."""

import numpy as np
import pytest
from support import shots

from nlens_video import Compositor
from nlens_video.core.lens_fit import LensFit
from nlens_video.graph.base.live_lens import EVERY, LiveLens
from nlens_video.stages.r_lens_change import CHANGED

REST_S, SEEN = 1.0, 0.07  # before the pull; relative change of the focus that is detected

WAYS = {
    "even": lambda part: part,
    "eased": lambda part: part * part * (3.0 - 2.0 * part),
    "accelerated": lambda part: part**2,
    "decelerated": lambda part: 1.0 - (1.0 - part) ** 2,
}


def fit(intercept, frame):
    return LensFit(
        slope=24.0, intercept=intercept, slope_stderr=0.2, intercept_stderr=0.2,
        width=960, height=512, frame=frame,
    )  # fmt: skip


def followed(true, rate):
    """Intercepts that a stream gives frames whose true ones are `true` [px], and its fits."""
    live, values = LiveLens(1.0 / rate), []
    live.found(fit(true[0], 0))
    reference, fits = true[0], 0
    for index, now in enumerate(true):
        if index % EVERY == 0:
            change = abs(now / reference - 1.0) / SEEN * CHANGED
            if live.calls_for_fit(change, index):
                reference, fits = now, fits + 1
                live.found(fit(now, index))
        values.append(live.step(index).intercept)
    return np.array(values), fits


def lag_s(time_s, true, values):
    """The delay that explains the values best [s]."""
    lags = np.arange(-0.1, 0.5, 0.005)
    errors = [np.mean((np.interp(time_s - lag, time_s, true) - values) ** 2) for lag in lags]
    return lags[np.argmin(errors)]


@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("rate", [24, 30, 60])
@pytest.mark.parametrize("lasts_s", [0.2, 0.5, 1.5, 4.0])
def test_lens_of_a_stream_lags_by_less_than_0_15_s(way, rate, lasts_s):
    lags = []
    for late in range(EVERY):  # when in the rhythm of the detection the pull begins
        time_s = np.arange(int((lasts_s + 3.0) * rate)) / rate
        part = np.clip((time_s - REST_S - late / rate) / lasts_s, 0.0, 1.0)
        true = -10.0 - 8.0 * WAYS[way](part)
        values, fits = followed(true, rate)
        moving = (time_s >= REST_S) & (time_s < REST_S + lasts_s + 0.5)
        lags.append(lag_s(time_s[moving], true[moving], values[moving]))
        assert values.min() > true.min() - 4.0
        assert fits <= 10.0 * lasts_s + 2.0
        assert values[-1] == pytest.approx(true[-1], abs=SEEN * 20.0)
    assert np.mean(lags) < 0.15


@pytest.mark.parametrize("way", WAYS)
def test_lens_of_a_stream_does_not_go_back_in_a_slow_pull(way):
    """Between two fits the focus moves by no more than their errors explain."""
    time_s = np.arange(14 * 24) / 24
    true = -10.0 - 8.0 * WAYS[way](np.clip((time_s - REST_S) / 10.0, 0.0, 1.0))
    values, _ = followed(true, 24)
    assert np.diff(values).clip(0.0).sum() < 0.8
    assert values.min() > true.min() - 0.5
    assert values[-1] == pytest.approx(true[-1], abs=0.6)


@pytest.mark.parametrize(("noise", "calls"), [(0.01, True), (0.6, False)])
def test_small_change_calls_for_a_fit_where_the_blur_at_rest_shows_no_noise(noise, calls):
    live = LiveLens(1 / 25)
    live.found(fit(-10.0, 0))
    rest = range(EVERY, 40 * EVERY, EVERY)
    asked = [live.calls_for_fit(noise * CHANGED * (index % 2), index) for index in rest]
    assert not any(asked)
    assert live.calls_for_fit(0.7 * CHANGED, 40 * EVERY) == calls
    assert live.calls_for_fit(1.5 * CHANGED, 44 * EVERY)


def test_change_goes_on_counting_where_a_fit_lies_within_its_error():
    live = LiveLens(1 / 25)
    live.found(fit(-10.0, 0))
    assert live.calls_for_fit(1.1 * CHANGED, 12)
    live.found(fit(-10.2, 12))
    assert live.fits == 1
    assert not live.calls_for_fit(1.2 * CHANGED, 15)
    assert live.calls_for_fit(2.0 * CHANGED, 24)
    live.found(fit(-14.0, 24))
    after = [live.step(index).intercept for index in range(24, 48)]
    assert live.fits == 2 and min(after) > -15.2  # 4 px in 24 frames, not in 12


def test_frames_that_are_left_out_count_as_time():
    lenses = [LiveLens(1 / 25) for _ in range(2)]
    for live in lenses:
        live.found(fit(-10.0, 0))
        assert live.calls_for_fit(2.0 * CHANGED, 12)
        live.found(fit(-14.0, 12))
    every, one = ([live.step(index).intercept for index in steps]
                  for live, steps in zip(lenses, (range(1, 9), [8]), strict=True))  # fmt: skip
    assert -14.0 < every[0] < -10.0
    assert one[-1] == every[-1]


@pytest.mark.needs_gl
@pytest.mark.parametrize(
    ("first", "numbers"),
    [(0, range(50, 70)), (0, range(1, 90, 3)), (0, range(2, 90, 3)), (300, range(7, 40))],
)
def test_focus_is_followed_over_frames_that_are_left_out_and_back(tmp_path, first, numbers):
    glb = shots.write_shot(tmp_path, 1) / "anim.glb"
    disparity = 1.0 / 1.6  # of the cube
    with Compositor(glb, preset="draft", fps=25) as lens:
        lens.process(shots.plate(), number=first)
        for number in numbers:
            lens.process(shots.plate(intercept=1.6 * shots.INTERCEPT), number=number)
        found = lens.fit.slope * disparity + lens.fit.intercept
    assert found == pytest.approx(shots.SLOPE * disparity + 1.6 * shots.INTERCEPT, abs=0.8)


@pytest.mark.needs_gl
def test_focus_that_is_given_does_not_hold_the_lens_of_a_stream_that_changes(tmp_path):
    glb = shots.write_shot(tmp_path, 1) / "anim.glb"
    focus_m = -shots.SLOPE / shots.INTERCEPT
    disparity = 1.0 / 1.6  # of the cube
    with Compositor(glb, preset="draft", fps=25, lens=f"focus {focus_m:.3f}m") as lens:
        for intercept in (*[shots.INTERCEPT] * 6, *[1.6 * shots.INTERCEPT] * 20):
            lens.process(shots.plate(intercept=intercept))
        found = lens.fit.slope * disparity + lens.fit.intercept
    assert found == pytest.approx(shots.SLOPE * disparity + 1.6 * shots.INTERCEPT, abs=0.8)
