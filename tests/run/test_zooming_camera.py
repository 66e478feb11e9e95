"""A camera that zooms: the object grows and blurs as its field of view says."""

import math

import numpy as np
import pytest
from support.glb_builder import QUAD_FACES, GlbBuilder

from nlens_video import Compositor
from nlens_video.cameras.solved import CameraKey, SolvedCamera
from nlens_video.core.lens_fit import LensFit
from nlens_video.core.optics import Distortion
from nlens_video.effects.camera.distortion_apply import DistortionMap
from nlens_video.effects.measurement import Measurement
from nlens_video.graph.base.view import View
from nlens_video.graph.nodes.camera import overscan_px
from nlens_video.scene import Scene

pytestmark = pytest.mark.needs_gl
WIDTH, HEIGHT = 320, 180
WIDE, LONG = 0.9, 0.5  # fields of view at 0 s and 1 s [rad]
CARD = np.array([[-0.3, -0.2, -3.0], [0.3, -0.2, -3.0], [0.3, 0.2, -3.0], [-0.3, 0.2, -3.0]])


def zooming_shot(path):
    """A white card three metres before a camera that zooms in."""
    builder = GlbBuilder()
    white = {
        "pbrMetallicRoughness": {"baseColorFactor": [1, 1, 1, 1]},
        "extensions": {"KHR_materials_unlit": {}},
    }
    paint = builder.add("materials", white)
    facing = np.tile(np.array([[0, 0, 1]], np.float32), (4, 1))
    builder.node(mesh=builder.mesh(CARD, QUAD_FACES, material=paint, NORMAL=facing))
    builder.node(camera=builder.camera(WIDE))
    pointer = "/cameras/0/perspective/yfov"
    builder.animation((pointer, "pointer", [0.0, 1.0], [WIDE, LONG], "LINEAR"))
    return builder.write(path)


def focal(time_s):
    """Focal length worked out without the package [px]."""
    return 0.5 * HEIGHT / math.tan(0.5 * (WIDE + time_s * (LONG - WIDE)))


def linear(picture):
    coded = picture[..., 1].astype(np.float64)
    return np.where(coded <= 0.04045, coded / 12.92, ((coded + 0.055) / 1.055) ** 2.4)


def test_object_grows_as_the_field_of_view_narrows(tmp_path):
    black = np.zeros((HEIGHT, WIDTH, 3), np.float32)
    with Compositor(zooming_shot(tmp_path / "zoom.glb"), effects="none") as lens:
        for time_s in (0.0, 0.3, 1.0):
            light = linear(lens.process(black, time=time_s))
            wide, tall = light[HEIGHT // 2].sum(), light[:, WIDTH // 2].sum()
            assert wide == pytest.approx(0.6 * focal(time_s) / 3.0, abs=0.3)
            assert tall == pytest.approx(0.4 * focal(time_s) / 3.0, abs=0.3)


def test_circle_of_confusion_grows_with_the_square_of_the_focal_length(tmp_path):
    # At 3 m: 30 / 3 - 4 = 6 px at first.
    fit = LensFit(slope=30.0, intercept=-4.0, width=WIDTH, height=HEIGHT)
    black = np.zeros((HEIGHT, WIDTH, 3), np.float32)
    with Compositor(zooming_shot(tmp_path / "zoom.glb"), effects="defocus", fit=fit) as lens:
        for time_s in (0.0, 0.5, 1.0):
            row = linear(lens.process(black, time=time_s))[HEIGHT // 2]
            coc_px = 6.0 * (focal(time_s) / focal(0.0)) ** 2
            edge = 0.5 * WIDTH + 0.3 * focal(time_s) / 3.0
            # The edge of a blurred card: the integral of a disc, whose variance is D^2 / 16.
            step = -np.diff(row[WIDTH // 2 :])
            at = np.arange(WIDTH // 2 + 1, WIDTH) - edge
            spread = math.sqrt((step * at**2).sum() / step.sum())
            assert spread == pytest.approx(coc_px / 4.0, rel=0.08)


def test_zoom_of_a_camera_file_is_that_of_the_object_and_its_blur(tmp_path):
    fovs = [2.0 * math.degrees(math.atan(0.5 * WIDTH / focal(time_s))) for time_s in (0.0, 1.0)]
    keys = tuple(
        CameraKey(index=24 * n, pts_s=float(n), world_to_camera=np.eye(4), fov_x_deg=fov)
        for n, fov in enumerate(fovs)
    )
    file = tmp_path / "camera.json"
    file.write_text(SolvedCamera(width=WIDTH, height=HEIGHT, keys=keys, ground_y=-1.0).to_json())
    fit = LensFit(slope=30.0, intercept=-4.0, width=WIDTH, height=HEIGHT)
    black = np.zeros((HEIGHT, WIDTH, 3), np.float32)
    shot = zooming_shot(tmp_path / "zoom.glb")
    widths = []
    for effects in ("none", "defocus"):
        with Compositor(shot, effects=effects, fit=fit, camera_from=file) as lens:
            row = linear(lens.process(black, time=1.0))[HEIGHT // 2]
        assert row.sum() == pytest.approx(0.6 * focal(1.0) / 3.0, rel=0.02)
        widths.append(int((row > 1e-3).sum()))
    # Twice half a CoC, of 6 px at first, more than the sharp card.
    assert widths[1] - widths[0] == pytest.approx(6.0 * (focal(1.0) / focal(0.0)) ** 2, abs=2.0)


def test_object_is_motion_blurred_by_a_zoom(tmp_path):
    black = np.zeros((HEIGHT, WIDTH, 3), np.float32)
    shot = zooming_shot(tmp_path / "zoom.glb")
    with Compositor(shot, effects="motion-blur", fps=2.0, shutter_angle=360.0) as lens:
        row = linear(lens.process(black, time=0.5))[HEIGHT // 2]
    # Open from 0.25 s to 0.75 s, in which the edge moves from one place to the other.
    begin, end = (0.5 * WIDTH + 0.1 * focal(time_s) for time_s in (0.25, 0.75))
    partly = np.flatnonzero((row > 0.03) & (row < 0.97))
    partly = partly[partly > WIDTH // 2]
    assert partly.min() == pytest.approx(begin, abs=1.6)
    assert partly.max() + 1 == pytest.approx(end, abs=1.6)


def test_overscan_is_that_of_the_widest_field_of_view(tmp_path):
    barrel = Distortion(k1=-0.1, focal_normalized=True)
    measured = {
        "distortion": Measurement(
            effect="distortion", value=1.0, threshold=0.0, unit="px", evidence="given",
            model=barrel, cost_ms=0.0,
        )
    }  # fmt: skip
    scene = Scene.load(zooming_shot(tmp_path / "zoom.glb"))
    view = View(width=WIDTH, height=HEIGHT)
    margins = [
        DistortionMap.of(barrel, scene.camera(time_s, WIDTH, HEIGHT)).margin for time_s in (0, 1)
    ]
    assert margins[0] > margins[1] + 2
    assert overscan_px(scene, view, measured) == margins[0]
    zoomed_out = GlbBuilder()
    zoomed_out.node(mesh=zoomed_out.mesh())
    zoomed_out.node(camera=zoomed_out.camera(LONG))
    pointer = "/cameras/0/perspective/yfov"
    zoomed_out.animation((pointer, "pointer", [0.0, 1.0], [LONG, WIDE], "LINEAR"))
    scene = Scene.load(zoomed_out.write(tmp_path / "out.glb"))
    assert overscan_px(scene, view, measured) == margins[0]
