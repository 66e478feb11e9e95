"""Cameras whose field of view is animated (KHR_animation_pointer)."""

import math

import numpy as np
import pytest
from support.glb_builder import GlbBuilder

from nlens_video.core.errors import SceneError
from nlens_video.core.objects import Playback
from nlens_video.scene import Scene

YFOV = "/cameras/{}/perspective/yfov"


def load(builder, tmp_path, playback=None):
    path = builder.write(tmp_path / "scene.glb")
    return Scene.load(path, playback) if playback else Scene.load(path)


def zooming(times, values, interpolation="LINEAR", **fields):
    """A quad, and a camera whose field of view is animated."""
    builder = GlbBuilder()
    builder.node(mesh=builder.mesh())
    builder.node(camera=builder.camera(0.4), translation=[0, 0, 5.0])
    builder.animation((YFOV.format(0), "pointer", times, values, interpolation), **fields)
    return builder


def yfov_at(scene, time_s, **name):
    camera = scene.camera(time_s, 200, 100, **name)
    assert camera.fx == camera.fy
    return 2.0 * math.atan(50.0 / camera.fy)


def test_field_of_view_is_interpolated_between_keys_and_held_beyond(tmp_path):
    scene = load(zooming([1, 3], [0.5, 0.9]), tmp_path)
    seen = [yfov_at(scene, time_s) for time_s in (0.0, 1.0, 1.5, 3.0, 9.0)]
    assert seen == pytest.approx([0.5, 0.5, 0.6, 0.9, 0.9], abs=1e-6)


def test_step_keeps_the_field_of_view_of_the_earlier_key(tmp_path):
    scene = load(zooming([0, 1, 2], [0.5, 0.7, 0.9], "STEP"), tmp_path)
    assert [yfov_at(scene, t) for t in (0.99, 1.0, 1.99)] == pytest.approx([0.5, 0.7, 0.7])


def test_cubic_field_of_view_uses_the_tangents_of_its_keys(tmp_path):
    # Keys 0.5 and 0.5 at 0 s and 2 s, out-tangent 0.4: 0.125 * 2 * 0.4 = 0.1 above at the middle.
    values = [[0.0], [0.5], [0.4], [0.0], [0.5], [0.0]]
    scene = load(zooming([0, 2], values, "CUBICSPLINE"), tmp_path)
    assert yfov_at(scene, 1.0) == pytest.approx(0.6)


def test_spline_that_leaves_the_angles_of_a_camera_is_an_error_of_its_moment(tmp_path):
    values = [[0.0], [0.1], [-4.0], [0.0], [0.1], [0.0]]
    scene = load(zooming([0, 2], values, "CUBICSPLINE"), tmp_path)
    assert yfov_at(scene, 0.0) == pytest.approx(0.1)
    with pytest.raises(SceneError, match="field of view is -0.9 at 1 s"):
        scene.camera(1.0, 200, 100)


@pytest.mark.parametrize("wrong", [0.0, -0.5, 3.2])
def test_field_of_view_that_is_no_angle_is_an_error(tmp_path, wrong):
    with pytest.raises(SceneError, match="no angles between 0 and pi"):
        load(zooming([0, 1], [0.5, wrong]), tmp_path)


def test_each_camera_zooms_by_its_own_channel(tmp_path):
    builder = zooming([0, 1], [0.5, 0.9])
    builder.node(camera=builder.camera(0.6, name="close"))
    builder.node(camera=builder.camera(0.7, name="still"))
    builder.animation((YFOV.format(1), "pointer", [0, 1], [0.6, 0.2], "LINEAR"))
    scene = load(builder, tmp_path)
    seen = [yfov_at(scene, 1.0, name=name) for name in (None, "close", "still")]
    assert seen == pytest.approx([0.9, 0.2, 0.7])


def test_zoom_follows_the_plates_time_whichever_animation_plays(tmp_path):
    builder = zooming([0, 4], [0.5, 0.9], name="zoom")
    slide = [[0, 0, 0], [8, 0, 0]]
    builder.animation((0, "translation", [0, 2], slide, "LINEAR"), name="walk")
    playback = Playback(animation="walk", loop=True, speed=3.0)
    assert yfov_at(load(builder, tmp_path, playback), 2.0) == pytest.approx(0.7)


def test_scene_whose_camera_only_zooms_moves(tmp_path):
    assert load(zooming([0, 1], [0.5, 0.9]), tmp_path).moves


def test_pointer_to_a_node_is_played_as_its_channel(tmp_path):
    builder = GlbBuilder()
    node = builder.node(mesh=builder.mesh())
    builder.animation(
        (f"/nodes/{node}/translation", "pointer", [0, 1], [[0, 0, 0], [4, 0, 0]], "LINEAR")
    )
    scene = load(builder, tmp_path)
    np.testing.assert_allclose(scene.pose(0.5).meshes[0].positions[:, 0].mean(), 2.0)


def test_file_that_requires_pointers_is_read(tmp_path):
    builder = zooming([0, 1], [0.5, 0.9])
    builder.document["extensionsRequired"] = ["KHR_animation_pointer"]
    assert yfov_at(load(builder, tmp_path), 1.0) == pytest.approx(0.9)


@pytest.mark.parametrize(
    "pointer", ["/materials/0/emissiveFactor", "/cameras/0/perspective/znear", "yfov", ""]
)
def test_pointer_to_anything_else_is_not_played_and_says_so(tmp_path, pointer):
    builder = zooming([0, 1], [0.5, 0.9])
    builder.animation((pointer, "pointer", [0, 1], [0.0, 1.0], "LINEAR"))
    scene = load(builder, tmp_path)
    assert any("1 channels are not played" in line for line in scene.warnings)


def test_all_pointers_that_are_not_played_share_one_line(tmp_path):
    builder = zooming([0, 1], [0.5, 0.9])
    pointers = [f"/materials/{number}/emissiveFactor" for number in range(5)]
    builder.animation(*((one, "pointer", [0, 1], [0.0, 1.0], "LINEAR") for one in pointers))
    lines = [line for line in load(builder, tmp_path).warnings if "not played" in line]
    assert len(lines) == 1 and "5 channels" in lines[0] and pointers[0] in lines[0]


def test_node_has_no_field_of_view_of_its_own(tmp_path):
    builder = zooming([0, 1], [0.5, 0.9])
    builder.animation((0, "yfov", [0, 1], [0.2, 0.2], "LINEAR"))
    scene = load(builder, tmp_path)
    assert any("such as 'yfov'" in line for line in scene.warnings)
    assert yfov_at(scene, 1.0) == pytest.approx(0.9)


@pytest.mark.parametrize(
    ("pointer", "expected"),
    [(YFOV.format(7), "a camera below 1"), ("/nodes/9/scale", "a node below 2")],
)
def test_pointer_beyond_the_file_is_an_error(tmp_path, pointer, expected):
    builder = zooming([0, 1], [0.5, 0.9])
    builder.animation((pointer, "pointer", [0, 1], [0.2, 0.2], "LINEAR"))
    with pytest.raises(SceneError, match=expected):
        load(builder, tmp_path)
