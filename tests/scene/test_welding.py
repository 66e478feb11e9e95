"""Vertices that a file repeats at creases are joined for the shadow, which stays what it was."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace
from support.definitions import marked

from nlens_video.effects.shadow.coverage import edges_of
from nlens_video.scene.gltf.materials import Material
from nlens_video.scene.gltf.meshes import Geometry
from nlens_video.scene.welding import welded_faces


def geometry(positions, faces, **more):
    positions = np.asarray(positions, np.float32)
    none = dict.fromkeys(("colors", "joints", "weights", "targets", "target_normals"))
    return Geometry(
        name="made", positions=positions, normals=positions, faces=np.asarray(faces, np.int32),
        uv=np.zeros((len(positions), 4), np.float32), material=Material(), flat=False,
        **{**none, **more},
    )  # fmt: skip


def folded(seed, columns=7, rows=5):
    """A crumpled sheet, some of whose triangles are turned; no two of them share a vertex."""
    rng = np.random.default_rng(seed)
    x, y = np.meshgrid(np.linspace(4.0, 30.0, columns), np.linspace(4.0, 24.0, rows))
    places = np.stack([x, y, np.zeros_like(x)], axis=-1).reshape(-1, 3)
    places += rng.normal(size=places.shape) * (3.0, 3.0, 0.1) + (0.0, 0.0, 1.0)
    number = np.arange(columns * rows).reshape(rows, columns)
    a, b, c, d = (part.ravel() for part in (number[:-1, :-1], number[:-1, 1:], number[1:, 1:],
                                            number[1:, :-1]))  # fmt: skip
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    turned = rng.random(len(faces)) < 0.2
    faces[turned] = faces[turned][:, ::-1]
    return geometry(places[faces].reshape(-1, 3), np.arange(3 * len(faces)).reshape(-1, 3))


@settings(max_examples=30, deadline=None)
@given(seed=st.integers(0, 1000))
def test_joined_triangles_are_in_their_places_and_cover_the_same_pixels(seed):
    made = folded(seed)
    faces = welded_faces(made)
    assert len(np.unique(faces)) == len(np.unique(made.positions, axis=0)) < faces.size / 3
    np.testing.assert_array_equal(made.positions[faces], made.positions[made.faces])
    before, after = (
        marked((28, 34), made.positions.astype(np.float64), triangles, (0.3, 0.7))
        for triangles in (made.faces, faces)
    )
    np.testing.assert_array_equal(after, before)
    assert len(edges_of(faces)) < len(edges_of(made.faces))


def test_places_that_part_when_the_mesh_moves_stay_apart():
    still = folded(3)
    count = len(still.positions)
    joints = np.zeros((count, 4), np.int32)
    weights = np.tile(np.float32([1.0, 0.0, 0.0, 0.0]), (count, 1))

    def places(**movers):
        return len(np.unique(welded_faces(replace(still, **movers))))

    assert places(joints=joints, weights=weights) == places()
    first_half = np.arange(count) < count // 2
    joints[first_half, 0] = 1
    moved = np.zeros((2, count, 3), np.float32)
    moved[1, first_half, 1] = 0.5
    assert places(joints=joints, weights=weights) == places(targets=moved) > places()


@pytest.mark.parametrize("zero", [0.0, -0.0])
def test_zero_and_negative_zero_are_one_place(zero):
    made = geometry([(0, 0, 0), (1, 0, 0), (0, 1, 0), (zero, 0, zero), (0, 1, 0), (-1, 0, 0)],
                    [(0, 1, 2), (3, 4, 5)])  # fmt: skip
    assert welded_faces(made).tolist() == [[0, 1, 2], [0, 2, 5]]


def test_mesh_without_repeated_vertices_keeps_its_faces():
    made = geometry(np.random.default_rng(1).normal(size=(30, 3)), np.arange(30).reshape(-1, 3))
    np.testing.assert_array_equal(welded_faces(made), made.faces)
