"""Options that place an object replace the camera of its file, which is said."""

import pytest
from support import shots
from support.camera_files import path_of

from nlens_video.core.placement import GroundPlacing
from nlens_video.core.settings import ObjectSettings
from nlens_video.graph.base.objects_on_ground import load_scene, stage
from nlens_video.graph.base.view import View


def notes_of(glb, wish):
    objects = ObjectSettings(glb=glb, on_ground=wish)
    view = View(width=960, height=512, solved=path_of(1))
    return [note for note in stage(objects, load_scene(objects), view).notes
            if "own camera" in note]  # fmt: skip


@pytest.mark.parametrize(
    ("wish", "option"),
    [
        (GroundPlacing(size=0.3), "--size"),
        (GroundPlacing(at=(0.5, 0.8), size=0.3), "--at"),
        (GroundPlacing(yaw_deg=20.0), "--yaw"),
    ],
)
def test_camera_of_the_file_that_is_not_used_is_told(tmp_path, wish, option):
    own = shots.cube_glb(tmp_path / "cam.glb", sun=False)
    said = [
        f"the file's own camera is not used: {option} places the object; leave {option} out to "
        "use that camera"
    ]
    assert notes_of(own, wish) == said
    assert notes_of(own, None) == []
    bare = shots.cube_glb(tmp_path / "bare.glb", camera=False, sun=False)
    assert notes_of(bare, wish) == []
