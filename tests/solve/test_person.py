"""Scale by a person on the ground."""

import numpy as np
import pytest
from support import marker_plates as plates

from nlens_video.cameras.solved import CameraKey, SolvedCamera
from nlens_video.core.errors import InputError
from nlens_video.solve.person import scaled_by_person


def camera(height=1.6, pitch_deg=-12.0, roll_deg=4.0):
    key = CameraKey(
        index=0, pts_s=0.0, fov_x_deg=60.0,
        world_to_camera=np.linalg.inv(plates.pose(pitch_deg, roll_deg, height)),
    )  # fmt: skip
    return SolvedCamera(width=960, height=512, keys=(key,))


def box(solved, foot, tall):
    """The frame's box of a thin person who stands at a point of the ground."""
    view = solved.at(0.0)
    ends = np.array([foot, foot + [0.0, tall, 0.0]])
    columns, rows = view.pixels(view.to_camera(ends)).T / [[960.0], [512.0]]
    middle = columns.mean()
    return middle - 0.01, rows[1], middle + 0.01, rows[0]


@pytest.mark.parametrize("foot", [(0.0, 0.0, -6.0), (1.5, 0.0, -5.0)])
def test_known_height_of_a_person_makes_the_unit_a_metre(foot):
    true = camera(height=1.62, roll_deg=0.0)
    seen = box(true, np.array(foot), 1.8)
    found = scaled_by_person(camera(height=7.0, roll_deg=0.0), seen, 1.8)
    assert found.keys[0].world_from_camera[1, 3] == pytest.approx(1.62, rel=1e-6)
    assert found.scale == "metres" and "a person of 1.8 m" in found.method


def test_roll_changes_the_scale_little():
    true = camera(height=1.62)
    found = scaled_by_person(camera(height=1.0), box(true, np.array([0.4, 0.0, -6.0]), 1.8), 1.8)
    assert found.keys[0].world_from_camera[1, 3] == pytest.approx(1.62, rel=0.01)


def test_feet_above_the_horizon_are_refused():
    with pytest.raises(InputError, match="above the solved camera's horizon"):
        scaled_by_person(camera(), (0.4, 0.01, 0.5, 0.1), 1.8)
