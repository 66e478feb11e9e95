"""Buffer views that meshopt compresses, against an encoder written from the specification."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.glb_builder import GlbBuilder
from support.meshopt_streams import TriangleEncoder, encode_attributes, encode_sequence

from nlens_video.core.errors import SceneError
from nlens_video.scene.gltf.fields import Fields
from nlens_video.scene.gltf.meshopt import decompress
from nlens_video.scene.scene import Scene

SEEDS = st.integers(0, 2**32 - 1)


def decoded(mode, data, count, stride, filtering="NONE"):
    fields = {"mode": mode, "filter": filtering, "count": count, "byteStride": stride}
    return decompress(Fields(fields, "bufferViews[0]"), data)


def elements(seed, count, stride, spread):
    steps = np.random.default_rng(seed).normal(0.0, spread, (count, stride))
    return np.cumsum(np.round(steps), axis=0).astype(np.int64).astype(np.uint8)


@given(
    SEEDS, st.integers(1, 600), st.sampled_from([4, 12, 16, 64]), st.sampled_from([0, 0.3, 3, 90])
)
@pytest.mark.parametrize("version", [0, 1])
def test_attributes_come_back(version, seed, count, stride, spread):
    values = elements(seed, count, stride, spread)
    assert decoded("ATTRIBUTES", encode_attributes(values, version), count, stride) == (
        values.tobytes()
    )


def grid(columns, rows):
    corners = np.arange(columns * rows).reshape(rows, columns)
    a, b, c, d = corners[:-1, :-1], corners[:-1, 1:], corners[1:, :-1], corners[1:, 1:]
    return np.stack([a, c, b, b, c, d], axis=-1).ravel()


def rolled(indices):
    """Triangles from their smallest corner on."""
    triangles = np.reshape(indices, (-1, 3))
    first = np.argmin(triangles, axis=1)
    return np.take_along_axis(triangles, (first[:, None] + np.arange(3)) % 3, axis=1)


@pytest.mark.parametrize("version", [0, 1])
@pytest.mark.parametrize("stride", [2, 4])
def test_triangles_of_a_grid_come_back(version, stride):
    indices = grid(40, 30)
    data = TriangleEncoder(version).encode(indices)
    values = np.frombuffer(decoded("TRIANGLES", data, len(indices), stride), f"<u{stride}")
    np.testing.assert_array_equal(rolled(values), rolled(indices))


@given(SEEDS, st.integers(1, 80), st.sampled_from([9, 100, 70000]))
@pytest.mark.parametrize("version", [0, 1])
def test_triangles_in_no_order_come_back(version, seed, count, vertices):
    triangles = np.random.default_rng(seed).integers(1, vertices, (count, 3))
    indices = (np.sort(triangles, axis=1) + [0, vertices, 2 * vertices]).ravel()  # none alike
    data = TriangleEncoder(version).encode(indices)
    values = np.frombuffer(decoded("TRIANGLES", data, 3 * count, 4), "<u4")
    np.testing.assert_array_equal(rolled(values), rolled(indices))


@given(st.lists(st.integers(0, 2**29), min_size=1, max_size=200))
def test_index_sequences_come_back(indices):
    data = encode_sequence(indices)
    values = np.frombuffer(decoded("INDICES", data, len(indices), 4), "<u4")
    np.testing.assert_array_equal(values, indices)


@pytest.mark.parametrize(("dtype", "stride"), [("<i1", 4), ("<i2", 8)])
def test_octahedral_filter_gives_unit_vectors(dtype, stride):
    most = np.iinfo(dtype).max
    normals = np.random.default_rng(1).normal(size=(500, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    folded = normals / np.abs(normals).sum(axis=1, keepdims=True)
    below = folded[:, 2] < 0
    signs = np.where(folded[:, :2] < 0, -1.0, 1.0)
    xy = np.where(below[:, None], (1 - np.abs(folded[:, 1::-1])) * signs, folded[:, :2])
    stored = np.concatenate([xy, np.ones((500, 1)), np.zeros((500, 1))], axis=1)
    raw = np.round(most * stored).astype(dtype).view(np.uint8)
    data = decoded("ATTRIBUTES", encode_attributes(raw), 500, stride, "OCTAHEDRAL")
    found = np.frombuffer(data, dtype).reshape(-1, 4)[:, :3] / most
    assert np.abs(found - normals).max() < 4.0 / most


def test_quaternion_filter_restores_the_largest_component():
    turns = np.random.default_rng(2).normal(size=(500, 4))
    turns /= np.linalg.norm(turns, axis=1, keepdims=True)
    largest = np.argmax(np.abs(turns), axis=1)
    turns *= np.sign(np.take_along_axis(turns, largest[:, None], axis=1))
    others = (largest[:, None] + np.array([1, 2, 3])) & 3
    scale = 32767 & ~3
    three = np.round(np.take_along_axis(turns, others, axis=1) * np.sqrt(2.0) * (scale | 3))
    raw = np.concatenate([three, (scale | largest)[:, None]], axis=1).astype("<i2")
    data = encode_attributes(raw.view(np.uint8))
    found = np.frombuffer(decoded("ATTRIBUTES", data, 500, 8, "QUATERNION"), "<i2").reshape(-1, 4)
    assert np.abs(found / 32767 - turns).max() < 2e-4


def test_exponential_filter_restores_floats():
    mantissa = np.random.default_rng(3).integers(-(2**23), 2**23, (300, 3))
    exponent = np.random.default_rng(4).integers(-40, 40, (300, 3))
    words = (exponent << 24 | mantissa & 0xFFFFFF).astype("<i4")
    data = encode_attributes(words.view(np.uint8))
    found = np.frombuffer(decoded("ATTRIBUTES", data, 300, 12, "EXPONENTIAL"), "<f4")
    np.testing.assert_array_equal(found, np.ldexp(mantissa.astype(np.float32), exponent).ravel())


@given(SEEDS, st.data())
def test_damaged_streams_are_refused_in_one_line_or_decoded(seed, drawn):
    streams = (
        ("ATTRIBUTES", encode_attributes(elements(seed, 50, 12, 20.0)), 50, 12),
        ("TRIANGLES", TriangleEncoder().encode(grid(5, 5)), 96, 4),
        ("INDICES", encode_sequence(range(0, 400, 7)), 58, 2),
    )
    mode, data, count, stride = drawn.draw(st.sampled_from(streams))
    broken = bytearray(data[: drawn.draw(st.integers(1, len(data)))])
    for _ in range(drawn.draw(st.integers(0, 4))):
        broken[drawn.draw(st.integers(0, len(broken) - 1))] = drawn.draw(st.integers(0, 255))
    try:
        assert len(decoded(mode, bytes(broken), count, stride)) == count * stride
    except SceneError as error:
        assert str(error).startswith("bufferViews[0] is damaged: ")


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"byteStride": 6}, "byteStride is 6, expected one of 4, 8, 12"),
        ({"count": 0}, "count is 0"),
        ({"filter": "COLOR"}, "filter is 'COLOR', expected one of NONE"),
        ({"mode": "POINTS"}, "mode is 'POINTS'"),
    ],
)
def test_fields_that_make_no_sense_are_refused(change, words):
    fields = {"mode": "ATTRIBUTES", "count": 4, "byteStride": 4, **change}
    with pytest.raises(SceneError, match=words):
        decompress(Fields(fields, "bufferViews[0]"), encode_attributes(elements(0, 4, 4, 3.0)))


def test_scene_of_compressed_views_equals_the_plain_one(tmp_path):
    positions = np.random.default_rng(5).normal(size=(60, 3)).astype(np.float32)
    faces = grid(10, 6).reshape(-1, 3)
    plain = GlbBuilder()
    plain.node(mesh=plain.mesh(positions, faces))
    plain.write(tmp_path / "plain.glb")
    packed = GlbBuilder()
    packed.node(mesh=packed.mesh(positions, faces))
    for index, view in enumerate(packed.document["bufferViews"]):
        start = view["byteOffset"]
        data = bytes(packed.binary[start : start + view["byteLength"]])
        of_positions = len(data) == positions.nbytes
        stride = 12 if of_positions else len(data) // faces.size
        values = np.frombuffer(data, np.uint8).reshape(-1, stride)
        if of_positions:
            mode, stream = "ATTRIBUTES", encode_attributes(values)
        else:
            mode, stream = "TRIANGLES", TriangleEncoder().encode(faces.ravel())
        place = packed.document["bufferViews"][packed.view(stream)]
        packed.document["bufferViews"].pop()
        packed.document["bufferViews"][index] = {**view, "extensions": {
            "EXT_meshopt_compression": {**place, "mode": mode, "byteStride": stride,
                                        "count": len(values)},
        }}  # fmt: skip
    for key in ("extensionsUsed", "extensionsRequired"):
        packed.document[key] = ["EXT_meshopt_compression"]
    packed.write(tmp_path / "packed.glb")
    one, other = (Scene.load(tmp_path / f"{name}.glb").pose(0.0) for name in ("plain", "packed"))
    np.testing.assert_array_equal(one.meshes[0].positions, other.meshes[0].positions)
    assert (tmp_path / "packed.glb").read_bytes() != (tmp_path / "plain.glb").read_bytes()
