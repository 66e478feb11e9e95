"""Animation against values worked out by hand."""

import math

import numpy as np
import pytest
from support.glb_builder import GlbBuilder

from nlens_video.core.errors import SceneError
from nlens_video.scene import Scene


def load(builder, tmp_path):
    return Scene.load(builder.write(tmp_path / "scene.glb"))


def moved(builder, tmp_path, path, times, values, interpolation):
    node = builder.node(mesh=builder.mesh())
    builder.animation((node, path, times, values, interpolation))
    return load(builder, tmp_path)


def first(scene, time_s):
    return scene.pose(time_s).meshes[0].positions[0]


def test_linear_translation_is_halfway_between_keys(tmp_path):
    scene = moved(GlbBuilder(), tmp_path, "translation", [1, 3], [[0, 0, 0], [4, 2, -6]], "LINEAR")
    np.testing.assert_allclose(first(scene, 2.0), [1, 0, -3], atol=1e-6)
    assert scene.parts[0].animation.duration_s == 3.0


@pytest.mark.parametrize("interpolation", ["LINEAR", "STEP"])
@pytest.mark.parametrize(
    ("time_s", "x"), [(-5.0, 1.0), (0.0, 1.0), (1.0, 1.0), (2.0, 5.0), (99, 5)]
)
def test_first_and_last_key_hold_outside_the_key_range(tmp_path, interpolation, time_s, x):
    values = [[2, 0, 0], [6, 0, 0]]
    scene = moved(GlbBuilder(), tmp_path, "translation", [1, 2], values, interpolation)
    np.testing.assert_allclose(first(scene, time_s), [x, -1, 0], atol=1e-6)


def test_step_interpolation_keeps_the_earlier_key(tmp_path):
    values = [[0, 0, 0], [4, 0, 0], [8, 0, 0]]
    scene = moved(GlbBuilder(), tmp_path, "translation", [0, 1, 2], values, "STEP")
    assert [first(scene, t)[0] for t in (0.998, 1.0, 1.998, 2.0)] == [-1, 3, 3, 7]


@pytest.mark.parametrize("fps", [24.0, 25.0, 30.0, 30000 / 1001, 60.0])
@pytest.mark.parametrize("clock", [float, lambda time_s: round(1000 * time_s) / 1000])
def test_value_that_steps_is_that_of_the_frame_its_key_was_set_on(tmp_path, fps, clock):
    """Files hold times in float32, and Matroska those of frames in milliseconds."""
    times = (np.arange(48) / fps).astype(np.float32)
    values = np.outer(np.arange(48), [1, 0, 0])
    scene = moved(GlbBuilder(), tmp_path, "translation", times, values, "STEP")
    shown = [first(scene, clock(frame / fps))[0] + 1.0 for frame in range(48)]
    assert shown == list(range(48))


@pytest.mark.parametrize("fps", [24.0, 30.0])
def test_place_is_left_at_once_right_before_the_frame_of_its_key(tmp_path, fps):
    times, values = (np.arange(3) / fps).astype(np.float32), [[0, 0, 0], [4, 0, 0], [8, 0, 0]]
    scene = moved(GlbBuilder(), tmp_path, "translation", times, values, "STEP")
    jumps = scene.jumps(0.5 / fps, 1.5 / fps)
    assert jumps == [pytest.approx(1.0 / fps, abs=2e-3)]
    assert jumps[0] < 1.0 / fps
    assert [first(scene, jumps[0] + side)[0] for side in (-1e-6, 1e-6)] == [-1, 3]


def test_cubic_spline_scales_its_tangents_by_the_length_of_the_interval(tmp_path):
    # Keys at 0 s and 2 s, values 0 and 0, out-tangent 1 per second, in-tangent 0.
    # At u = 0.5: (u^3 - 2 u^2 + u) * 2 s * 1 = 0.125 * 2 = 0.25.
    values = [[[0, 0, 0], [0, 0, 0], [1, 0, 0]], [[0, 0, 0], [0, 0, 0], [0, 0, 0]]]
    scene = moved(GlbBuilder(), tmp_path, "translation", [0, 2], values, "CUBICSPLINE")
    np.testing.assert_allclose(first(scene, 1.0), [-0.75, -1, 0], atol=1e-6)
    np.testing.assert_allclose(first(scene, 5.0), [-1, -1, 0], atol=1e-6)


def test_cubic_spline_uses_the_in_tangent_of_the_later_key(tmp_path):
    # (u^3 - u^2) * span * tangent = -0.125 * 1 * 8 = -1 at u = 0.5.
    values = [[[9, 9, 9], [0, 0, 0], [0, 0, 0]], [[8, 0, 0], [0, 0, 0], [9, 9, 9]]]
    scene = moved(GlbBuilder(), tmp_path, "translation", [0, 1], values, "CUBICSPLINE")
    np.testing.assert_allclose(first(scene, 0.5), [-2, -1, 0], atol=1e-6)


def about_z(degrees):
    half = math.radians(degrees) / 2
    return [0, 0, math.sin(half), math.cos(half)]


@pytest.mark.parametrize("sign", [1, -1])
def test_rotation_is_interpolated_along_the_shorter_arc(tmp_path, sign):
    target = [sign * v for v in about_z(90)]
    scene = moved(GlbBuilder(), tmp_path, "rotation", [0, 3], [about_z(0), target], "LINEAR")
    # A third of 90 degrees: the corner (-1, -1) turned by 30 degrees.
    c, s = math.cos(math.radians(30)), math.sin(math.radians(30))
    np.testing.assert_allclose(first(scene, 1.0), [-c + s, -s - c, 0], atol=1e-6)


def test_cubic_rotation_is_normalised(tmp_path):
    zero = [0, 0, 0, 0]
    values = [[zero, about_z(0), zero], [zero, about_z(180), zero]]
    scene = moved(GlbBuilder(), tmp_path, "rotation", [0, 1], values, "CUBICSPLINE")
    np.testing.assert_allclose(first(scene, 0.5), [1, -1, 0], atol=1e-6)


def test_child_transforms_are_composed_with_their_parents(tmp_path):
    builder = GlbBuilder()
    leaf = builder.node(root=False, mesh=builder.mesh(), translation=[1, 0, 0], scale=[2, 2, 2])
    arm = builder.node(root=False, children=[leaf], rotation=about_z(90))
    builder.node(children=[arm], scale=[3, 3, 3], translation=[0, 0, 5])
    # (-1,-1,0) * 2 + (1,0,0) = (-1,-2,0); turned by 90 degrees: (2,-1,0); times 3, plus (0,0,5).
    np.testing.assert_allclose(first(load(builder, tmp_path), 0.0), [6, -3, 5], atol=1e-5)


def test_node_matrix_is_column_major(tmp_path):
    builder = GlbBuilder()
    columns = [0, 1, 0, 0, -1, 0, 0, 0, 0, 0, 1, 0, 7, 8, 9, 1]
    builder.node(mesh=builder.mesh(), matrix=columns)
    np.testing.assert_allclose(first(load(builder, tmp_path), 0.0), [8, 7, 9], atol=1e-6)


def test_animations_of_different_nodes_play_together_and_alternatives_do_not(tmp_path):
    builder = GlbBuilder()
    a, b = builder.node(mesh=builder.mesh()), builder.node(mesh=builder.mesh())
    for node, x, name in ((a, 2, "one"), (b, 4, "two"), (a, 8, "other")):
        values = [[0, 0, 0], [x, 0, 0]]
        builder.animation((node, "translation", [0, 1], values, "LINEAR"), name=name)
    scene = load(builder, tmp_path)
    posed = scene.pose(1.0)
    assert [mesh.positions[0][0] for mesh in posed.meshes] == [1, 3]
    (line,) = scene.warnings
    assert line.endswith(
        "one, two play; other would move the same parts: choose with --animation NAME"
    )


@pytest.mark.parametrize("times", [[0, 0], [1, 0.5]])
def test_key_times_that_do_not_increase_are_refused(tmp_path, times):
    with pytest.raises(SceneError, match="do not increase"):
        moved(GlbBuilder(), tmp_path, "translation", times, [[0, 0, 0], [1, 1, 1]], "LINEAR")


def test_too_few_values_for_the_keys_are_refused(tmp_path):
    with pytest.raises(SceneError, match="3 numbers, expected 6"):
        moved(GlbBuilder(), tmp_path, "translation", [0, 1], [[0, 0, 0]], "LINEAR")
