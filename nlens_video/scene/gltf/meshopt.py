"""Decoder of EXT_meshopt_compression and KHR_meshopt_compression: compressed buffer views.

Modes and filters are those of the extension's specification (appendices A and B). Three codecs:
vertex attributes are bytes, delta-coded against the vertex before and packed in groups of sixteen;
triangles refer to recent edges and vertices; index sequences are deltas against two baselines.
Written in Python on purpose: what the file says can reach no memory but these arrays.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from nlens_video.core.errors import SceneError
from nlens_video.scene.gltf.fields import Fields
from nlens_video.scene.gltf.meshopt_indices import (
    MeshoptError,
    check_end,
    decode_sequence,
    decode_triangles,
    version_of,
)

Bytes = npt.NDArray[np.uint8]

EXTENSIONS = ("EXT_meshopt_compression", "KHR_meshopt_compression")
_MODES = ("ATTRIBUTES", "TRIANGLES", "INDICES")
_FILTERS = ("NONE", "OCTAHEDRAL", "QUATERNION", "EXPONENTIAL")
_FILTERED_STRIDES: dict[str, Sequence[int]] = {"OCTAHEDRAL": (4, 8), "QUATERNION": (8,)}
_GROUP = 16  # bytes that share a width
_BLOCK_BYTES, _BLOCK_MOST = 8192, 256  # of a block of vertices
_WIDTHS_V0 = (0, 2, 4, 8)  # bits of each byte of a group
_WIDTHS_V1 = ((0, 1, 2, 4), (1, 2, 4, 8))
_ZERO, _LITERAL = 2, 3  # control of a block's byte, version 1
_TAIL_LEAST = (32, 24)


def decompress(view: Fields, data: bytes) -> bytes:
    """The bytes of a compressed buffer view.

    Args:
        view: the extension's object.
        data: the bytes that it names.

    Raises:
        SceneError: a field makes no sense, or the data are damaged.
    """
    mode = view.choice("mode", _MODES)
    filtering = view.choice("filter", _FILTERS, "NONE")
    count, stride = view.integer("count"), view.integer("byteStride")
    strides: Sequence[int] = range(4, 257, 4) if mode == "ATTRIBUTES" else (2, 4)
    strides = _FILTERED_STRIDES.get(filtering, strides)
    if stride not in strides:
        raise view.wrong("byteStride", f"one of {', '.join(map(str, strides[:3]))} and so on")
    if count < 1 or (mode == "TRIANGLES" and count % 3):
        raise view.wrong("count", "1 or more, of triangles a multiple of 3")
    try:
        if mode == "ATTRIBUTES":
            return _filtered(_attributes(data, count, stride), filtering)
        decode = decode_triangles if mode == "TRIANGLES" else decode_sequence
        indices = np.array(decode(data, count), np.uint32)
        return indices.astype("<u2" if stride == 2 else "<u4").tobytes()
    except (MeshoptError, IndexError) as error:
        reason = str(error) if isinstance(error, MeshoptError) else "its data end early"
        raise SceneError(f"{view.place} is damaged: {reason}; export the file again") from error


def _attributes(data: bytes, count: int, stride: int) -> Bytes:
    """Elements (count, stride) of the attribute codec."""
    version = version_of(data, 0xA0)
    tail = stride + (stride // 4 if version else 0)
    end = len(data) - max(tail, _TAIL_LEAST[version])
    stream = np.frombuffer(data, np.uint8)
    if end < 1:
        raise IndexError
    before = stream[len(data) - tail :][:stride].astype(np.uint8)
    channels = data[len(data) - tail + stride :] if version else bytes(stride // 4)
    block = min(_BLOCK_BYTES // stride & ~(_GROUP - 1), _BLOCK_MOST)
    out = np.empty((count, stride), np.uint8)
    at = 1
    for first in range(0, count, block):
        size = min(block, count - first)
        deltas = np.empty((size, stride), np.uint8)
        control = data[at : at + stride // 4] if version else bytes(stride // 4)
        at += len(control) if version else 0
        for byte in range(stride):
            kind = control[byte // 4] >> (2 * (byte % 4)) & 3
            if kind == _LITERAL:
                deltas[:, byte], at = _taken(stream, at, size), at + size
            elif kind == _ZERO:
                deltas[:, byte] = 0
            else:
                widths = _WIDTHS_V1[kind] if version else _WIDTHS_V0
                deltas[:, byte], at = _unpacked(stream, at, size, widths)
        out[first : first + size] = _undone(deltas, before, channels)
        before = out[first + size - 1]
    check_end(at, end)
    return out


def _taken(stream: Bytes, at: int, size: int) -> Bytes:
    if at + size > len(stream):
        raise IndexError
    return stream[at : at + size]


def _unpacked(stream: Bytes, at: int, size: int, widths: tuple[int, ...]) -> tuple[Bytes, int]:
    """One byte of each of `size` vertices, and where the stream goes on."""
    groups = -(-size // _GROUP)
    header = _taken(stream, at, -(-groups // 4))
    at += len(header)
    values = np.zeros(groups * _GROUP, np.uint8)
    for group in range(groups):
        width = widths[int(header[group // 4]) >> (2 * (group % 4)) & 3]
        if not width:
            continue
        packed = _taken(stream, at, 2 * width)
        at += 2 * width
        if width == 8:
            values[group * _GROUP :][:_GROUP] = packed
            continue
        # single bits lie from the lowest on, wider values from the highest
        bits = np.unpackbits(packed, bitorder="little" if width == 1 else "big")
        part = np.packbits(bits.reshape(_GROUP, width), axis=1)[:, 0] >> (8 - width)
        explicit = part == (1 << width) - 1  # stands for a byte that follows
        follow = int(np.count_nonzero(explicit))
        part[explicit] = _taken(stream, at, follow)
        at += follow
        values[group * _GROUP :][:_GROUP] = part
    return values[:size], at


def _undone(deltas: Bytes, before: Bytes, channels: bytes) -> Bytes:
    """Elements of a block from their differences, four bytes at a time."""
    out = np.empty_like(deltas)
    for part, channel in enumerate(channels):
        four = slice(4 * part, 4 * part + 4)
        kind = channel & 3
        if kind > 2:
            raise MeshoptError(f"a channel is of kind {kind}, expected 0, 1 or 2")
        dtype = np.dtype(("<u1", "<u2", "<u4")[kind])
        coded = np.ascontiguousarray(deltas[:, four]).view(dtype)
        start = np.ascontiguousarray(before[four]).view(dtype)
        if kind == 2:
            turn = np.uint32(channel >> 4)
            turned = coded if not turn else coded >> turn | coded << (np.uint32(32) - turn)
            whole = np.bitwise_xor.accumulate(np.concatenate([start[None], turned]), axis=0)
        else:
            one = dtype.type(1)
            steps = (coded >> one) ^ (dtype.type(0) - (coded & one))  # zigzag
            whole = np.cumsum(np.concatenate([start[None], steps]), axis=0, dtype=dtype)
        out[:, four] = np.ascontiguousarray(whole[1:]).view(np.uint8)
    return out


def _filtered(values: Bytes, filtering: str) -> bytes:
    """The bytes of attributes (count, stride) after their filter."""
    if filtering == "OCTAHEDRAL":
        return _octahedral(values.view("<i1" if values.shape[1] == 4 else "<i2")).tobytes()
    if filtering == "QUATERNION":
        return _quaternion(values.view("<i2")).tobytes()
    if filtering == "EXPONENTIAL":
        words = values.view("<i4")
        with np.errstate(over="ignore"):  # accessors refuse infinite values
            floats = np.ldexp((words << 8 >> 8).astype(np.float32), words >> 24)
        return bytes(floats.astype("<f4").tobytes())
    return values.tobytes()


def _octahedral(values: npt.NDArray[np.signedinteger]) -> npt.NDArray[np.signedinteger]:
    """Unit vectors (N, 4) of octahedral ones; the fourth component stays."""
    most = np.iinfo(values.dtype).max
    xy = values[:, :2].astype(np.float32)
    z = values[:, 2].astype(np.float32) - np.abs(xy).sum(axis=1)
    folded = np.minimum(z, 0.0)[:, None]
    xy += np.where(xy >= 0.0, folded, -folded)
    xyz = np.concatenate([xy, z[:, None]], axis=1)
    length = np.maximum(np.linalg.norm(xyz, axis=1, keepdims=True), 1e-12)
    out = values.copy()
    out[:, :3] = _rounded(xyz * (most / length))
    return out


def _quaternion(values: npt.NDArray[np.int16]) -> npt.NDArray[np.int16]:
    """Unit quaternions (N, 4) of their three smaller components."""
    scale = np.float32(np.sqrt(0.5)) / (values[:, 3] | 3).astype(np.float32)
    three = values[:, :3].astype(np.float32) * scale[:, None]
    largest = np.sqrt(np.maximum(1.0 - np.square(three).sum(axis=1), 0.0))
    parts = _rounded(32767.0 * np.concatenate([three, largest[:, None]], axis=1))
    places = ((values[:, 3] & 3)[:, None] + np.array([1, 2, 3, 0])) & 3
    out = np.empty_like(values)
    np.put_along_axis(out, places.astype(np.intp), parts.astype(np.int16), axis=1)
    return out


def _rounded(values: npt.NDArray[np.floating]) -> npt.NDArray[np.int32]:
    return np.asarray(np.trunc(values + np.where(values >= 0.0, 0.5, -0.5)), np.int32)
