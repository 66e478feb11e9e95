"""Files with several scenes and cameras: which ones are used."""

import numpy as np
import pytest
from support.glb_builder import GlbBuilder

from nlens_video.core.errors import SceneError
from nlens_video.scene import Scene

BACK = np.array([[0.0, 1.0, 5.0], [0.0, 1.0, 9.0]])


def two_scenes(path, *, names=("day", "night"), default=None):
    """A quad and its camera in each scene: near in the first, far in the second."""
    builder = GlbBuilder()
    for number in range(2):
        mesh = builder.node(root=False, mesh=builder.mesh(), translation=[0, 0, -number * 10.0])
        lens = builder.camera(0.5 + number, name=f"camera of {number}")
        camera = builder.node(root=False, camera=lens, translation=[0, 0, 5.0])
        if number:
            builder.document["scenes"].append({})
        builder.document["scenes"][number] = {"nodes": [mesh, camera], "name": names[number]}
    if default is not None:
        builder.document["scene"] = default
    return builder.write(path)


def depth_of(scene):
    return float(scene.pose(0.0).vertices()[:, 2].mean())


@pytest.mark.parametrize(
    ("default", "asked", "depth"),
    [(None, None, 0.0), (1, None, -10.0), (None, "night", -10.0), (1, "0", 0.0), (1, "day", 0.0)],
)
def test_scene_is_selected_by_default_name_or_index(tmp_path, default, asked, depth):
    path = two_scenes(tmp_path / "a.glb", default=default)
    scene = Scene.load(path, scene=asked)
    assert depth_of(scene) == depth
    assert len(scene.camera_names) == 1 and scene.camera_names[0] == f"camera of {int(depth < 0)}"


def test_other_scenes_of_the_file_are_listed_unless_one_is_selected(tmp_path):
    path = two_scenes(tmp_path / "a.glb")
    told = "of 2 scenes day is shown; --scene NAME shows another: night"
    assert told in Scene.load(path).warnings
    assert not Scene.load(path, scene="day").warnings
    unnamed = Scene.load(two_scenes(tmp_path / "b.glb", names=("", "")))
    assert "of 2 scenes 0 is shown; --scene NAME shows another: 1" in unnamed.warnings


def test_unknown_scene_error_lists_the_scenes(tmp_path):
    path = two_scenes(tmp_path / "a.glb")
    with pytest.raises(SceneError, match="no scene is named 'dusk'; expected one of day, night"):
        Scene.load(path, scene="dusk")
    with pytest.raises(SceneError, match="no scene is named '2'"):
        Scene.load(path, scene="2")
    builder = GlbBuilder()
    builder.node(mesh=builder.mesh())
    del builder.document["scenes"], builder.document["scene"]
    bare = builder.write(tmp_path / "bare.glb")
    with pytest.raises(SceneError, match="it has no scenes, so none is 'day'"):
        Scene.load(bare, scene="day")


def test_motion_of_the_selected_camera_is_used(tmp_path):
    builder = GlbBuilder()
    builder.node(mesh=builder.mesh())
    builder.node(camera=builder.camera(0.6, name="still"), translation=[0, 0, 3])
    rig = builder.camera(0.9, name="moving")
    moving = builder.node(root=False, camera=rig, name="dolly")
    carrier = builder.node(children=[moving])
    builder.animation(
        (carrier, "translation", [0.0, 2.0], BACK, "LINEAR"),
        (moving, "rotation", [0.0, 2.0], [[0, 0, 0, 1], [0, 1, 0, 0]], "LINEAR"),
        name="move",
    )
    scene = Scene.load(builder.write(tmp_path / "a.glb"))
    still = [scene.camera(t, 64, 48, name="still").world_from_camera for t in (0.0, 1.0)]
    assert np.array_equal(still[0], still[1])
    for name in ("moving", "dolly"):
        pose = scene.camera(1.0, 64, 48, name=name).world_from_camera
        assert pose[:3, 3] == pytest.approx([0.0, 1.0, 7.0])  # half-way of its carrier
        assert pose[:3, 2] == pytest.approx([1.0, 0.0, 0.0])  # and of its own half turn
