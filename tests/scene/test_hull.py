"""Bounding hulls of deforming objects enclose every vertex and cull before deformation."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import Delaunay
from scipy.spatial.transform import Rotation
from support.glb_builder import GlbBuilder

from nlens_video.core.errors import SceneError
from nlens_video.graph.base.object_source import RenderedObject
from nlens_video.graph.base.view import View
from nlens_video.scene.scene import Scene

TRIANGLES = 12
FACES = np.arange(3 * TRIANGLES, dtype=np.uint16).reshape(-1, 3)


def body(seed, *, skinned, morphed):
    """A GLB of a random mesh whose joints, node and morph weights move over a second."""
    rng = np.random.default_rng(seed)
    builder = GlbBuilder()
    count = 3 * TRIANGLES
    parts = {}
    if skinned:
        parts["JOINTS_0"] = rng.integers(0, 3, (count, 4)).astype(np.uint8)
        share = rng.random((count, 4)) * (rng.random((count, 4)) > 0.4) + 1e-3
        parts["WEIGHTS_0"] = (share / share.sum(axis=1, keepdims=True)).astype(np.float32)
    targets = [{"POSITION": rng.normal(size=(count, 3))} for _ in range(2)] if morphed else ()
    mesh = builder.mesh(
        rng.normal(size=(count, 3)).astype(np.float32), FACES, targets=targets, **parts
    )
    times = [0.0, 1.0]

    def turned():
        return Rotation.random(2, random_state=rng).as_quat()

    bones = [builder.node(translation=rng.normal(size=3).tolist()) for _ in range(3)]
    channels = [(bone, "rotation", times, turned(), "LINEAR") for bone in bones]
    inverse = np.tile(np.eye(4), (3, 1, 1)) + np.pad(
        0.2 * rng.normal(size=(3, 3, 3)), ((0, 0), (0, 1), (0, 1))
    )
    skin = {"skin": builder.skin(bones, inverse)} if skinned else {}
    node = builder.node(mesh=mesh, scale=(0.5 + rng.random(3)).tolist(), **skin)
    channels.append((node, "translation", times, rng.normal(size=(2, 3)), "LINEAR"))
    if morphed:
        channels.append((node, "weights", times, rng.normal(size=(2, 2)), "LINEAR"))
    builder.animation(*channels)
    return builder


@pytest.mark.slow
@pytest.mark.parametrize(("skinned", "morphed"), [(0, 0), (1, 0), (0, 1), (1, 1)])
@settings(max_examples=15)
@given(seed=st.integers(0, 10_000), moments=st.lists(st.floats(0, 1), min_size=2, max_size=3))
def test_every_vertex_lies_in_the_predicted_hull(tmp_path_factory, skinned, morphed, seed, moments):
    path = tmp_path_factory.mktemp("hull") / "body.glb"
    scene = Scene.load(body(seed, skinned=skinned, morphed=morphed).write(path))
    for moment in moments:
        points, vertices = scene.hull(moment), scene.pose(moment).vertices().astype(np.float64)
        middle = points.mean(axis=0)
        inside = Delaunay(points).find_simplex(middle + (1 - 1e-4) * (vertices - middle)) >= 0
        assert inside.all()


def test_hull_of_a_morphed_mesh_encloses_it_at_each_time(tmp_path):
    """Its boxes are not those of the moment that was asked for before."""
    builder = GlbBuilder()
    corners = np.random.default_rng(0).random((3 * TRIANGLES, 3)).astype(np.float32)
    away = {"POSITION": np.tile(np.float32([50, 0, 0]), (3 * TRIANGLES, 1))}
    node = builder.node(mesh=builder.mesh(corners, FACES, targets=[away]))
    builder.animation((node, "weights", [0.0, 1.0], [[0.0], [1.0]], "LINEAR"))
    scene = Scene.load(builder.write(tmp_path / "body.glb"))
    ends = [scene.hull(moment)[:, 0].max() for moment in (0.0, 1.0, 0.0)]
    np.testing.assert_allclose(ends, corners[:, 0].max() + np.array([0.0, 50.0, 0.0]), atol=1e-5)


@pytest.mark.parametrize("place", [(1e30, 0, 0), (0, 0, 1e30), (0, 0, -1e30)])
def test_skin_that_moves_the_object_out_of_range_is_refused(tmp_path, place):
    builder = GlbBuilder()
    count = 3 * TRIANGLES
    mesh = builder.mesh(
        np.random.default_rng(0).random((count, 3)).astype(np.float32), FACES,
        JOINTS_0=np.zeros((count, 4), np.uint8),
        WEIGHTS_0=np.tile(np.float32([1, 0, 0, 0]), (count, 1)),
    )  # fmt: skip
    inverse = np.eye(4)[None].copy()
    inverse[0, :3, 3] = place
    builder.node(mesh=mesh, skin=builder.skin([builder.node()], inverse))
    builder.node(camera=builder.camera(0.7), translation=[0, 0, 5.0])
    scene = Scene.load(builder.write(tmp_path / "body.glb"))
    objects = RenderedObject(scene=scene, view=View(width=320, height=200), renderer=None)
    with pytest.raises(SceneError, match="lies beyond 1e"):
        objects.locate(0, 0.0)


@pytest.mark.parametrize("offset", [(0, 0, 5.0), (40.0, 0, 0), (-40.0, 0, 0), (0, 40.0, 0)])
def test_object_far_out_of_view_is_culled_before_deforming_vertices(tmp_path, offset, monkeypatch):
    builder = GlbBuilder()
    mesh = builder.mesh(np.random.default_rng(0).random((3 * TRIANGLES, 3), np.float32), FACES)
    x, y, z = offset
    builder.node(mesh=mesh, translation=[x, y, z - 3.0])
    builder.node(camera=builder.camera(0.7))
    scene = Scene.load(builder.write(tmp_path / "away.glb"))
    monkeypatch.setattr(Scene, "pose", lambda *_: pytest.fail("its vertices were moved"))
    objects = RenderedObject(
        scene=scene, view=View(width=320, height=200), renderer=None
    )  # never asked
    assert objects.locate(0, 0.0) is None


@settings(max_examples=25)
@given(seed=st.integers(0, 10_000), moment=st.floats(0, 1), length=st.floats(0, 0.1))
def test_screen_motion_of_vertices_stays_within_the_bound(tmp_path_factory, seed, moment, length):
    builder = body(seed, skinned=seed % 2, morphed=0)
    rng = np.random.default_rng(seed)
    camera = builder.node(camera=builder.camera(0.7), translation=[0, 0, 25.0])
    turns = Rotation.from_rotvec(0.1 * rng.normal(size=(2, 3))).as_quat()
    builder.animation((camera, "rotation", [0.0, 1.0], turns, "LINEAR"))
    scene = Scene.load(builder.write(tmp_path_factory.mktemp("travel") / "body.glb"))
    objects = RenderedObject(scene=scene, view=View(width=320, height=200), renderer=None)
    moments = (moment, moment + 0.5 * length, moment + length)
    places = [objects.places(one) for one in moments]
    bound = objects.travel_bound_px(moments)
    assert all(one is not None for one in places) or bound == np.inf
    if all(one is not None for one in places):
        ways = [np.linalg.norm(b[:, :2] - a[:, :2], axis=1) for a, b in pairwise(places)]
        assert sum(ways).max() <= bound * (1 + 1e-4) + 1e-3


def test_screen_motion_bound_is_zero_at_rest_and_infinite_for_morph_targets(tmp_path):
    builder = body(1, skinned=1, morphed=1)
    builder.node(camera=builder.camera(0.7), translation=[0, 0, 25.0])
    morphing = Scene.load(builder.write(tmp_path / "a.glb"))
    rest = GlbBuilder()
    cube = rest.mesh(np.random.default_rng(0).random((3 * TRIANGLES, 3), np.float32), FACES)
    rest.node(mesh=cube)
    rest.node(camera=rest.camera(0.7), translation=[0, 0, 5.0])
    still = Scene.load(rest.write(tmp_path / "b.glb"))
    view = View(width=320, height=200)
    bounds = [
        RenderedObject(scene=scene, view=view, renderer=None).travel_bound_px((0.0, 0.1, 0.2))
        for scene in (morphing, still)
    ]
    assert bounds == [np.inf, 0.0]
