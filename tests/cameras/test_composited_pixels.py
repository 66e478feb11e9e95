"""An object in a plate whose pixels are not square keeps its shape, whichever camera sees it."""

import json
import math

import numpy as np
import pytest
from support.glb_builder import GlbBuilder

from nlens_video import Compositor
from nlens_video.core.lens_fit import LensFit

WIDTH, HEIGHT, ASPECT, YFOV = 120, 135, 2.0, 0.6  # displayed as 240x135


@pytest.fixture
def files(tmp_path):
    """An upright square before a camera, and that camera in files."""
    builder = GlbBuilder()
    builder.node(mesh=builder.mesh(), translation=[0.0, 0.0, -9.0])
    builder.node(camera=builder.camera(YFOV))
    builder.write(tmp_path / "object.glb")
    fov_x = 2.0 * math.atan(math.tan(0.5 * YFOV) * WIDTH * ASPECT / HEIGHT)
    key = {
        "index": 0, "pts_s": 0.0, "world_to_camera": np.eye(4).tolist(),
        "fov_x_deg": math.degrees(fov_x),
    }  # fmt: skip
    camera = {"width": WIDTH, "height": HEIGHT, "frames": [key]}
    (tmp_path / "camera.json").write_text(json.dumps(camera))
    (tmp_path / "camera.chan").write_text(f"0 0 0 0 0 0 0 {math.degrees(YFOV)}\n")
    return tmp_path


@pytest.mark.parametrize("camera", [None, "camera.json", "camera.chan", "object.glb"])
def test_square_is_displayed_as_a_square(files, camera):
    fit = LensFit(slope=0.0, intercept=0.0, width=WIDTH, height=HEIGHT)
    seen = {} if camera is None else {"camera_from": files / camera}
    plate = np.full((HEIGHT, WIDTH, 3), 128, np.uint8)
    with Compositor(
        files / "object.glb",
        preset="realtime",
        fit=fit,
        effects="none",
        pixel_aspect=ASPECT,
        **seen,
    ) as compositor:
        drawn = np.abs(compositor.process(plate.copy()).astype(int) - plate).max(axis=2) > 8
    columns, rows = np.flatnonzero(drawn.any(axis=0)), np.flatnonzero(drawn.any(axis=1))
    assert ASPECT * (np.ptp(columns) + 1) == pytest.approx(np.ptp(rows) + 1, abs=2.5)
    assert np.ptp(rows) > 20
