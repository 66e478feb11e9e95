"""A match-moved camera: the object stays on its spot of the ground while the fit is kept."""

import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation, Slerp
from support.glb_builder import QUAD_FACES, GlbBuilder

from nlens_video import Compositor
from nlens_video.core.lens_fit import LensFit

pytestmark = pytest.mark.needs_gl
WIDTH, HEIGHT, YFOV = 320, 180, 0.8
MARK = np.array([[-0.3, 0, -3.3], [-0.3, 0, -2.7], [0.3, 0, -2.7], [0.3, 0, -3.3]])
KEYS = [0.0, 0.4, 1.0]
EYES = np.array([[0.0, 1.2, 0.5], [0.3, 1.3, 0.2], [-0.4, 1.1, 0.0]])
TURNS = Rotation.from_euler("YXZ", [[0, -0.35, 0], [0.08, -0.33, 0.05], [-0.1, -0.4, -0.04]])


def moving_shot(path):
    """A white mark on the ground under a hand-held camera."""
    builder = GlbBuilder()
    white = {
        "pbrMetallicRoughness": {"baseColorFactor": [0.8, 0.8, 0.8, 1]},
        "extensions": {"KHR_materials_unlit": {}},
    }
    paint = builder.add("materials", white)
    up = np.tile(np.array([[0, 1, 0]], np.float32), (4, 1))
    builder.node(mesh=builder.mesh(MARK, QUAD_FACES, material=paint, NORMAL=up))
    node = builder.node(camera=builder.camera(YFOV))
    builder.animation(
        (node, "translation", KEYS, EYES, "LINEAR"),
        (node, "rotation", KEYS, TURNS.as_quat(), "LINEAR"),
        name="match-move",
    )
    return builder.write(path)


def expected_centre(time_s):
    """Centroid of the mark's outline in the picture, worked out without the package."""
    eye = np.array([np.interp(time_s, KEYS, axis) for axis in EYES.T])
    seen = Slerp(KEYS, TURNS)(time_s).inv().apply(MARK - eye)
    f = 0.5 * HEIGHT / math.tan(0.5 * YFOV)
    x = 0.5 * WIDTH + f * seen[:, 0] / -seen[:, 2]
    y = 0.5 * HEIGHT - f * seen[:, 1] / -seen[:, 2]
    cross = x * np.roll(y, -1) - np.roll(x, -1) * y
    return np.array(
        [((x + np.roll(x, -1)) * cross).sum(), ((y + np.roll(y, -1)) * cross).sum()]
    ) / (3 * cross.sum())


def light_centre(picture):
    """Centroid of the linear light of a display-coded picture, pixel centres at +0.5."""
    coded = picture[..., 1].astype(np.float64)
    light = np.where(coded <= 0.04045, coded / 12.92, ((coded + 0.055) / 1.055) ** 2.4)
    rows, columns = np.indices(light.shape) + 0.5
    return np.array([(columns * light).sum(), (rows * light).sum()]) / light.sum()


@pytest.mark.parametrize("effects", ["none", "defocus"])
def test_object_stays_on_the_ground_within_a_fifth_of_a_pixel_under_a_moving_camera(
    tmp_path, effects
):
    fit = LensFit(slope=30.0, intercept=-8.0, width=WIDTH, height=HEIGHT)
    black = np.zeros((HEIGHT, WIDTH, 3), np.float32)
    travelled = []
    with Compositor(moving_shot(tmp_path / "moving.glb"), effects=effects, fit=fit) as lens:
        for time_s in (0.0, 0.13, 0.4, 0.61, 0.97, 1.0):
            seen = light_centre(lens.process(black, time=time_s))
            np.testing.assert_allclose(seen, expected_centre(time_s), atol=0.2)
            travelled.append(seen)
            assert effects == "none" or lens.fit == fit
    assert np.ptp(travelled, axis=0).min() > 5.0
