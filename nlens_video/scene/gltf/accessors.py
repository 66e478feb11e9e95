"""Accessors: typed arrays out of the file's bytes (strided, normalised, quantised, sparse, Draco).

Draco's decoder is native code that trusts its input, so it runs in a process of its own, where it
can neither crash this one nor take its memory. All of a file's meshes are decoded at once, because
a process takes long to start.
"""

from __future__ import annotations

import importlib.util
import subprocess
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import numpy.typing as npt

from nlens_video.core.errors import SceneError
from nlens_video.core.layers import Float32
from nlens_video.scene.gltf.decode_worker import decode
from nlens_video.scene.gltf.document import Document
from nlens_video.scene.gltf.extensions import DECODE_FIRST
from nlens_video.scene.gltf.fields import Fields

_DTYPES: dict[int, npt.DTypeLike] = {
    5120: "<i1",
    5121: "<u1",
    5122: "<i2",
    5123: "<u2",
    5125: "<u4",
    5126: "<f4",
}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}

DRACO = "KHR_draco_mesh_compression"
_TRIANGLES = 4

Array = npt.NDArray[np.generic]


@dataclass(slots=True)
class AccessorReader:
    """Decodes a document's accessors, each at most once.

    Attributes:
        document: the file.
    """

    document: Document
    _items: tuple[Fields, ...] = field(init=False)
    _cache: dict[int, Array] = field(default_factory=dict)
    _floats: dict[int, Float32] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._items = self.document.items("accessors")

    @property
    def count(self) -> int:
        """Accessors in the file."""
        return len(self._items)

    def width(self, index: int) -> int:
        """Components of each element of an accessor (1, 2, 3, 4 or 16)."""
        return _WIDTHS[self._items[index].choice("type", _WIDTHS)]

    def provide(self, index: int, values: Array) -> None:
        """Give an accessor values (count, width) that its buffer view does not hold.

        Raises:
            SceneError: they are not as wide as it says.
        """
        item = self._items[index]
        if values.shape[1] != self.width(index):
            raise item.wrong("type", f"{values.shape[1]} components, as its data have")
        self.document.spend(values.nbytes, item.place)
        self._cache[index] = values.astype(self._dtype(item))

    def length(self, index: int) -> int:
        """Elements of an accessor."""
        return self._items[index].integer("count")

    def integers(self, index: int) -> npt.NDArray[np.int64]:
        """The values of an integer accessor (count, width).

        Raises:
            SceneError: it holds floats or lies outside its buffer.
        """
        raw = self._raw(index)
        if raw.dtype.kind not in "iu":
            raise self._items[index].wrong("componentType", "an integer type")
        return raw.astype(np.int64)

    def floats(self, index: int, width: int) -> Float32:
        """The values (count, width) as float32, normalised integers mapped to [0, 1] or [-1, 1].

        Raises:
            SceneError: another width, outside its buffer, or a value that is not finite.
        """
        if self.width(index) != width:
            raise self._items[index].wrong("type", f"{width} components")
        if index not in self._floats:
            values = self._to_float(index)
            values.flags.writeable = False
            self._floats[index] = values
        return self._floats[index]

    def _to_float(self, index: int) -> Float32:
        item, raw = self._items[index], self._raw(index)
        self.document.spend(raw.size * 4, item.place)
        values = raw.astype(np.float32)
        if not np.isfinite(values).all():
            raise SceneError(f"{item.place} holds NaN or infinite values; export the file again")
        if raw.dtype.kind != "f" and item.flag("normalized"):
            highest = np.float32(2 ** (8 * raw.itemsize - (raw.dtype.kind == "i")) - 1)
            values = np.maximum(np.divide(values, highest), np.float32(-1.0))
        return values

    def _raw(self, index: int) -> Array:
        if index not in self._cache:
            self._cache[index] = self._decode(index)
        return self._cache[index]

    def _decode(self, index: int) -> Array:
        item = self._items[index]
        dtype = self._dtype(item)
        count, width = item.integer("count"), self.width(index)
        if count == 0:
            raise item.wrong("count", "an integer of 1 or more")
        view = item.reference("bufferView", len(self.document.items("bufferViews")))
        if view is None:
            self.document.spend(count * width * dtype.itemsize, item.place)
            values: Array = np.zeros((count, width), dtype)
        else:
            values = self._strided(item, view, dtype, (count, width))
        if "sparse" in item:
            values = self._substitute(item.child("sparse"), values)
        return values

    @staticmethod
    def _dtype(item: Fields) -> np.dtype[np.generic]:
        return np.dtype(_DTYPES[item.choice("componentType", _DTYPES)])

    def _strided(
        self, item: Fields, view: int, dtype: np.dtype[np.generic], shape: tuple[int, int]
    ) -> Array:
        data = self.document.buffer_view(view)
        declared = self.document.items("bufferViews")[view]
        size = shape[1] * dtype.itemsize
        stride = declared.integer("byteStride", default=size) or size
        offset = item.integer("byteOffset", default=0)
        if stride < size:
            raise declared.wrong("byteStride", f"at least {size}")
        end = offset + (shape[0] - 1) * stride + size
        if end > len(data):
            raise SceneError(
                f"{item.place} needs {end} bytes, its buffer view has {len(data)}; "
                "the file is damaged"
            )
        return np.ndarray(shape, dtype, data, offset, (stride, dtype.itemsize))

    def _substitute(self, sparse: Fields, values: Array) -> Array:
        count = sparse.integer("count", below=len(values) + 1)
        self.document.spend(values.nbytes, sparse.place)
        values = values.copy()
        if count == 0:
            return values
        where, what = sparse.child("indices"), sparse.child("values")
        views = len(self.document.items("bufferViews"))
        dtype = self._dtype(where)
        if dtype.kind != "u":
            raise where.wrong("componentType", "5121, 5123 or 5125")
        indices = self._strided(where, where.integer("bufferView", below=views), dtype, (count, 1))
        if int(indices.max()) >= len(values):
            raise SceneError(f"{where.place} points beyond {len(values)} elements; export again")
        shape = (count, values.shape[1])
        values[indices[:, 0].astype(np.int64)] = self._strided(
            what, what.integer("bufferView", below=views), values.dtype, shape
        )
        return values


@dataclass(slots=True)
class DracoReader:
    """Hands the document's Draco meshes to its accessors.

    Attributes:
        document: the file.
        accessors: its accessors; those of a Draco mesh have no buffer view.
    """

    document: Document
    accessors: AccessorReader
    _decoded: dict[str, npt.NDArray[Any]] | None = field(default=None)

    def provide(self, primitive: Fields, compressed: Fields) -> None:
        """Give the accessors of a primitive their values.

        Raises:
            SceneError: no decoder, broken data, or an attribute that it does not hold.
        """
        if primitive.integer("mode", default=_TRIANGLES) != _TRIANGLES:
            raise primitive.wrong("mode", "triangles (4), as Draco holds them")
        if self._decoded is None:
            self._decoded = self._decode()
        view = compressed.integer("bufferView", below=len(self.document.items("bufferViews")))
        attributes, ids = primitive.child("attributes"), compressed.child("attributes")
        for name in ids.data:
            self._give(attributes, name, f"{view}/{ids.integer(name)}", compressed)
        if "indices" in primitive:
            self._give(primitive, "indices", f"{view}/faces", compressed)

    def _give(self, owner: Fields, name: str, key: str, compressed: Fields) -> None:
        values = (self._decoded or {}).get(key)
        if values is None:
            raise SceneError(f"{compressed.place} holds no {name[:40]}; {DECODE_FIRST}")
        index = owner.integer(name, below=self.accessors.count)
        self.accessors.provide(index, values)

    def _decode(self) -> dict[str, npt.NDArray[Any]]:
        if importlib.util.find_spec("DracoPy") is None:
            raise SceneError(
                f"its meshes are compressed ({DRACO}) and the decoder is not installed: "
                f"pip install nlens-video[draco]; or {DECODE_FIRST}"
            )
        try:
            decoded = decode("draco", self._views())
        except (OSError, subprocess.TimeoutExpired) as error:
            raise SceneError(f"its Draco meshes cannot be decoded ({error})") from error
        if decoded is None:
            raise SceneError(f"its Draco meshes are broken or too large; {DECODE_FIRST}")
        return decoded

    def _views(self) -> dict[str, npt.NDArray[np.uint8]]:
        views: dict[str, npt.NDArray[np.uint8]] = {}
        count = len(self.document.items("bufferViews"))
        for mesh in self.document.items("meshes"):
            for primitive in mesh.children("primitives"):
                compressed = primitive.extension(DRACO)
                if compressed is not None:
                    view = compressed.integer("bufferView", below=count)
                    if str(view) not in views:
                        data = self.document.buffer_view(view)
                        self.document.spend(len(data), compressed.place)
                        views[str(view)] = np.frombuffer(data, np.uint8)
        return views
