"""Several objects in one file: the footprint for the fit, and mutual occlusion."""

import numpy as np
import pytest
from support.glb_builder import QUAD, QUAD_FACES, GlbBuilder

from nlens_video.core.errors import SceneError
from nlens_video.graph.base.object_source import RenderedObject
from nlens_video.graph.base.view import View
from nlens_video.render.opengl.object_renderer import PyrenderObjectRenderer
from nlens_video.scene import Scene

NORMALS = np.tile(np.array([[0, 0, 1]], np.float32), (4, 1))


def paint(builder, color):
    unlit = {"KHR_materials_unlit": {}}
    pbr = {"baseColorFactor": [*color, 1]}
    return builder.add("materials", {"pbrMetallicRoughness": pbr, "extensions": unlit})


def two_cards(near_first):
    """A red card before a green one, partly over it; the red one rides on a car."""
    builder = GlbBuilder()
    red = builder.mesh(QUAD, QUAD_FACES, material=paint(builder, (1, 0, 0)), NORMAL=NORMALS)
    green = builder.mesh(QUAD, QUAD_FACES, material=paint(builder, (0, 1, 0)), NORMAL=NORMALS)

    def near():
        rider = builder.node(root=False, mesh=red, name="rider", translation=[0, 1, 0])
        builder.node(children=[rider], name="car", translation=[0.5, 0, 1])

    def far():
        builder.node(mesh=green, name="tree", translation=[0, 1, -1])

    for make in (near, far) if near_first else (far, near):
        make()
    builder.node(camera=builder.camera(0.9), translation=[0, 1, 6])
    return builder


def load(builder, tmp_path):
    return Scene.load(builder.write(tmp_path / "scene.glb"))


def test_triangles_of_an_object_include_its_child_nodes(tmp_path):
    scene = load(two_cards(near_first=True), tmp_path)
    assert scene.triangles(0.0).shape == (4, 3, 3)
    for name in ("car", "rider"):
        np.testing.assert_allclose(scene.triangles(0.0, name).mean(axis=(0, 1))[2], 1.0)
    assert scene.triangles(0.0, "tree")[..., 2].max() == -1.0
    with pytest.raises(SceneError, match="no object is named 'bus'; expected one of rider, tree"):
        scene.triangles(0.0, "bus")


def test_footprint_is_that_of_the_named_object_or_of_all(tmp_path):
    scene = load(two_cards(near_first=True), tmp_path)
    view = View(width=64, height=48)
    renderer = PyrenderObjectRenderer(scene)
    assert len(RenderedObject(scene=scene, renderer=renderer, view=view).footprint(0.0)) == 4
    named = RenderedObject(
        scene=scene, renderer=renderer, view=view, footprint_node="tree"
    ).footprint(0.0)
    np.testing.assert_array_equal(named[..., 2], -1.0)


@pytest.mark.needs_gl
@pytest.mark.parametrize("near_first", [True, False])
def test_near_object_occludes_the_far_one_and_each_keeps_its_depth(tmp_path, near_first):
    scene = load(two_cards(near_first), tmp_path)
    camera = scene.camera(0.0, 96, 72)
    with PyrenderObjectRenderer(scene) as renderer:
        layer = renderer.render(0.0, camera)
    at = {}
    for name, point in (("both", [0.5, 1, 1]), ("far", [-0.8, 1, -1])):
        column, row = camera.pixels(camera.to_camera(np.array([point], np.float64)))[0]
        spot = int(row) - layer.box.y0, int(column) - layer.box.x0
        at[name] = (*layer.rgba[spot][:3].round(2).tolist(), round(float(layer.depth[spot]), 2))
    assert at == {"both": (1.0, 0.0, 0.0, 5.0), "far": (0.0, 1.0, 0.0, 7.0)}
