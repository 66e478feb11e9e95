"""Volumes that light goes through: as thick as the scale at which their mesh is drawn."""

import math

import numpy as np
import pytest
from support.glb_builder import GlbBuilder

from nlens_video.scene import Scene
from nlens_video.scene.object_motion import Curve, ObjectMotion


def glass(builder, thickness, **attributes):
    """A mesh of glass that lets half of the light through, where it is 1 thick in the world."""
    volume = {
        "thicknessFactor": thickness, "attenuationDistance": 1.0, "attenuationColor": [0.5] * 3
    }  # fmt: skip
    extensions = {
        "KHR_materials_transmission": {"transmissionFactor": 1.0}, "KHR_materials_volume": volume
    }  # fmt: skip
    return builder.mesh(material=builder.add("materials", {"extensions": extensions}), **attributes)


def load(builder, tmp_path):
    return Scene.load(builder.write(tmp_path / "scene.glb"))


def thicknesses(scene, time_s=0.0):
    """How thick each mesh is in the world [scene unit]."""
    meshes = scene.pose(time_s).meshes
    return [mesh.geometry.material.layers.absorption[0] / math.log(2.0) for mesh in meshes]


@pytest.mark.parametrize(
    "by", [{"scale": [0.1, -0.1, 0.1]}, {"scale": [0.4, 0.1, 0.025]}, "matrix"]
)
def test_volume_is_as_thick_as_its_nodes_scale_makes_it(tmp_path, by):
    builder = GlbBuilder()
    if by == "matrix":
        by = {"matrix": np.diag([0.1, 0.1, 0.1, 1.0]).ravel().tolist()}
    child = builder.node(root=False, mesh=glass(builder, 30.0), scale=[0.5] * 3)
    builder.node(children=[child], **by)
    assert thicknesses(load(builder, tmp_path)) == pytest.approx([1.5])


def test_very_thick_glass_that_is_drawn_small_is_not_opaque(tmp_path):
    builder = GlbBuilder()
    builder.node(mesh=glass(builder, 1000.0), scale=[0.001] * 3)
    assert thicknesses(load(builder, tmp_path)) == pytest.approx([1.0])


def test_nodes_that_draw_one_mesh_at_several_scales_share_all_that_is_the_same(tmp_path):
    builder = GlbBuilder()
    mesh = glass(builder, 2.0)
    for scale in (1.0, 3.0, 3.0):
        builder.node(mesh=mesh, scale=[scale] * 3)
    scene = load(builder, tmp_path)
    assert thicknesses(scene) == pytest.approx([2.0, 6.0, 6.0])
    first, second, third = (one.geometry for one in scene.pose(0.0).meshes)
    assert second is third and first.positions is second.positions


def test_volume_of_a_skin_is_as_thick_as_its_joints_make_it(tmp_path):
    builder = GlbBuilder()
    weights = np.eye(4, dtype=np.float32)[[0] * 4]
    mesh = glass(builder, 2.0, JOINTS_0=np.zeros((4, 4), np.uint8), WEIGHTS_0=weights)
    bone = builder.node(scale=[10.0] * 3)
    skin = builder.skin([bone], [np.diag([0.3, 0.3, 0.3, 1.0])])
    builder.node(mesh=mesh, skin=skin, scale=[7.0] * 3)
    assert thicknesses(load(builder, tmp_path)) == pytest.approx([6.0])


@pytest.mark.parametrize("kind", ["LINEAR", "CUBICSPLINE"])
def test_glass_that_grows_out_of_nothing_is_as_thick_as_it_becomes(tmp_path, kind):
    builder = GlbBuilder()
    node = builder.node(mesh=glass(builder, 2.0), scale=[0.0] * 3)
    keys = np.array([[0.0] * 3, [0.5] * 3])
    if kind == "CUBICSPLINE":
        keys = np.stack([np.full((2, 3), 9.0), keys, np.full((2, 3), 9.0)], axis=1)
    builder.animation((node, "scale", [0, 1], keys, kind))
    assert thicknesses(load(builder, tmp_path), 1.0) == pytest.approx([1.0])


def test_glass_keeps_its_look_where_its_file_is_placed_larger(tmp_path):
    builder = GlbBuilder()
    builder.node(mesh=glass(builder, 2.0), scale=[0.5] * 3)
    scene = load(builder, tmp_path)
    start = np.zeros(1)
    motion = ObjectMotion(
        contact=np.zeros(3), axes=np.eye(3), place=Curve(start, np.zeros((1, 3))),
        turn=Curve(start, np.zeros((1, 1))), scale=Curve(start, np.full((1, 1), 20.0)),
    )  # fmt: skip
    assert thicknesses(scene.with_motions([motion])) == pytest.approx([1.0])
