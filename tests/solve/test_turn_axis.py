"""The vertical of a camera that turns on the spot."""

import numpy as np
import pytest
from support.camera_paths import rotation

from nlens_video.solve.paths.turn_axis import turn_axis


def turns(yaws_deg, pitches_deg, rolls_deg=0.0):
    """Rotations of a path in the axes of its first frame."""
    parts = np.broadcast_arrays(yaws_deg, pitches_deg, rolls_deg)
    axes = np.array([rotation(*np.radians(one)) for one in zip(*parts, strict=True)])
    return axes[0].T @ axes


def best(axis):
    """Pitch and roll of the largest likelihood [deg]."""
    grid = np.radians(np.stack(np.meshgrid(np.arange(-40, 10, 0.25), np.arange(-8, 8, 0.25)), -1))
    values = axis.log(np.concatenate([grid, np.zeros((*grid.shape[:2], 1))], axis=2))
    return np.degrees(grid.reshape(-1, 2)[values.argmax()])


def test_pan_and_tilt_of_a_level_head_tell_pitch_and_roll():
    steps = np.linspace(0.0, 1.0, 30)
    axis = turn_axis(turns(12 - 24 * steps, -14 + 2 * np.sin(3 * steps)))
    assert best(axis) == pytest.approx((-14.0, 0.0), abs=0.3)
    assert np.degrees(axis.errors) == pytest.approx(1.2, abs=0.05)


def test_rolling_of_a_hand_makes_the_pitch_uncertain():
    steps = np.linspace(0.0, 1.0, 30)
    rolls = np.random.default_rng(3).normal(0.0, 0.5, 30)
    axis = turn_axis(turns(12 - 24 * steps, -14.0, rolls))
    roll_error, pitch_error = np.degrees(axis.errors)
    assert roll_error < 1.6
    assert pitch_error > 2.5
    assert abs(best(axis)[0] + 14.0) < pitch_error


def test_tilt_tells_the_roll_only():
    axis = turn_axis(turns(0.0, np.linspace(-20, -5, 20)))
    assert abs(best(axis)[1]) < 0.3
    assert np.degrees(axis.errors[1]) > 20.0


def test_two_frames_tell_no_axis():
    assert turn_axis(turns([0.0, 5.0], -14.0)) is None
