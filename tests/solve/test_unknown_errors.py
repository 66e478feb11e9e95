"""Numbers that are not finite: none is called measured, and none reaches a file."""

import math

import numpy as np
import pytest
from msgspec.structs import replace

from nlens_video.cameras.solved import CameraErrors, CameraKey, SolvedCamera
from nlens_video.cli.plate_solver import require_numbers
from nlens_video.core.errors import InputError
from nlens_video.solve.paths.bundle import Bundle
from nlens_video.solve.points.observations import Table
from nlens_video.solve.sources import with_sources

SIZE = (640, 360)
KEYS = (CameraKey(index=0, pts_s=0.0, world_to_camera=np.eye(4), fov_x_deg=50.0),)


def bundle(behind=0):
    """Three cameras beside each other before ten points, of which some lie behind them."""
    rng = np.random.default_rng(0)
    points = np.column_stack([rng.uniform(-1, 1, 10), rng.uniform(-1, 1, 10), np.full(10, -5.0)])
    poses = np.tile(np.eye(4), (3, 1, 1))
    poses[:, 0, 3] = (-0.5, 0.0, 0.5)
    numbers, places = np.repeat(np.arange(10), 3), np.tile(np.arange(3), 10)
    local = points[numbers] - poses[places, :3, 3]
    pixels = 600.0 * local[:, :2] / -local[:, 2:] * (1.0, -1.0) + np.array(SIZE) / 2.0
    points[:behind, 2] *= -1.0
    table = Table(numbers, places, pixels + rng.normal(0.0, 0.1, pixels.shape), np.arange(10))
    return Bundle(table, SIZE, poses, np.full(3, 600.0), points)


def test_point_behind_the_cameras_has_an_infinite_cost():
    everything = np.ones(30, bool)
    assert math.isfinite(bundle().cost(everything))
    assert bundle(behind=1).cost(everything) == math.inf
    assert bundle(behind=10).residual_px == math.inf


@pytest.mark.parametrize(("lost", "finite"), [(1, True), (6, False)])
def test_error_of_the_focal_length_is_told_by_points_that_stay_before_the_cameras(
    monkeypatch, lost, finite
):
    def adjusted(self, **_):
        longer = float(np.median(self.focals_px)) > 605.0
        points = self.points * np.where(np.arange(10) < lost * longer, -1.0, 1.0)[:, None]
        return replace(self, points=points)

    monkeypatch.setattr(Bundle, "adjusted", adjusted)
    assert math.isfinite(bundle().focal_noise()) == finite


@pytest.mark.parametrize("unknown", [math.nan, math.inf])
def test_path_whose_errors_are_unknown_is_not_measured(unknown):
    errors = np.array([0.01, 0.01, 0.05])
    sure = with_sources(SIZE, KEYS, errors, None, path="moving", method="")
    assert sure.fov == sure.horizon == "measured"
    for n in range(3):
        vague = errors.copy()
        vague[n] = unknown
        camera = with_sources(SIZE, KEYS, vague, None, path="moving", method="")
        assert (camera.fov if n == 2 else camera.horizon) == "assumed"
        require_numbers(camera)


def test_number_that_is_not_finite_reaches_no_file():
    camera = SolvedCamera(width=96, height=64, keys=KEYS)
    require_numbers(camera)
    for vague in (
        replace(camera, errors=CameraErrors(fov_deg=math.nan)),
        replace(camera, keys=(replace(KEYS[0], world_to_camera=np.full((4, 4), math.nan)),)),
    ):
        with pytest.raises(InputError, match="without finite numbers"):
            require_numbers(vague)
        with pytest.raises(ValueError, match="JSON"):
            vague.to_json()
