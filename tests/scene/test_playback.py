"""Which animation plays, and when."""

import math

import numpy as np
import pytest
from support.glb_builder import GlbBuilder

from nlens_video.core.errors import SceneError, UsageError
from nlens_video.core.settings import Playback
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
def test_an_animation_is_chosen_by_its_name_else_by_its_number(tmp_path, which, x):
    builder = clips("walk", "run", "0", "")
    assert x_at(builder, tmp_path, 2.0, animation=which) == pytest.approx(x)


@pytest.mark.parametrize("which", ["hop", "2", "-1", "", "1.0", "9" * 5000, "²"])
def test_an_animation_that_is_not_there_is_one_line_that_lists_those_that_are(tmp_path, which):
    with pytest.raises(SceneError, match=r"expected all or one of walk, run$"):
        x_at(clips("walk", "run"), tmp_path, 0.0, animation=which)


def test_a_file_without_animations_says_so(tmp_path):
    with pytest.raises(SceneError, match="the file has none; leave --animation out"):
        x_at(clips(), tmp_path, 0.0, animation="walk")


def test_the_last_key_holds_and_a_loop_starts_again(tmp_path):
    builder = clips("walk")
    assert x_at(builder, tmp_path, 5.0) == pytest.approx(1.0)
    assert x_at(builder, tmp_path, 5.0, loop=True) == pytest.approx(0.5)


def test_speed_and_offset_are_those_of_the_animations_own_time(tmp_path):
    builder = clips("walk")
    assert x_at(builder, tmp_path, 0.0, offset_s=0.5) == pytest.approx(0.25)
    assert x_at(builder, tmp_path, 0.5, offset_s=0.5, speed=2.0) == pytest.approx(0.75)
    assert x_at(builder, tmp_path, 1.0, offset_s=-1.0, speed=0.5) == pytest.approx(0.0)
    assert x_at(builder, tmp_path, 0.0, offset_s=-0.5, loop=True) == pytest.approx(0.75)


@pytest.mark.parametrize(
    "wrong", [{"speed": 0}, {"speed": -1}, {"speed": math.nan}, {"offset_s": math.inf}]
)
def test_a_speed_or_offset_that_makes_no_sense_is_a_usage_error(wrong):
    with pytest.raises(UsageError, match="animation"):
        Playback(**wrong)


def test_a_moving_camera_keeps_the_plates_time_whatever_plays(tmp_path):
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


def test_several_animations_that_move_different_things_play_together(tmp_path):
    builder = clips("walk")
    other = builder.node(mesh=0)
    builder.animation((other, "scale", [0, 1], [[1, 1, 1], [3, 3, 3]], "LINEAR"), name="grow")
    scene = Scene.load(builder.write(tmp_path / "scene.glb"))
    slid, grown = scene.pose(2.0).meshes
    np.testing.assert_allclose(slid.positions[:, 0].mean(), 1.0)
    np.testing.assert_allclose(np.abs(grown.positions[:, 0]), 3.0)
    assert scene.warnings == ()


def test_many_channels_of_a_kind_that_is_not_played_are_one_warning(tmp_path):
    builder = clips("walk")
    for _ in range(50):
        channel = {"sampler": 0, "target": {"path": "pointer"}}
        builder.document["animations"][0]["channels"].append(channel)
    (line,) = Scene.load(builder.write(tmp_path / "scene.glb")).warnings
    assert "50 channels are not played" in line
