"""A small writer of GLB files for tests: `from scene.glb_builder import GlbBuilder`."""

from __future__ import annotations

import io
import json
import struct
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import PIL.Image

_CODES = {"i1": 5120, "u1": 5121, "i2": 5122, "u2": 5123, "u4": 5125, "f4": 5126}
_TYPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}
QUAD = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], np.float32)
QUAD_FACES = np.array([[0, 1, 2], [0, 2, 3]], np.uint16)
QUAD_UV = np.array([[0, 1], [1, 1], [1, 0], [0, 0]], np.float32)


class GlbBuilder:
    """Collects JSON and bytes; `document` may be changed freely before writing."""

    def __init__(self) -> None:
        self.document: dict[str, Any] = {
            "asset": {"version": "2.0"},
            "scene": 0,
            "scenes": [{"nodes": []}],
        }
        self.binary = bytearray()

    def add(self, key: str, item: dict[str, Any]) -> int:
        """Append to one of the document's lists; its index."""
        self.document.setdefault(key, []).append(item)
        return len(self.document[key]) - 1

    def view(self, data: bytes, **fields: Any) -> int:
        """A buffer view of bytes."""
        self.binary += b"\0" * (-len(self.binary) % 4)
        place = {"buffer": 0, "byteOffset": len(self.binary), "byteLength": len(data), **fields}
        self.binary += data
        return self.add("bufferViews", place)

    def accessor(self, values: Any, **fields: Any) -> int:
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

    def mesh(
        self,
        positions: Any = QUAD,
        faces: Any = QUAD_FACES,
        *,
        material: int | None = None,
        targets: Sequence[dict[str, Any]] = (),
        weights: Sequence[float] = (),
        mode: int = 4,
        **attributes: Any,
    ) -> int:
        """A mesh of one primitive; attributes by their glTF names."""
        named = {"POSITION": positions, **attributes}
        primitive: dict[str, Any] = {
            "attributes": {
                k: v if isinstance(v, int) else self.accessor(v) for k, v in named.items()
            },
            "mode": mode,
        }
        if faces is not None:
            primitive["indices"] = self.accessor(np.asarray(faces, np.uint32).ravel())
        if material is not None:
            primitive["material"] = material
        if targets:
            primitive["targets"] = [
                {k: self.accessor(np.asarray(v, np.float32)) for k, v in t.items()} for t in targets
            ]
        mesh: dict[str, Any] = {"primitives": [primitive]}
        if weights:
            mesh["weights"] = list(weights)
        return self.add("meshes", mesh)

    def node(self, *, root: bool = True, **fields: Any) -> int:
        """A node, in the scene unless it is somebody's child."""
        index = self.add("nodes", fields)
        if root:
            self.document["scenes"][0]["nodes"].append(index)
        return index

    def camera(self, yfov: float = 0.8, *, name: str = "", aspect: float | None = None) -> int:
        """A perspective camera."""
        lens = {"yfov": yfov, "znear": 0.1}
        if aspect is not None:
            lens["aspectRatio"] = aspect
        return self.add("cameras", {"type": "perspective", "perspective": lens, "name": name})

    def light(
        self, kind: str = "directional", *, node: dict[str, Any] | None = None, **f: Any
    ) -> int:
        """A punctual light on a node of its own; the node's index."""
        extension = self.document.setdefault("extensions", {}).setdefault(
            "KHR_lights_punctual", {"lights": []}
        )
        extension["lights"].append({"type": kind, **f})
        place = {"KHR_lights_punctual": {"light": len(extension["lights"]) - 1}}
        return self.node(**(node or {}), extensions=place)

    def animation(self, *channels: tuple[int, str, Any, Any, str], name: str = "") -> int:
        """A clip of channels (node, path, times, values, interpolation)."""
        samplers, targets = [], []
        for node, path, times, values, interpolation in channels:
            flat = np.asarray(values, np.float32)
            output = flat.reshape(-1) if path == "weights" else flat.reshape(-1, flat.shape[-1])
            samplers.append(
                {
                    "input": self.accessor(np.asarray(times, np.float32)),
                    "output": self.accessor(output),
                    "interpolation": interpolation,
                }
            )
            target = {"node": node, "path": path}
            targets.append({"sampler": len(samplers) - 1, "target": target})
        return self.add("animations", {"samplers": samplers, "channels": targets, "name": name})

    def skin(self, joints: Sequence[int], inverse_bind: Any) -> int:
        """A skin; inverse bind matrices (J, 4, 4), row-major as numpy has them."""
        columns = np.swapaxes(np.asarray(inverse_bind, np.float32), 1, 2)
        matrices = self.accessor(columns.reshape(-1, 16))
        return self.add("skins", {"joints": list(joints), "inverseBindMatrices": matrices})

    def texture(self, pixels: Any, **sampler: int) -> int:
        """A texture of uint8 pixels (H, W, 3 or 4), nearest filter unless told."""
        file = io.BytesIO()
        PIL.Image.fromarray(np.asarray(pixels, np.uint8)).save(file, "PNG")
        image = self.add(
            "images", {"bufferView": self.view(file.getvalue()), "mimeType": "image/png"}
        )
        chosen = self.add("samplers", {"magFilter": 9728, "minFilter": 9728, **sampler})
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
