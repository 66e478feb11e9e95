"""A lens whose picture grows with its focus is told to breathe; zooms and noise are not."""

import json

import cv2
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from support import shots

from nlens_video.cli.main import main
from nlens_video.run.checks.breathing import Breathing


def seen(focus, log_size):
    found = Breathing()
    for here, size in zip(focus, log_size, strict=True):
        found.add(float(here), float(size))
    return found


@given(
    st.floats(0.01, 0.15), st.sampled_from([-1, 1]), st.integers(5, 60),
    st.floats(0.0, 2.0), st.floats(0.4, 3.0), st.integers(0, 2**31),
)  # fmt: skip
def test_size_that_goes_with_the_focus_is_breathing(growth, sign, frames, far, pulled, seed):
    rng = np.random.default_rng(seed)
    focus = far + pulled * np.sin(np.linspace(0.0, rng.uniform(1.6, 6.0), frames)) ** 2
    assume(np.ptp(focus) > 0.16 * focus.max())  # few frames may miss the ends of the pull
    part = (focus - focus[0]) / np.ptp(focus)
    found = seen(focus, sign * growth * part + 0.02 * growth * rng.standard_normal(frames))
    assert found.growth == pytest.approx(sign * growth, rel=0.15)
    assert ("larger" in found.describe()) == (sign > 0)


@given(st.integers(4, 60), st.floats(0.0, 0.3), st.integers(0, 2**31))
def test_zoom_at_a_focus_that_rests_is_no_breathing(frames, grown, seed):
    focus = 0.5 * (1 + 0.02 * np.random.default_rng(seed).uniform(-1, 1, frames))
    found = seen(focus, np.linspace(0.0, grown, frames))
    assert found.growth == 0.0 and found.describe() == ""


def test_tracking_noise_during_a_pull_and_a_zoom_of_a_fifth_are_no_breathing():
    rng, focus = np.random.default_rng(0), np.linspace(0.3, 0.6, 40)
    assert seen(focus, 0.003 * rng.standard_normal(40)).growth == 0.0
    assert seen(focus, np.linspace(0.0, 0.25, 40)).growth == 0.0
    assert seen(focus[:3], np.linspace(0.0, 0.03, 3)).growth == 0.0


@pytest.mark.slow
@pytest.mark.needs_gl
@pytest.mark.parametrize("growth", [0.025, 0.0])
def test_run_says_that_the_lens_breathes_where_it_does(tmp_path, capsys, growth):
    for index in range(36):
        share = 0.5 - 0.5 * np.cos(np.pi * index / 35)
        rgb = shots.plate(2, intercept=(1.4 - 0.7 * share) * shots.INTERCEPT)
        middle = shots.WIDTH / 2, shots.HEIGHT / 2
        matrix = cv2.getRotationMatrix2D(middle, 0.0, float(np.exp(-growth * share)))
        size = shots.WIDTH, shots.HEIGHT
        grown = cv2.warpAffine(rgb, matrix, size, borderMode=cv2.BORDER_REFLECT)
        noise = np.random.default_rng(index).normal(0, 1, grown.shape)
        shots.write_png(tmp_path / f"in_{index:04d}.png", np.uint8(np.clip(grown + noise, 0, 255)))
    glb = shots.cube_glb(tmp_path / "anim.glb")
    plate, out = str(tmp_path / "in_%04d.png"), str(tmp_path / "out_%04d.png")
    words = [plate, str(glb), out, "--input-rate", "25", "--preset", "draft", "--json"]
    assert main(words) == 0
    notes = json.loads(capsys.readouterr().out)["notes"]
    told = [note for note in notes if "breathes" in note]
    assert len(told) == bool(growth)
    assert not growth or "% larger" in told[0]
