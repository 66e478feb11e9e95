import json
import math

import numpy as np
import pytest
from support.glb_builder import GlbBuilder

INFINITY_PX, FOCUS_M, PITCH, HEIGHT_M = 9.0, 2.5, 0.35, 1.2
SIZE = 960, 576


@pytest.fixture
def plate(tmp_path):
    """A plate as samples/truth writes it: light, labels, camera and lens."""
    cv2 = pytest.importorskip("cv2")
    from truth.develop import write_exr

    folder = tmp_path / "9001_mid"
    folder.mkdir()
    glb = GlbBuilder()
    glb.node(mesh=glb.mesh(), translation=[0.0, 1.0, -3.0])
    turn = [-math.sin(0.5 * PITCH), 0.0, 0.0, math.cos(0.5 * PITCH)]
    glb.node(camera=glb.camera(0.6), translation=[0.0, HEIGHT_M, 0.0], rotation=turn)
    glb.write(folder / "object.glb")
    rng = np.random.default_rng(0)
    light = cv2.GaussianBlur(rng.random((SIZE[1], SIZE[0], 3)).astype(np.float32), (0, 0), 1.0)
    write_exr(
        folder / "bg.exr",
        {c: np.ascontiguousarray(np.float16(light[..., i])) for i, c in enumerate("RGB")},
    )
    np.save(folder / "bg_coc.npy", np.zeros(SIZE[::-1], np.float16))
    (folder / "params.json").write_text(json.dumps({
        "resolution": SIZE, "coc_at_infinity_px": INFINITY_PX, "focus_distance_m": FOCUS_M,
        "ground_plane_y_gltf": 0.0,
    }))  # fmt: skip
    return folder


@pytest.fixture(autouse=True)
def _samples_on_the_path(monkeypatch):
    from support.folders import SAMPLES

    monkeypatch.syspath_prepend(str(SAMPLES))


def test_plane_about_a_place_tells_the_coc_of_the_ground_around(plate):
    from models.lens.rendered import View, plane_of
    from nlens_video.scene.scene import Scene

    middle = 400.0, 430.0
    across, down, slope, offset, _ = plane_of(View.load(plate), middle)
    camera = Scene.load(plate / "object.glb").camera(0.0, *SIZE)
    for x, y in ((400.0, 430.0), (150.0, 560.0), (700.0, 300.0)):
        disparity = camera.disparity_at(np.array([x]), np.array([y]), 0.0)[0, 0]
        expected = INFINITY_PX * (FOCUS_M * disparity - 1.0)
        near = 1.0 + across * (x - middle[0]) + down * (y - middle[1])
        assert offset + slope * (near - 1.0) == pytest.approx(expected, abs=1e-3)


def test_place_above_the_horizon_is_no_ground(plate):
    from models.lens.rendered import View, plane_of

    assert plane_of(View.load(plate), (400.0, -400.0)) is None


@pytest.mark.needs_torch
def test_crops_of_a_plate_are_pictures_of_the_size_of_drawn_ones(plate):
    from models.coc.scene import SIZE as SIDE
    from models.lens.rendered import COUNT, crops

    made = list(crops(plate, np.random.default_rng(1)))
    assert len(made) == COUNT
    assert all(picture.shape == (SIDE, SIDE, 3) for picture, _ in made)
    # of ever other parts: the ground's disparity in the middle differs
    assert len({plane for _, plane in made}) > COUNT // 2
