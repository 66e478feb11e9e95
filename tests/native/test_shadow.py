"""Shadow kernels in C++: every level gives the same bits, every projection its own coverage."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.native_levels import assert_same_bits

from nlens_video.effects.shadow.coverage import PROJECTIONS, covered_reference, edges_of
from nlens_video.native import kernels


def made_mesh(seed, count=40, behind=0.0):
    """Triangles around the middle of 32 x 40 pixels, some of whose corners share vertices."""
    rng = np.random.default_rng(seed)
    vertices = rng.normal(size=(count, 3)) * (20, 16, 0.2) + (20, 16, 1.0)
    vertices[rng.random(count) < behind, 2] *= -1.0
    faces = np.array([rng.permutation(count)[:3] for _ in range(2 * count)], np.int32)
    return vertices, faces, edges_of(faces)


def made_projections(seed, count=PROJECTIONS):
    rng = np.random.default_rng(seed)
    matrices = np.eye(3, 4) + rng.normal(size=(count, 3, 4)) * (0.05, 0.05, 0.05, 1.0)
    matrices[:, 2] = (0.0, 0.0, 1.0, 0.0)
    marks = (1 << rng.permutation(8)[:count]).astype(np.uint8)
    return marks, matrices, rng.random((count, 2))


def covered(module, size, mesh, projections):
    bits = np.zeros(size, np.uint8)
    count = len(mesh[0]), len(mesh[1])
    room = np.empty((count[0], 2, 8), np.int32), np.empty((count[1] + 1, 8), np.int8)
    module.mark_covered(bits, mesh, projections, room)
    return bits


@pytest.mark.parametrize("behind", [0.0, 0.2])
def test_coverage_is_the_same_at_every_level(behind):
    mesh, projections = made_mesh(3, behind=behind), made_projections(4)
    assert_same_bits(lambda module: [covered(module, (32, 40), mesh, projections)])


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 10_000), st.integers(1, PROJECTIONS), st.sampled_from([0.0, 0.3]))
def test_projections_at_once_are_each_as_the_reference(seed, count, behind):
    vertices, faces, edges = made_mesh(seed, count=9, behind=behind)
    marks, matrices, at = projections = made_projections(seed, count)
    bits = covered(kernels, (24, 32), (vertices, faces, edges), projections)
    assert not (bits & ~np.bitwise_or.reduce(marks)).any()
    for mark, matrix, place in zip(marks, matrices, at, strict=True):
        points = vertices @ matrix[:, :3].T + matrix[:, 3]
        truth = covered_reference((24, 32), points, faces, tuple(place))
        assert (((bits & mark) > 0) != truth).mean() < 0.02  # pixels on an edge


def test_pictures_taller_than_a_band_are_covered_throughout():
    corners = np.array([[0.0, 0.0, 1.0], [2000.0, 0.0, 1.0], [0.0, 900.0, 1.0]])
    faces = np.array([[0, 1, 2]], np.int32)
    projections = np.ones(1, np.uint8), np.eye(3, 4)[None], np.full((1, 2), 0.5)
    bits = covered(kernels, (300, 700), (corners, faces, edges_of(faces)), projections)
    truth = covered_reference((300, 700), corners, faces, (0.5, 0.5))
    assert np.array_equal(bits > 0, truth)


def test_mesh_without_triangles_covers_nothing():
    none = np.zeros((0, 3)), np.zeros((0, 3), np.int32), np.zeros((0, 4), np.int32)
    assert not covered(kernels, (5, 6), none, made_projections(1)).any()
    some = made_mesh(2)
    assert covered(kernels, (0, 6), some, made_projections(1)).shape == (0, 6)
    assert covered(kernels, (5, 0), some, made_projections(1)).shape == (5, 0)


@pytest.mark.parametrize("wrap", [0, 1, 2])
@pytest.mark.parametrize("cutoff", [-1.0, 0.4])
def test_absorption_is_the_same_at_every_level(wrap, cutoff):
    rng = np.random.default_rng(wrap)
    points, faces, _ = made_mesh(5)
    surface = rng.normal(size=(len(points), 3)) * 2.0
    texture = rng.random((5, 7), np.float32), (wrap, 2 - wrap), cutoff
    bits = rng.integers(0, 256, (32, 40)).astype(np.uint8)

    def run(module):
        taken, left = np.zeros((2, 32, 40), np.float32)
        sums = taken, left, np.zeros((32, 40), np.int32)
        module.absorb(sums, (bits, 3), points, surface, faces, texture, 1, (0.3, 0.7))
        return sums

    assert_same_bits(run)
