"""Skinning in C++: as NumPy defines it, and the same bits on all levels of processors."""

import numpy as np
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


def test_each_vertex_goes_by_the_mean_of_its_joints_matrices():
    positions, directions, joints, weights, matrices = skinned(0)
    chosen = matrices[np.where(weights > 0.0, joints, 0)].astype(np.float64)
    blended = (weights[..., None] * chosen).sum(axis=1).reshape(-1, 3, 4)
    placed, turned = carried(kernels, (positions, directions, joints, weights, matrices))
    expected = np.einsum("vij,vj->vi", blended[..., :3], positions) + blended[..., 3]
    np.testing.assert_allclose(placed, expected, rtol=1e-5, atol=1e-5)
    expected = np.einsum("vij,vj->vi", blended[..., :3], directions)
    lengths = np.linalg.norm(expected, axis=1, keepdims=True)
    up = np.tile([0.0, 1.0, 0.0], (len(expected), 1))  # what no joint carries
    expected = np.divide(expected, lengths, out=up, where=lengths > 0.0)
    np.testing.assert_allclose(turned, expected, rtol=1e-5, atol=1e-5)


def test_skinning_is_the_same_at_every_level():
    assert_same_bits(lambda module: carried(module, skinned(1)))
