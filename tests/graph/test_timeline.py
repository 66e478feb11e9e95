"""Animations that do not play while the plate lasts, and the moments that stand for a shot."""

import pytest
from support import shots
from support.glb_builder import GlbBuilder

from nlens_video.core.objects import Playback
from nlens_video.core.settings import ObjectSettings
from nlens_video.graph.base.objects_on_ground import load_scene
from nlens_video.graph.base.timeline import moments_of, notes_on_timing
from nlens_video.graph.base.view import View

LENGTH_S = 6.0


def animated(path, times, *, still=False, camera=None):
    """A cube that moves between key times, and a camera that does so where it has key times."""
    builder = GlbBuilder()
    node = builder.node(mesh=builder.mesh(shots.CUBE, shots.CUBE_FACES))
    ends = [[0, 0, 0], [0 if still else 1, 0, 0]]
    builder.animation((node, "translation", times, ends, "LINEAR"), name="walk")
    carrier = builder.node(camera=builder.camera(shots.YFOV))
    if camera is not None:
        builder.animation((carrier, "translation", camera, [[0, 0, 3], [1, 0, 3]], "LINEAR"))
    return builder.write(path)


def notes(path, **playback):
    objects = ObjectSettings(glb=path, playback=Playback(**playback))
    view = View(width=64, height=48, length_s=LENGTH_S)
    return list(notes_on_timing(load_scene(objects), view))


def test_animation_that_begins_after_the_plate_is_told_with_the_offset_that_plays_it(tmp_path):
    path = animated(tmp_path / "f1001.glb", [1000 / 24, 1144 / 24])
    assert notes(path) == [
        "the animation runs from 41.67 to 47.67 s, the plate lasts 6 s: the object rests; give "
        "--animation-offset 41.667"
    ]
    assert notes(path, offset_s=41.667) == []


@pytest.mark.parametrize(
    ("times", "playback", "count"),
    [
        ([1.0, 9.0], {}, 0),
        ([6.5, 9.0], {}, 1),
        ([6.5, 9.0], {"speed": 2.0}, 0),
        ([0.0, 4.0], {"offset_s": 4.0}, 1),
        ([0.0, 4.0], {"offset_s": 4.0, "loop": True}, 0),
        ([40.0, 44.0], {"loop": True}, 1),
        ([40.0, 44.0], {"loop": True, "offset_s": 43.0}, 0),
    ],
)
def test_animation_is_told_where_the_plate_shows_none_of_it(tmp_path, times, playback, count):
    assert len(notes(animated(tmp_path / "a.glb", times), **playback)) == count


def test_animation_that_changes_nothing_is_not_told(tmp_path):
    assert notes(animated(tmp_path / "a.glb", [41.0, 47.0], still=True)) == []


def test_camera_that_moves_only_after_the_plate_is_told(tmp_path):
    (note,) = notes(animated(tmp_path / "a.glb", [0.0, 5.0], camera=[41.0, 47.0]))
    assert note.startswith("the camera's animation runs from 41 to 47 s, the plate lasts 6 s")
    assert notes(animated(tmp_path / "b.glb", [0.0, 5.0], camera=[0.0, 47.0])) == []


def test_moments_of_a_shot_end_with_the_plate_or_where_all_rests(tmp_path):
    scene = load_scene(ObjectSettings(glb=animated(tmp_path / "a.glb", [0.0, 4.0])))
    assert moments_of(scene, None)[::8] == (0.0, 4.0)
    assert moments_of(scene, 1.5)[::8] == (0.0, 1.5)
    assert moments_of(scene, 0.0) == (0.0,)
