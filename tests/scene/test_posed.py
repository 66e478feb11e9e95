"""Skins and morph targets against values computed one vertex at a time."""

import subprocess
import sys
from operator import is_

import numpy as np
import pytest
from support.calls import calls_of
from support.glb_builder import QUAD, GlbBuilder

from nlens_video.core.errors import SceneError
from nlens_video.scene import Scene
from nlens_video.scene.object_motion import Curve, ObjectMotion, turn_about_up

NORMALS = np.tile(np.array([[0, 0, 1]], np.float32), (4, 1))


def load(builder, tmp_path):
    return Scene.load(builder.write(tmp_path / "scene.glb"))


def random_matrix(rng):
    matrix = np.eye(4)
    matrix[:3] += rng.normal(0, 0.3, (3, 4))
    return matrix


@pytest.mark.parametrize("sets", [1, 2])
def test_skin_blends_joint_matrices_and_ignores_the_nodes_transform(tmp_path, sets):
    rng = np.random.default_rng(3)
    builder = GlbBuilder()
    joints = rng.integers(0, 5, (4, 4 * sets)).astype(np.uint8)
    weights = rng.random((4, 4 * sets)).astype(np.float32)
    weights /= weights.sum(axis=1, keepdims=True)
    attributes = {f"JOINTS_{k}": joints[:, 4 * k : 4 * k + 4] for k in range(sets)}
    attributes |= {f"WEIGHTS_{k}": weights[:, 4 * k : 4 * k + 4] for k in range(sets)}
    mesh = builder.mesh(NORMAL=NORMALS, **attributes)
    poses = [random_matrix(rng) for _ in range(5)]
    bones = [builder.node(matrix=list(pose.T.ravel())) for pose in poses]
    inverse = np.stack([random_matrix(rng) for _ in range(5)])
    builder.node(mesh=mesh, skin=builder.skin(bones, inverse), translation=[100, 200, 300])
    expected = []
    for vertex, chosen, amounts in zip(QUAD, joints, weights, strict=True):
        point = np.append(vertex, 1.0)
        expected.append(
            sum(w * (poses[j] @ inverse[j] @ point) for j, w in zip(chosen, amounts, strict=True))
        )
    posed = load(builder, tmp_path).pose(0.0).meshes[0]
    np.testing.assert_allclose(posed.positions, np.array(expected)[:, :3], rtol=1e-4, atol=1e-5)
    np.testing.assert_allclose(np.linalg.norm(posed.normals, axis=1), 1.0, atol=1e-6)


def test_joint_index_beyond_the_skin_is_refused(tmp_path):
    builder = GlbBuilder()
    joints = np.full((4, 4), 3, np.uint8)
    weights = np.full((4, 4), 0.25, np.float32)
    mesh = builder.mesh(JOINTS_0=joints, WEIGHTS_0=weights)
    bone = builder.node()
    builder.node(mesh=mesh, skin=builder.skin([bone], [np.eye(4)]))
    with pytest.raises(SceneError, match="1 joints"):
        load(builder, tmp_path)


def test_morph_targets_displace_positions_and_normals(tmp_path):
    rng = np.random.default_rng(5)
    up, side = rng.normal(size=(2, 4, 3))
    tilt = np.tile([[1.0, 0.0, 0.0]], (4, 1))
    builder = GlbBuilder()
    mesh = builder.mesh(
        NORMAL=NORMALS,
        targets=[{"POSITION": up, "NORMAL": tilt}, {"POSITION": side, "NORMAL": 0 * tilt}],
        weights=[0.5, 0.0],
    )
    node = builder.node(mesh=mesh)
    builder.animation((node, "weights", [1, 2], [[0.0, 1.0], [1.0, 3.0]], "LINEAR"))
    posed = load(builder, tmp_path).pose(1.5).meshes[0]
    np.testing.assert_allclose(posed.positions, QUAD + 0.5 * up + 2.0 * side, atol=1e-5)
    normal = np.array([0.5, 0, 1]) / np.sqrt(1.25)
    np.testing.assert_allclose(posed.normals, np.tile(normal, (4, 1)), atol=1e-6)


def test_morph_weights_without_animation_come_from_the_node_then_the_mesh(tmp_path):
    builder = GlbBuilder()
    mesh = builder.mesh(targets=[{"POSITION": np.ones((4, 3))}], weights=[0.25])
    builder.node(mesh=mesh)
    builder.node(mesh=mesh, weights=[2.0])
    posed = load(builder, tmp_path).pose(0.0)
    assert [mesh.positions[0][2] for mesh in posed.meshes] == [0.25, 2.0]


def test_mesh_without_normals_gets_face_normals_at_every_time(tmp_path):
    builder = GlbBuilder()
    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.float32)
    lifted = {"POSITION": [[0, 0, 0], [0, 0, 0], [0, 0, 1]]}
    node = builder.node(mesh=builder.mesh(corners, [[0, 1, 2]], targets=[lifted]))
    builder.animation((node, "weights", [0, 1], [[0.0], [1.0]], "LINEAR"))
    scene = load(builder, tmp_path)
    np.testing.assert_allclose(scene.pose(0.0).meshes[0].normals[0], [0, 0, 1], atol=1e-6)
    tilted = np.array([0, -1, 1]) / np.sqrt(2)
    np.testing.assert_allclose(scene.pose(1.0).meshes[0].normals[2], tilted, atol=1e-6)


def test_normals_stay_perpendicular_under_uneven_scale_and_out_of_a_mirrored_mesh(tmp_path):
    builder = GlbBuilder()
    slope = np.array([[0, 0, 0], [1, 0, -1], [0, 1, 0]], np.float32)
    normal = np.array([[1, 0, 1]] * 3, np.float32) / np.sqrt(2)
    faces = np.array([[0, 1, 2]], np.uint16)
    builder.node(mesh=builder.mesh(slope, faces, NORMAL=normal), scale=[3, 1, 1])
    builder.node(mesh=builder.mesh(slope, faces, NORMAL=normal), scale=[-1, 1, 1])
    stretched, mirrored = load(builder, tmp_path).pose(0.0).meshes
    np.testing.assert_allclose(stretched.normals[0], np.array([1, 0, 3]) / np.sqrt(10), atol=1e-6)
    np.testing.assert_allclose(mirrored.normals[0], np.array([-1, 0, 1]) / np.sqrt(2), atol=1e-6)
    assert (stretched.mirrored, mirrored.mirrored) == (False, True)


@pytest.mark.parametrize("flat", [False, True], ids=["normals", "flat"])
def test_skin_of_a_mirrored_skeleton_faces_outwards_as_its_rigid_twin_does(tmp_path, flat):
    builder = GlbBuilder()
    slope = np.array([[0, 0, 0], [1, 0, -1], [0, 1, 0]], np.float32)
    faces = np.array([[0, 1, 2]], np.uint16)
    normals = {} if flat else {"NORMAL": np.array([[1, 0, 1]] * 3, np.float32) / np.sqrt(2)}
    held = {
        "JOINTS_0": np.zeros((3, 4), np.uint8),
        "WEIGHTS_0": np.eye(4, dtype=np.float32)[[0] * 3],
    }
    bones = [builder.node(root=False), builder.node(scale=[9, 9, 9])]
    carried = builder.mesh(slope, faces, **normals, **held)
    skinned = builder.node(
        root=False, mesh=carried, skin=builder.skin(bones, np.stack([np.eye(4)] * 2))
    )
    rigid = builder.node(root=False, mesh=builder.mesh(slope, faces, **normals))
    builder.node(children=[bones[0], skinned, rigid], scale=[-1, 1, 1])
    skin, twin = load(builder, tmp_path).pose(0.0).meshes
    np.testing.assert_allclose(skin.positions, twin.positions, atol=1e-6)
    np.testing.assert_allclose(skin.normals, twin.normals, atol=1e-6)
    assert (skin.mirrored, twin.mirrored) == (True, True)


def test_skin_of_a_turned_skeleton_is_not_mirrored(tmp_path):
    builder = GlbBuilder()
    held = {
        "JOINTS_0": np.zeros((4, 4), np.uint8),
        "WEIGHTS_0": np.eye(4, dtype=np.float32)[[0] * 4],
    }
    bone = builder.node(scale=[-1, -1, 1])
    builder.node(mesh=builder.mesh(**held), skin=builder.skin([bone], [np.eye(4)]))
    assert not load(builder, tmp_path).pose(0.0).meshes[0].mirrored


def test_static_mesh_returns_the_same_pose_at_all_times(tmp_path):
    builder = GlbBuilder()
    still, moving = builder.node(mesh=builder.mesh()), builder.node(mesh=builder.mesh())
    values = [[0, 0, 0], [1, 0, 0]]
    builder.animation((moving, "translation", [0, 1], values, "LINEAR"))
    assert still == 0
    scene = load(builder, tmp_path)
    a, b = scene.pose(0.25), scene.pose(0.5)
    assert a.meshes[0] is b.meshes[0]
    assert a.meshes[1] is not b.meshes[1]
    assert a.meshes[1].geometry is b.meshes[1].geometry


def test_a_frames_moment_and_its_shutters_samples_are_posed_once(tmp_path):
    builder = GlbBuilder()
    builder.animation(
        (builder.node(mesh=builder.mesh()), "translation", [0, 1], [[0, 0, 0], [1, 0, 0]], "LINEAR")
    )
    scene = load(builder, tmp_path)
    # the frame's own, the shutter's ends, two views between them
    moments = [0.5, 0.48, 0.52, 0.49, 0.51]
    first, again = ([scene.pose(moment).meshes[0] for moment in moments] for _ in range(2))
    assert all(map(is_, first, again))
    places = [float(one.positions[:, 0].min()) for one in first]
    assert places == pytest.approx([moment - 1.0 for moment in moments], abs=1e-6)


def test_only_the_lights_that_are_carried_along_move(tmp_path):
    builder = GlbBuilder()
    builder.node(mesh=builder.mesh())
    builder.light("point")
    carried = builder.light("point", node={"root": False})
    arm = builder.node(children=[carried])
    builder.animation((arm, "translation", [0, 1], [[0, 0, 0], [1, 0, 0]], "LINEAR"))
    scene = load(builder, tmp_path)
    (still, moved), (later, moved_on) = (scene.pose(moment).lights for moment in (0.25, 0.75))
    np.testing.assert_array_equal(still.position, later.position)
    assert moved.position[0] == pytest.approx(0.25)
    assert moved_on.position[0] == pytest.approx(0.75)


def test_lights_of_a_file_whose_object_alone_moves_are_posed_once(tmp_path):
    builder = GlbBuilder()
    builder.light("point")
    builder.animation(
        (builder.node(mesh=builder.mesh()), "translation", [0, 1], [[0, 0, 0], [1, 0, 0]], "LINEAR")
    )
    scene = load(builder, tmp_path)
    (first,), (later,) = (scene.pose(moment).lights for moment in (0.25, 0.75))
    assert first is later


def test_lights_of_a_file_that_moves_as_a_whole_move_with_it(tmp_path):
    builder = GlbBuilder()
    builder.node(mesh=builder.mesh())
    builder.light("point")
    scene, start = load(builder, tmp_path), np.zeros(1)
    assert scene.pose(0.25).lights[0].position[0] == 0.0
    motion = ObjectMotion(
        contact=np.zeros(3), axes=turn_about_up(0.0),
        place=Curve(np.array([0.0, 1.0]), np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])),
        turn=Curve(start, np.zeros((1, 1))), scale=Curve(start, np.ones((1, 1))),
    )  # fmt: skip
    moving = scene.with_motions([motion])
    places = [moving.pose(moment).lights[0].position[0] for moment in (0.25, 0.75)]
    assert places == pytest.approx([0.25, 0.75])


def test_tiny_and_huge_scales_keep_shape_and_normals(tmp_path):
    for scale in (1e-6, 1e6):
        builder = GlbBuilder()
        builder.node(mesh=builder.mesh(NORMAL=NORMALS), scale=[scale] * 3)
        posed = load(builder, tmp_path).pose(0.0)
        np.testing.assert_allclose(posed.bounds(), scale * np.array([[-1, -1, 0], [1, 1, 0]]))
        np.testing.assert_allclose(posed.meshes[0].normals, NORMALS, atol=1e-6)


@pytest.mark.slow
def test_scene_without_skins_does_not_import_sparse_matrices(tmp_path):
    builder = GlbBuilder()
    builder.node(mesh=builder.mesh())
    path = builder.write(tmp_path / "scene.glb")
    code = (
        "import sys; from pathlib import Path; from nlens_video.scene import Scene; "
        "Scene.load(Path(sys.argv[1])); print('scipy.sparse' in sys.modules)"
    )
    command = [sys.executable, "-c", code, str(path)]
    run = subprocess.run(command, capture_output=True, text=True, check=True)
    assert run.stdout.strip() == "False"


@pytest.mark.parametrize("parts", ["moving", "resting"])
def test_part_more_costs_a_pose_few_calls(tmp_path, parts):
    """What NumPy does part by part takes longer than their vertices, where parts are many."""

    def calls(count):
        builder = GlbBuilder()
        mesh = builder.mesh()
        nodes = [builder.node(mesh=mesh, translation=[n, 0, 0]) for n in range(count)]
        whole = builder.node(mesh=mesh, children=nodes if parts == "moving" else [])
        builder.animation((whole, "translation", [0, 1], [[0, 0, 0], [1, 0, 0]], "LINEAR"))
        scene = load(builder, tmp_path)
        scene.pose(0.0)
        return calls_of(lambda: scene.pose(0.5))

    assert calls(40) - calls(20) <= 20 * {"moving": 30, "resting": 10}[parts]
