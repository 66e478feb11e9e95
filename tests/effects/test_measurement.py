"""Shutter angle measured from the motion blur of a panning camera, which is not defocus."""

import cv2
import numpy as np
import pytest
from support import shots
from support.effects.synthetic_frames import panned, pictures, scene

from nlens_video.core.lens_fit import LensFit
from nlens_video.effects.camera.grain import to_code, to_linear
from nlens_video.effects.measurement import shutter_angle
from nlens_video.effects.motion_blur import line_kernel
from nlens_video.stages.p_projection import project_to_ground
from nlens_video.stages.r_regression import FitLens


@pytest.mark.parametrize("way", [(12.0, 0.0), (0.0, 14.0), (-9.0, 12.0), (25.0, 0.0)], ids=str)
@pytest.mark.parametrize("share", [0.5, 0.75])
def test_shutter_angle_is_measured_from_a_panning_camera(way, share):
    angle = shutter_angle(panned(scene(0, slope=0.9), way, share))
    assert angle == pytest.approx(360 * share, rel=0.15)


@pytest.mark.parametrize(
    ("way", "share"), [((0.0, 0.0), 0.0), ((3.0, 0.0), 0.5), ((14.0, 0.0), 0.0)], ids=str
)
def test_plate_without_motion_blur_gives_no_shutter_angle(way, share):
    for seed in range(3):
        assert shutter_angle(panned(scene(seed), way, share)) is None


def test_single_picture_gives_no_shutter_angle():
    assert shutter_angle(pictures(scene(1), 1)) is None


@pytest.mark.slow
def test_motion_blur_of_a_pan_is_not_measured_as_softness():
    from nlens_video.networks.model_store import find_model
    from nlens_video.networks.onnx_networks import OnnxCocNetwork
    from nlens_video.stages.f_coc import estimate_coc

    network = OnnxCocNetwork(find_model("coc").path)
    square = np.array([[-0.3, 0, -1.4], [0.3, 0, -1.4], [0.3, 0, -2.0], [-0.3, 0, -2.0]])
    ground = project_to_ground(square[[[0, 1, 2], [0, 2, 3]]], shots.camera(), 0.0)
    still = shots.plate().astype(np.float32) / 255
    pan_px = 12.0 * shots.WIDTH / 960
    light = cv2.filter2D(to_linear(still), -1, line_kernel(np.array([pan_px, 0.0])))
    lenses: list[LensFit] = [
        FitLens()(estimate_coc(network, rgb), ground, 0).fit for rgb in (still, to_code(light))
    ]
    disparity = np.linspace(0.3, 0.8, 20, dtype=np.float32)
    change = lenses[1].coc_px(disparity) - lenses[0].coc_px(disparity)
    assert np.abs(change).max() < 1.0
