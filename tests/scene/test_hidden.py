"""What is scaled to 0, has no area or is hidden by the file counts nowhere; lights still shine."""

import numpy as np
import pytest
from support import shots
from support.glb_builder import QUAD, QUAD_FACES, GlbBuilder

from nlens_video.core.errors import SceneError
from nlens_video.effects.shadow.casters import CasterCache, Casters
from nlens_video.scene import Scene
from nlens_video.scene.screen_projection import extent

HALF_TURN = [0.0, 1.0, 0.0, 0.0]


def load(builder, tmp_path):
    return Scene.load(builder.write(tmp_path / "scene.glb"))


def with_part(tmp_path, **part):
    """A quad around the origin, and another far below it whose node is as given."""
    builder = GlbBuilder()
    mesh = builder.mesh()
    builder.node(mesh=mesh)
    builder.node(mesh=mesh, translation=[0, -50, 0], **part)
    return load(builder, tmp_path)


@pytest.mark.parametrize("scale", [[0, 0, 0], [1, 0, 0], [0, 2, 0]])
def test_part_that_is_scaled_to_nothing_counts_neither_for_bounds_nor_as_a_caster(tmp_path, scale):
    turned = np.array([0.2, 0.4, 0.1, 0.9]) / np.linalg.norm([0.2, 0.4, 0.1, 0.9])
    scene = with_part(tmp_path, scale=scale, rotation=turned.tolist())
    posed = scene.pose(0.0)
    assert posed.bounds().tolist() == [[-1, -1, 0], [1, 1, 0]]
    assert scene.triangles(0.0)[:, :, 1].min() == -1.0
    assert Casters.of(posed, CasterCache()).vertices[:, 1].min() == -1.0
    seen, alone = (extent(one, shots.camera()) for one in (posed, with_quad(tmp_path).pose(0.0)))
    assert seen == alone


def with_quad(tmp_path):
    builder = GlbBuilder()
    builder.node(mesh=builder.mesh())
    return load(builder, tmp_path)


@pytest.mark.parametrize("scale", [[1, 1, 0], [1e-3, 1e-3, 1e-3], [-1, 1, 1]])
def test_part_that_is_flat_small_or_mirrored_counts(tmp_path, scale):
    assert with_part(tmp_path, scale=scale).pose(0.0).bounds()[0, 1] <= -50.0


def test_skin_whose_joints_are_scaled_to_nothing_in_one_place_does_not_count(tmp_path):
    builder = GlbBuilder()
    mesh = builder.mesh()
    joints = np.tile(np.array([[0, 1, 0, 0]], np.uint8), (4, 1))
    weights = np.tile(np.array([[0.3, 0.7, 0, 0]], np.float32), (4, 1))
    skinned = builder.mesh(JOINTS_0=joints, WEIGHTS_0=weights)
    bones = [builder.node(root=False, translation=[0, x, 0]) for x in (1, 2)]
    builder.node(mesh=mesh)
    builder.node(children=bones, translation=[0, -50, 0], scale=[0, 0, 0])
    builder.node(mesh=skinned, skin=builder.skin(bones, [np.eye(4)] * 2))
    assert load(builder, tmp_path).pose(0.0).bounds()[0, 1] == -1.0


def test_object_of_no_size_at_all_lies_where_its_node_does_and_is_not_in_view(tmp_path):
    builder = GlbBuilder()
    builder.node(mesh=builder.mesh(), translation=[1, 2, -3], scale=[0, 0, 0])
    scene = load(builder, tmp_path)
    assert scene.pose(0.0).bounds().tolist() == [[1, 2, -3]] * 2
    assert (scene.triangles(0.0) == [1, 2, -3]).all()
    assert extent(scene.pose(0.0), shots.camera()).farthest == 0.0


def test_vertices_of_no_triangle_with_an_area_are_left_out_with_all_that_belongs_to_them(tmp_path):
    builder = GlbBuilder()
    stray = [[0, -9, 0], [1, -9, 0], [3, -9, 0]]  # a line, used; and a point that nothing uses
    positions = np.array([stray[0], *QUAD, *stray[1:], [0, -99, 0]], np.float32)
    faces = np.concatenate([QUAD_FACES + 1, [[0, 5, 6], [1, 1, 2]]])
    colors = np.arange(8, dtype=np.float32)[:, None].repeat(3, axis=1) / 8
    builder.node(mesh=builder.mesh(positions, faces, COLOR_0=colors))
    geometry = load(builder, tmp_path).pose(0.0).meshes[0].geometry
    np.testing.assert_array_equal(geometry.positions[geometry.faces[:2]], QUAD[QUAD_FACES])
    assert len(geometry.positions) == 4 + 2  # normals are those of faces: the third keeps its own
    np.testing.assert_allclose(geometry.colors[geometry.faces[0], 0], np.array([1, 2, 3]) / 8)


def test_primitive_without_any_area_is_not_drawn_which_is_said(tmp_path):
    builder = GlbBuilder()
    builder.node(mesh=builder.mesh())
    builder.node(mesh=builder.mesh(np.zeros_like(QUAD)))
    scene = load(builder, tmp_path)
    assert len(scene.pose(0.0).meshes) == 1
    assert scene.warnings == ("mesh 'meshes[1]': a primitive without area is not drawn",)


@pytest.mark.parametrize("carried", [False, True])
def test_light_and_camera_keep_their_direction_whatever_the_scale(tmp_path, carried):
    def scene(scale):
        builder = GlbBuilder()
        builder.node(mesh=builder.mesh())
        light = builder.light(node={"rotation": HALF_TURN, "root": not carried})
        camera = builder.node(
            root=not carried, camera=builder.camera(), rotation=HALF_TURN, translation=[0, 1, 0]
        )
        outer = builder.node(children=[light, camera]) if carried else None
        hidden = [outer] if carried else [light, camera]
        for node in hidden:
            builder.animation((node, "scale", [0, 1], [[1, 1, 1], [scale] * 3], "STEP"))
        return load(builder, tmp_path)

    shown, hidden = scene(1), scene(0)
    for time_s in (0.5, 1.5):
        one, other = (each.pose(time_s).lights[0].direction for each in (shown, hidden))
        np.testing.assert_array_equal(one, other)
        poses = [each.camera(time_s, 64, 64).world_from_camera for each in (shown, hidden)]
        np.testing.assert_array_equal(*(pose[:3, :3] for pose in poses))


def test_light_on_a_matrix_without_direction_is_named_with_its_file(tmp_path):
    builder = GlbBuilder()
    builder.node(mesh=builder.mesh())
    nowhere = np.diag([0.0, 0.0, 0.0, 1.0]).ravel().tolist()
    builder.light(node={"matrix": nowhere, "name": "Key"})
    with pytest.raises(SceneError, match=r"scene\.glb: light 'Key': the matrix of its node"):
        load(builder, tmp_path).pose(0.0)


def test_invisible_node_hides_the_meshes_and_lights_that_it_carries_but_no_camera(tmp_path):
    builder = GlbBuilder()
    builder.node(mesh=builder.mesh(), name="seen")
    shown = {"KHR_node_visibility": {"visible": True}}
    inner = builder.node(root=False, mesh=builder.mesh(), extensions=shown)
    light = builder.light(node={"root": False})
    camera = builder.node(root=False, camera=builder.camera(name="Cam"))
    hidden = {"KHR_node_visibility": {"visible": False}}
    builder.node(mesh=builder.mesh(), children=[inner, light, camera], extensions=hidden)
    builder.document["extensionsUsed"] = ["KHR_node_visibility"]
    scene = load(builder, tmp_path)
    assert len(scene.pose(0.0).meshes) == 1 and scene.light_count == 0
    assert scene.camera_names == ("Cam",) and not scene.warnings
    builder.document["nodes"][0]["extensions"] = hidden
    with pytest.raises(SceneError, match="KHR_node_visibility hides"):
        load(builder, tmp_path)


def test_extensions_that_a_file_does_not_declare_are_named_like_those_it_does(tmp_path):
    builder = GlbBuilder()
    texture = builder.texture(np.zeros((2, 2, 3), np.uint8))
    builder.document["textures"][texture]["extensions"] = {"X_texture": {}}
    material = builder.add(
        "materials", {"extensions": {"X_material": {}, "KHR_materials_unlit": {}}}
    )
    mesh = builder.mesh(material=material)
    builder.document["meshes"][mesh]["primitives"][0]["extensions"] = {"X_primitive": {}}
    builder.node(mesh=mesh, extensions={"X_node": {}, "X_declared": {}})
    builder.document["extensionsUsed"] = ["X_declared"]
    names = [line.split()[0] for line in load(builder, tmp_path).warnings]
    assert names == ["X_declared", "X_primitive", "X_node", "X_material", "X_texture"]
