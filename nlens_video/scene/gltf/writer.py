"""A small writer of GLB files: a document and the bytes of its one buffer."""

from __future__ import annotations

import io
import json
import struct
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import PIL.Image

_CODES = {"i1": 5120, "u1": 5121, "i2": 5122, "u2": 5123, "u4": 5125, "f4": 5126}
_TYPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}
_LINEAR, _MIPMAPS = 9729, 9987

POINTER = "KHR_animation_pointer"

Fields = dict[str, Any]


class GlbWriter:
    """Collects a glTF document and its bytes; methods return the index of what they add.

    Attributes:
        document: may be changed freely before writing.
        binary: of the one buffer.
    """

    def __init__(self) -> None:
        self.document: Fields = {
            "asset": {"version": "2.0"},
            "scene": 0,
            "scenes": [{"nodes": []}],
        }
        self.binary = bytearray()

    def add(self, key: str, item: Mapping[str, object]) -> int:
        """Append to one of the document's lists."""
        self.document.setdefault(key, []).append(item)
        return len(self.document[key]) - 1

    def view(self, data: bytes, **fields: object) -> int:
        """A buffer view of bytes."""
        self.binary += b"\0" * (-len(self.binary) % 4)
        place = {"buffer": 0, "byteOffset": len(self.binary), "byteLength": len(data), **fields}
        self.binary += data
        return self.add("bufferViews", place)

    def accessor(self, values: npt.ArrayLike, **fields: object) -> int:
        """An accessor of an array (count, ...); its dtype is the component type."""
        array = np.asarray(values)
        array = array.astype(np.float32) if array.dtype == np.float64 else array
        flat = np.ascontiguousarray(array).reshape(len(array), -1)
        described = {
            "bufferView": self.view(flat.tobytes()),
            "componentType": _CODES[array.dtype.str[1:]],
            "count": len(array),
            "type": _TYPES[flat.shape[1]],
        }
        return self.add("accessors", {**described, **fields})

    def node(self, *, root: bool = True, **fields: object) -> int:
        """A node, in the scene unless it is another's child."""
        index = self.add("nodes", fields)
        if root:
            self.document["scenes"][0]["nodes"].append(index)
        return index

    def light(
        self, kind: str = "directional", *, node: Fields | None = None, **fields: object
    ) -> int:
        """A punctual light on a node of its own; the node's index."""
        extensions = self.document.setdefault("extensions", {})
        lights = extensions.setdefault("KHR_lights_punctual", {"lights": []})["lights"]
        lights.append({"type": kind, **fields})
        place = {"KHR_lights_punctual": {"light": len(lights) - 1}}
        return self.node(**(node or {}), extensions=place)

    def skin(self, joints: Sequence[int], inverse_bind: npt.ArrayLike) -> int:
        """A skin; inverse bind matrices (J, 4, 4), row-major as numpy has them."""
        columns = np.swapaxes(np.asarray(inverse_bind, np.float32), 1, 2)
        matrices = self.accessor(columns.reshape(-1, 16))
        return self.add("skins", {"joints": list(joints), "inverseBindMatrices": matrices})

    def animation(
        self,
        *channels: tuple[int | str, str, npt.ArrayLike, npt.ArrayLike, str],
        name: str = "",
    ) -> int:
        """A clip of channels: node, property, key times [s], values, interpolation.

        In place of the node, a path into the document (KHR_animation_pointer) with the property
        `pointer`. Values are (K, ...) of the property's width; of weights and numbers (K,).
        """
        samplers, targets = [], []
        for place, path, times, values, interpolation in channels:
            keys = np.asarray(times, np.float32)
            bounds = {"min": [float(keys.min())], "max": [float(keys.max())]}
            flat = np.asarray(values, np.float32)
            wide = flat.ndim > 1 and path != "weights"
            samplers.append({
                "input": self.accessor(keys, **bounds),
                "output": self.accessor(flat.reshape(-1, flat.shape[-1]) if wide else flat.ravel()),
                "interpolation": interpolation,
            })  # fmt: skip
            target: Fields = {"node": place, "path": path}
            if isinstance(place, str):
                target = {"path": path, "extensions": {POINTER: {"pointer": place}}}
                used = self.document.setdefault("extensionsUsed", [])
                used += [POINTER] if POINTER not in used else []
            targets.append({"sampler": len(samplers) - 1, "target": target})
        return self.add("animations", {"samplers": samplers, "channels": targets, "name": name})

    def texture(self, pixels: npt.ArrayLike, **sampler: int) -> int:
        """A texture of uint8 pixels (H, W, 3 or 4), trilinear by default."""
        file = io.BytesIO()
        PIL.Image.fromarray(np.asarray(pixels, np.uint8)).save(file, "PNG")
        image = self.add(
            "images", {"bufferView": self.view(file.getvalue()), "mimeType": "image/png"}
        )
        chosen = self.add("samplers", {"magFilter": _LINEAR, "minFilter": _MIPMAPS, **sampler})
        return self.add("textures", {"source": image, "sampler": chosen})

    def bytes(self) -> bytes:
        """The file."""
        document = dict(self.document)
        if self.binary:
            document["buffers"] = [{"byteLength": len(self.binary)}]
        text = json.dumps(document).encode()
        text += b" " * (-len(text) % 4)
        binary = bytes(self.binary) + b"\0" * (-len(self.binary) % 4)
        chunks = struct.pack("<II", len(text), 0x4E4F534A) + text
        chunks += struct.pack("<II", len(binary), 0x004E4942) + binary
        return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks

    def write(self, path: Path) -> Path:
        """Write it; the path."""
        path.write_bytes(self.bytes())
        return path
