"""Compiled animation and node transforms against their references."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from nlens_video.scene.gltf import animation_kernels
from nlens_video.scene.gltf.animation_kernels import CUBIC, LINEAR, STEP

KEYS = st.integers(1, 6)


def unit(rng, count):
    quaternions = rng.normal(size=(count, 4))
    return quaternions / np.linalg.norm(quaternions, axis=1, keepdims=True)


@settings(max_examples=200)
@given(
    seed=st.integers(0, 10_000), kind=st.sampled_from([STEP, LINEAR, CUBIC]), count=KEYS,
    turns=st.booleans(), at=st.floats(-0.5, 1.5), on_key=st.booleans(), nearly=st.booleans(),
)  # fmt: skip
def test_sampled_track_agrees_with_the_reference(seed, kind, count, turns, at, on_key, nearly):
    rng = np.random.default_rng(seed)
    times = np.cumsum(0.1 + rng.random(count))
    values = rng.normal(size=(count, 3, 4 if turns else 3))
    if turns:
        values[:, 1] = unit(rng, count)
        if nearly:  # the same rotation, of either sign: the sphere's weights have no denominator
            values[:, 1] = values[0, 1] * rng.choice([-1.0, 1.0], (count, 1))
    time_s = times[seed % count] if on_key else times[0] + at * (times[-1] - times[0])
    earlier = rng.normal(size=(2, 3, values.shape[2]))  # another track's keys lie before it
    out = rng.normal(size=(3, 10))
    before = out.copy()
    column = 3 if turns else 7
    tracks = np.array([[1, column, values.shape[2], kind, turns, 2, 2, count]])
    animation_kernels.sample(
        time_s, tracks, np.concatenate([[0.0, 9.0], times]), np.concatenate([earlier, values]), out
    )
    expected = animation_kernels.sample_ref(time_s, times, values, kind, turns=turns)
    written = slice(column, column + values.shape[2])
    np.testing.assert_allclose(out[1, written], expected, atol=1e-12)
    out[1, written] = before[1, written]
    np.testing.assert_array_equal(out, before)


def test_zero_quaternion_is_the_identity_rotation():
    out = np.zeros((1, 10))
    tracks = np.array([[0, 3, 4, LINEAR, 1, 0, 0, 1]])
    animation_kernels.sample(0.0, tracks, np.zeros(1), np.zeros((1, 3, 4)), out)
    np.testing.assert_array_equal(out[0, 3:7], [0, 0, 0, 1])


@settings(max_examples=50)
@given(seed=st.integers(0, 10_000), count=st.integers(1, 12))
def test_world_matrices_are_products_from_the_root_down(seed, count):
    rng = np.random.default_rng(seed)
    parents = [int(rng.integers(-1, node)) for node in range(count)]
    names = rng.permutation(count)  # parents need not come first in the file
    above = np.full(count, -1)
    for node, parent in enumerate(parents):
        above[names[node]] = -1 if parent < 0 else names[parent]
    local = np.concatenate(
        [rng.normal(size=(count, 3)), unit(rng, count), rng.normal(size=(count, 3))], axis=1
    )
    has_matrix = rng.random(count) < 0.3
    matrices = rng.normal(size=(count, 4, 4))
    matrices[:, 3] = [0, 0, 0, 1]
    world = np.full((count, 4, 4), np.nan)
    order = np.stack([names, above[names]], axis=1)
    animation_kernels.multiply(local, order, matrices, has_matrix, world)
    own = [
        matrices[node] if has_matrix[node] else animation_kernels.compose_ref(local[node])
        for node in range(count)
    ]
    for node in range(count):
        expected = animation_kernels.world_ref(node, own, above)
        np.testing.assert_allclose(world[node], expected, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize("factor", [1e200, np.inf, np.nan])
def test_infinite_and_nan_transforms_propagate(factor):
    local = np.zeros((2, 10))
    local[:, 6] = 1.0
    local[:, 7:] = factor
    world = np.empty((2, 4, 4))
    none = np.zeros(2, bool)
    animation_kernels.multiply(local, np.array([[0, -1], [1, 0]]), np.empty((2, 4, 4)), none, world)
    assert not np.isfinite(world).all()


@settings(max_examples=200)
@given(seed=st.integers(0, 10_000), size=st.sampled_from([1e-18, 1.0, 1e18]), count=KEYS)
def test_normal_matrices_keep_normals_across_their_surface_and_on_its_outer_side(seed, size, count):
    rng = np.random.default_rng(seed)
    linear = size * rng.normal(size=(count, 3, 3))
    turners = animation_kernels.normal_matrices(linear)
    for own, turner in zip(linear, turners, strict=True):
        first, second, third = rng.normal(size=(3, 3))
        normal = turner @ np.cross(first, second)
        sides = np.stack([own @ first, own @ second]) / size
        np.testing.assert_allclose(sides @ normal, 0.0, atol=1e-9)
        outer = np.cross(first, second) @ third > 0.0
        assert (own @ third @ normal > 0.0) == outer
        assert np.abs(turner).max() == pytest.approx(1.0)


def test_normal_matrix_of_each_of_many_is_that_of_it_alone_also_where_it_flattens():
    rng = np.random.default_rng(3)
    scales = rng.normal(size=(300, 3)) * (rng.random((300, 3)) > 0.3)
    linear = np.linalg.qr(rng.normal(size=(300, 3, 3)))[0] * scales[:, None]
    together = animation_kernels.normal_matrices(linear)
    alone = [animation_kernels.normal_matrices(one[None])[0] for one in linear]
    np.testing.assert_array_equal(together, alone)
    nothing = animation_kernels.normal_matrices(np.zeros((1, 3, 3)))
    np.testing.assert_array_equal(nothing[0], np.eye(3))
    flat = animation_kernels.normal_matrices(np.diag([2.0, 3.0, 0.0])[None])
    np.testing.assert_array_equal(flat[0], np.diag([0.0, 0.0, 1.0]))
