"""Which of several cameras of a file is used is said, unless it is asked for or none is."""

from msgspec.structs import replace
from support.glb_builder import GlbBuilder

from nlens_video.core.placement import Placement
from nlens_video.core.settings import ObjectSettings
from nlens_video.graph.base.view import View, choose_camera
from nlens_video.scene import Scene


def test_of_several_cameras_the_one_in_use_and_the_others_are_told(tmp_path):
    builder = GlbBuilder()
    builder.node(mesh=builder.mesh())
    for name in ("Main", "Aux", "Top"):
        builder.node(camera=builder.camera(name=name), translation=[0, 0, 4])
    scene = Scene.load(builder.write(tmp_path / "cameras.glb"))
    objects = ObjectSettings(glb=scene.path)
    view = View(width=64, height=48)
    _, notes = choose_camera(objects, scene, view)
    assert notes == ("of 3 cameras 'Main' is used; --camera NAME uses another: Aux, Top",)
    assert choose_camera(objects, scene, replace(view, camera="Aux"))[1] == ()
    placed = replace(objects, placing=Placement(at=(0.5, 0.8), size=0.3))
    _, (note,) = choose_camera(placed, scene, view)
    assert "cameras" not in note
