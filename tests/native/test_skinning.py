"""Skinning in C++: as NumPy defines it, and the same bits on all levels of processors."""

import numpy as np
import pytest
from support.native_levels import assert_same_bits

from nlens_video.native import kernels


def skinned(seed, vertices=301, joints=17):
    rng = np.random.default_rng(seed)
    weights = rng.random((vertices, 4)) * (rng.random((vertices, 4)) < 0.7)
    numbers = rng.integers(0, joints, (vertices, 4), np.int32)
    numbers[weights == 0.0] = 10**9  # which must not be read
    vectors = rng.normal(size=(2, vertices, 3)).astype(np.float32)
    matrices = rng.normal(size=(joints, 12)).astype(np.float32)
    return *vectors, numbers, weights.astype(np.float32), matrices


def carried(module, given):
    placed, turned = np.empty_like(given[0]), np.empty_like(given[1])
    module.skin(*given, placed, turned)
    return placed, turned


def by_a_node(module, vectors, matrix):
    positions, normals = vectors
    linear = matrix[:, :3]
    turner = np.linalg.det(linear) * np.linalg.inv(linear).T
    if np.linalg.det(linear) < 0.0:  # normals point out of a mirrored surface too
        turner = -turner
    placed, turned = np.empty_like(positions), np.empty_like(normals)
    module.carry(positions, normals, matrix, np.ascontiguousarray(turner), placed, turned)
    return placed, turned


@pytest.mark.parametrize("mirror", [1.0, -1.0])
def test_vertices_of_a_node_go_by_its_matrix_as_those_of_a_single_joint(mirror):
    vectors = skinned(2)[:2]
    vectors[1][7] = 0.0  # no direction
    matrix = np.random.default_rng(3).normal(size=(3, 4)) * [[mirror], [1.0], [1.0]]
    joint = np.zeros((len(vectors[0]), 1), np.int32), np.ones((len(vectors[0]), 1), np.float32)
    placed, turned = by_a_node(kernels, vectors, matrix)
    expected = carried(kernels, (*vectors, *joint, matrix.reshape(1, 12).astype(np.float32)))
    np.testing.assert_allclose(placed, expected[0], rtol=1e-5, atol=1e-5)
    np.testing.assert_allclose(turned, expected[1], rtol=1e-5, atol=1e-5)
    assert turned[7].tolist() == [0.0, 1.0, 0.0]
    exact = vectors[0].astype(np.float64) @ matrix[:, :3].T + matrix[:, 3]
    np.testing.assert_allclose(placed, exact, rtol=1e-6, atol=1e-6)


def test_each_vertex_goes_by_the_mean_of_its_joints_matrices():
    positions, normals, joints, weights, matrices = skinned(0)
    chosen = matrices[np.where(weights > 0.0, joints, 0)].astype(np.float64)
    blended = (weights[..., None] * chosen).sum(axis=1).reshape(-1, 3, 4)
    placed, turned = carried(kernels, (positions, normals, joints, weights, matrices))
    expected = np.einsum("vij,vj->vi", blended[..., :3], positions) + blended[..., 3]
    np.testing.assert_allclose(placed, expected, rtol=1e-5, atol=1e-5)
    rows = blended[..., :3]
    cofactors = np.cross(rows[:, [1, 2, 0]], rows[:, [2, 0, 1]])
    sides = np.where(np.linalg.det(rows) < 0.0, -1.0, 1.0)
    expected = np.einsum("v,vij,vj->vi", sides, cofactors, normals)
    lengths = np.linalg.norm(expected, axis=1, keepdims=True)
    up = np.tile([0.0, 1.0, 0.0], (len(expected), 1))  # what no joint carries
    expected = np.divide(expected, lengths, out=up, where=lengths > 0.0)
    np.testing.assert_allclose(turned, expected, rtol=1e-5, atol=1e-5)


def test_normals_stay_upright_on_their_surface_under_uneven_and_mirrored_scales():
    corners = np.array([[0, 0, 0], [1, 0, 1], [0, 1, 0]], np.float32)  # across and down a slope
    slope = np.tile(np.cross(*(corners[1:] - corners[0])), (3, 1)).astype(np.float32)
    joints, weights = np.zeros((3, 1), np.int32), np.ones((3, 1), np.float32)
    for scales in ([4.0, 1.0, 0.25], [-4.0, 1.0, 0.25], [1.0, 1.0, 0.0]):
        matrix = np.zeros((1, 12), np.float32)
        matrix[0, [0, 5, 10]] = scales
        placed, turned = carried(kernels, (corners, slope, joints, weights, matrix))
        np.testing.assert_allclose((placed[1:] - placed[0]) @ turned[0], 0.0, atol=1e-6)
        outwards = slope[0] @ np.diag(scales)
        assert turned[0] @ outwards > 0.0 or scales[2] == 0.0


def test_skinning_is_the_same_at_every_level():
    assert_same_bits(lambda module: carried(module, skinned(1)))
    matrix = np.random.default_rng(4).normal(size=(3, 4))
    assert_same_bits(lambda module: by_a_node(module, skinned(1)[:2], matrix))
