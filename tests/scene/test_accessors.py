"""Accessors: every packing of numbers that glTF allows; others are refused."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.glb_builder import GlbBuilder

from nlens_video.core.errors import SceneError
from nlens_video.scene.gltf import document
from nlens_video.scene.gltf.accessors import AccessorReader
from nlens_video.scene.gltf.document import Document
from nlens_video.scene.gltf.fields import Fields

LIMITS = {"i1": 127, "u1": 255, "i2": 32767, "u2": 65535}


def reader(builder, tmp_path=None):
    document = {**builder.document, "buffers": [{"byteLength": len(builder.binary)}]}
    return AccessorReader(Document(Fields(document, ""), tmp_path, bytes(builder.binary)))


@settings(max_examples=60)
@given(
    st.sampled_from(sorted(LIMITS)),
    st.integers(1, 9),
    st.sampled_from([1, 2, 3, 4]),
    st.integers(0, 7),
    st.integers(0, 9),
    st.booleans(),
    st.randoms(use_true_random=False),
)
def test_strided_and_normalised_accessors_agree_with_a_plain_reading(
    code, count, width, pad, offset, normalized, random
):
    rng = np.random.default_rng(random.randrange(2**32))
    info = np.iinfo(code)
    values = rng.integers(info.min, info.max, (count, width), endpoint=True).astype(code)
    size = width * values.itemsize
    rows = [row.tobytes() + bytes(pad) for row in values]
    builder = GlbBuilder()
    view = builder.view(bytes(offset) + b"".join(rows), byteStride=size + pad)
    index = builder.accessor(values, bufferView=view, byteOffset=offset, normalized=normalized)
    expected = values.astype(float)
    if normalized:
        expected = np.maximum(expected / LIMITS[code], -1.0)
    read = reader(builder).floats(index, width)
    assert read.dtype == np.float32
    np.testing.assert_allclose(read, expected, rtol=1e-6)


@settings(max_examples=40)
@given(st.integers(1, 12), st.data(), st.booleans())
def test_sparse_accessor_replaces_base_values_or_zeros(count, data, based):
    chosen = sorted(data.draw(st.sets(st.integers(0, count - 1), min_size=1)))
    base = np.arange(3 * count, dtype=np.float32).reshape(count, 3)
    new = -1.0 - np.arange(3 * len(chosen), dtype=np.float32).reshape(-1, 3)
    builder = GlbBuilder()
    index = builder.accessor(base)
    item = builder.document["accessors"][index]
    if not based:
        del item["bufferView"]
    indices = np.array(chosen, np.uint16)
    item["sparse"] = {
        "count": len(chosen),
        "indices": {"bufferView": builder.view(indices.tobytes()), "componentType": 5123},
        "values": {"bufferView": builder.view(new.tobytes())},
    }
    expected = base.copy() if based else np.zeros_like(base)
    expected[chosen] = new
    np.testing.assert_array_equal(reader(builder).floats(index, 3), expected)


def test_accessor_beyond_its_buffer_view_is_refused():
    builder = GlbBuilder()
    index = builder.accessor(np.zeros((3, 3), np.float32))
    builder.document["accessors"][index]["count"] = 4
    with pytest.raises(SceneError, match="needs 48 bytes, its buffer view has 36"):
        reader(builder).floats(index, 3)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_accessor_values_that_are_not_finite_are_refused(value):
    builder = GlbBuilder()
    index = builder.accessor(np.array([[0, value, 0]], np.float32))
    with pytest.raises(SceneError, match="NaN or infinite"):
        reader(builder).floats(index, 3)


@pytest.mark.parametrize("count", [10**9, 10**15, 10**30])
def test_accessor_of_zeros_larger_than_the_limit_is_refused(count):
    builder = GlbBuilder()
    index = builder.accessor(np.zeros((1, 4), np.float32))
    item = builder.document["accessors"][index]
    del item["bufferView"]
    item["count"] = count
    with pytest.raises(SceneError, match="not loaded"):
        reader(builder).floats(index, 4)


def test_repeated_decoding_of_the_same_bytes_is_limited(monkeypatch):
    monkeypatch.setattr(document, "_FREE_BYTES", 1 << 20)
    builder = GlbBuilder()
    view = builder.view(bytes(1 << 18))
    indices = [
        builder.accessor(np.zeros((1, 1), np.uint8), bufferView=view, count=1 << 18)
        for _ in range(30)
    ]
    accessors = reader(builder)
    with pytest.raises(SceneError, match="not loaded"):
        for index in indices:
            accessors.floats(index, 1)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"count": 0}, "1 or more"),
        ({"count": -1}, "0 or more"),
        ({"count": "3"}, "integer"),
        ({"componentType": 5124}, "expected one of 5120"),
        ({"type": "VEC9"}, "one of SCALAR"),
        ({"bufferView": 7}, "below 1"),
        ({"byteOffset": 1e400}, "integer"),
    ],
)
def test_invalid_accessor_declarations_are_refused_by_name(change, message):
    builder = GlbBuilder()
    index = builder.accessor(np.zeros((3, 3), np.float32))
    builder.document["accessors"][index].update(change)
    with pytest.raises(SceneError, match=message) as raised:
        reader(builder).floats(index, 3)
    assert "accessors[0]" in str(raised.value)
