"""Selection of animations, their speed, offset and loop."""

import math

import numpy as np
import pytest
from support.glb_builder import GlbBuilder

from nlens_video.core.errors import SceneError, UsageError
from nlens_video.core.objects import Playback
from nlens_video.scene import Scene


def clips(*names):
    """A square that slides 1, 2, 4 … along x in 2 s, an animation each."""
    builder = GlbBuilder()
    node = builder.node(mesh=builder.mesh())
    for number, name in enumerate(names):
        far = [float(2**number), 0, 0]
        builder.animation((node, "translation", [0, 2], [[0, 0, 0], far], "LINEAR"), name=name)
    return builder


def x_at(builder, tmp_path, time_s, **playback):
    scene = Scene.load(builder.write(tmp_path / "scene.glb"), Playback(**playback))
    return float(scene.pose(time_s).meshes[0].positions[:, 0].mean())


@pytest.mark.parametrize(
    ("which", "x"), [("all", 1), ("walk", 1), ("run", 2), ("1", 2), ("0", 4), ("3", 8)]
)
def test_animation_is_selected_by_name_or_index(tmp_path, which, x):
    builder = clips("walk", "run", "0", "")
    assert x_at(builder, tmp_path, 2.0, animation=which) == pytest.approx(x)


@pytest.mark.parametrize("which", ["hop", "2", "-1", "", "1.0", "9" * 5000, "²"])
def test_unknown_animation_error_lists_the_animations(tmp_path, which):
    with pytest.raises(SceneError, match=r"expected all or one of walk, run$"):
        x_at(clips("walk", "run"), tmp_path, 0.0, animation=which)


def test_error_for_a_file_without_animations_states_it(tmp_path):
    with pytest.raises(SceneError, match="the file has none; leave --animation out"):
        x_at(clips(), tmp_path, 0.0, animation="walk")


def test_animation_holds_its_last_key_or_loops(tmp_path):
    builder = clips("walk")
    assert x_at(builder, tmp_path, 5.0) == pytest.approx(1.0)
    assert x_at(builder, tmp_path, 5.0, loop=True) == pytest.approx(0.5)


def test_speed_and_offset_apply_to_the_animations_time(tmp_path):
    builder = clips("walk")
    assert x_at(builder, tmp_path, 0.0, offset_s=0.5) == pytest.approx(0.25)
    assert x_at(builder, tmp_path, 0.5, offset_s=0.5, speed=2.0) == pytest.approx(0.75)
    assert x_at(builder, tmp_path, 1.0, offset_s=-1.0, speed=0.5) == pytest.approx(0.0)
    assert x_at(builder, tmp_path, 0.0, offset_s=-0.5, loop=True) == pytest.approx(0.75)


@pytest.mark.parametrize(
    "wrong", [{"speed": 0}, {"speed": -1}, {"speed": math.nan}, {"offset_s": math.inf}]
)
def test_invalid_speed_or_offset_is_a_usage_error(wrong):
    with pytest.raises(UsageError, match="animation"):
        Playback(**wrong)


def test_camera_animation_follows_the_plates_time(tmp_path):
    builder = clips("walk", "run")
    rig = builder.node(children=[2], root=True)
    assert builder.node(camera=builder.camera(), root=False) == 2
    path = [[0, 0, 0], [0, 8, 0]]
    builder.animation((rig, "translation", [0, 4], path, "LINEAR"), name="match-move")
    playback = Playback(animation="run", loop=True, speed=3.0, offset_s=1.0)
    scene = Scene.load(builder.write(tmp_path / "scene.glb"), playback)
    height = scene.camera(3.0, 64, 48).world_from_camera[1, 3]
    assert height == pytest.approx(6.0)
    assert scene.pose(0.0).meshes[0].positions[:, 0].mean() == pytest.approx(1.0)


def walk_past_a_camera(path, *, rigged=False, one_clip=False, lamp=False):
    """A square that slides 1 along x in 1 s; a camera, rig or lamp that moves for 4 s; a zoom."""
    builder = GlbBuilder()
    square = builder.node(mesh=builder.mesh(), root=not rigged)
    camera = builder.node(camera=builder.camera(), root=not rigged)
    rig = builder.node(children=[square, camera]) if rigged else camera
    walk = (square, "translation", [0, 1], [[0, 0, 0], [1, 0, 0]], "LINEAR")
    moved = builder.light("point") if lamp else rig
    rise = [[0, 0, 0], [0, 8, 0], [0, 8, 0]]
    longer = (moved, "translation", [0, 2, 4], rise, "STEP")
    if one_clip:
        builder.animation(walk, longer, name="Scene")
    else:
        builder.animation(walk, name="Walk")
        builder.animation(longer, name="Longer")
    field_of_view = ("/cameras/0/perspective/yfov", "pointer", [0, 7], [0.5, 0.7], "LINEAR")
    builder.animation(field_of_view, name="Zoom")
    return builder.write(path)


@pytest.mark.parametrize("one_clip", [False, True])
def test_loop_is_as_long_as_what_moves_the_object_not_the_camera(tmp_path, one_clip):
    path = walk_past_a_camera(tmp_path / "scene.glb", one_clip=one_clip)
    scene = Scene.load(path, Playback(loop=True))
    at = [float(scene.pose(t).meshes[0].positions[:, 0].mean()) for t in (0.5, 1.25, 3.75)]
    assert at == pytest.approx([0.5, 0.25, 0.75])
    assert scene.camera(2.0, 64, 48).world_from_camera[1, 3] == pytest.approx(8.0)
    assert scene.jumps(0.5, 1.25) == [1.0]


def test_steps_of_the_camera_are_no_jumps_of_the_object(tmp_path):
    scene = Scene.load(walk_past_a_camera(tmp_path / "scene.glb"))
    assert scene.parts[0].jumps(1.5, 2.5) == []
    assert scene.parts[0].end_s == 1.0


@pytest.mark.parametrize("shared", [{"rigged": True}, {"lamp": True}])
def test_loop_includes_a_parent_that_carries_camera_and_object_and_lamps(tmp_path, shared):
    path = walk_past_a_camera(tmp_path / "scene.glb", **shared)
    scene = Scene.load(path, Playback(loop=True))
    assert scene.pose(3.0).meshes[0].positions[:, 0].mean() == pytest.approx(1.0)
    assert scene.pose(4.5).meshes[0].positions[:, 0].mean() == pytest.approx(0.5)


def test_chosen_animation_moves_the_camera_too(tmp_path):
    builder = clips("walk", "run")
    rig = builder.node(children=[2], root=True)
    assert builder.node(camera=builder.camera(), root=False) == 2
    for shot, height in (("first", 8.0), ("second", 4.0)):
        path = [[0, 0, 0], [0, height, 0]]
        builder.animation((rig, "translation", [0, 1], path, "LINEAR"), name=shot)
    glb = builder.write(tmp_path / "scene.glb")
    heights = {
        name: Scene.load(glb, Playback(animation=name)).camera(1.0, 64, 48).world_from_camera[1, 3]
        for name in ("first", "second", "walk", "all")
    }
    assert heights == pytest.approx({"first": 8.0, "second": 4.0, "walk": 8.0, "all": 8.0})


def test_scene_tells_when_loops_begin_anew_and_keys_change_at_once(tmp_path):
    builder = GlbBuilder()
    node = builder.node(mesh=builder.mesh())
    path = [[0, 0, 0], [1, 0, 0], [1, 0, 0], [3, 0, 0]]
    builder.animation((node, "translation", [0, 1, 2, 4], path, "STEP"))
    glb = builder.write(tmp_path / "steps.glb")
    assert Scene.load(glb).jumps(-1.0, 9.0) == pytest.approx([1.0, 4.0], abs=2e-3)
    twice = Scene.load(glb, Playback(speed=2.0, offset_s=1.0))
    assert twice.jumps(-1.0, 9.0) == pytest.approx([0.0, 1.5], abs=2e-3)
    looped = Scene.load(glb, Playback(loop=True))
    assert looped.jumps(3.5, 5.5) == pytest.approx([4.0, 4.0, 5.0], abs=2e-3)
    assert looped.jumps(0.0, 4.0) == []
    assert looped.jumps(4.1, 4.9) == []


def test_animations_of_different_nodes_play_together(tmp_path):
    builder = clips("walk")
    other = builder.node(mesh=0)
    builder.animation((other, "scale", [0, 1], [[1, 1, 1], [3, 3, 3]], "LINEAR"), name="grow")
    scene = Scene.load(builder.write(tmp_path / "scene.glb"))
    slid, grown = scene.pose(2.0).meshes
    np.testing.assert_allclose(slid.positions[:, 0].mean(), 1.0)
    np.testing.assert_allclose(np.abs(grown.positions[:, 0]), 3.0)
    assert scene.warnings == ()


def test_unsupported_animation_channels_give_one_warning(tmp_path):
    builder = clips("walk")
    for _ in range(50):
        channel = {"sampler": 0, "target": {"path": "pointer"}}
        builder.document["animations"][0]["channels"].append(channel)
    (line,) = Scene.load(builder.write(tmp_path / "scene.glb")).warnings
    assert "50 channels are not played" in line
