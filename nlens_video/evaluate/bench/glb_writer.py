"""A small GLB writer for the scenes of `bench` and of the study."""

from __future__ import annotations

import io
import json
import struct
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import PIL.Image

from nlens_video.core.layers import Float64, UInt8

_CODES = {"i1": 5120, "u1": 5121, "i2": 5122, "u2": 5123, "u4": 5125, "f4": 5126}
_TYPES = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}
_LINEAR, _MIPMAPS = 9729, 9987
_KEY, _FILL = (-0.3, 0.25, 0.0, 0.9), (0.35, -0.3, 0.0, 0.9)  # from above right, from below left

Fields = dict[str, Any]


@dataclass(frozen=True, slots=True, kw_only=True)
class TexturedMesh:
    """Textured triangles.

    Attributes:
        points: vertices (V, 3), camera-space: x right, y up, looking along -z [scene unit].
        uv: texture coordinates (V, 2) [1].
        faces: vertices of each triangle (T, 3).
        texture: display-coded RGB (h, w, 3).
        normals: unit normals (V, 3) of a surface that lights shine on; None for one that glows.
        joint: the joint that carries each vertex (V,), None where nothing does.
    """

    points: Float64
    uv: Float64
    faces: npt.NDArray[np.int64]
    texture: UInt8
    normals: Float64 | None = None
    joint: npt.NDArray[np.int64] | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Joint:
    """A joint: its place at rest (3,) [scene unit], its pose as a quaternion (x, y, z, w).

    The parent is the number of a joint before this one, None for the root.
    """

    at: Float64
    parent: int | None = None
    turn: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 1.0)


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


def write_glb(
    path: Path, surfaces: Sequence[TexturedMesh], yfov: float, joints: Sequence[Joint] = ()
) -> None:
    """Write surfaces, two lights, and a camera of `yfov` [rad] at the origin that looks along -z.

    `joints` are the skeleton that carries the surfaces, none if nothing is carried.
    """
    glb = GlbWriter()
    glb.document["extensionsUsed"] = ["KHR_materials_unlit", "KHR_lights_punctual"]
    lens = {"yfov": yfov, "znear": 0.01}
    glb.node(camera=glb.add("cameras", {"type": "perspective", "perspective": lens}))
    for turn, intensity in ((_KEY, 2.5), (_FILL, 1.2)):
        glb.light(node={"rotation": _unit(turn)}, intensity=intensity)
    skin: Fields = {"skin": _add_skeleton(glb, joints)} if joints else {}
    for surface in surfaces:
        glb.node(mesh=_add_mesh(glb, surface), **skin)
    glb.write(path)


def _unit(quaternion: Sequence[float]) -> list[float]:
    values = np.asarray(quaternion, np.float64)
    return [float(value) for value in values / np.linalg.norm(values)]


def _add_skeleton(glb: GlbWriter, joints: Sequence[Joint]) -> int:
    """The joints' nodes, and the skin."""
    first = len(glb.document["nodes"])
    bind = np.tile(np.eye(4), (len(joints), 1, 1))
    for number, joint in enumerate(joints):
        away = np.zeros(3) if joint.parent is None else joints[joint.parent].at
        children = [first + at for at, other in enumerate(joints) if other.parent == number]
        glb.node(
            root=joint.parent is None, translation=(joint.at - away).tolist(),
            rotation=_unit(joint.turn), **({"children": children} if children else {}),
        )  # fmt: skip
        bind[number, :3, 3] = -joint.at
    return glb.skin(range(first, first + len(joints)), bind)


def _add_mesh(glb: GlbWriter, surface: TexturedMesh) -> int:
    material: Fields = {
        "doubleSided": True,
        "pbrMetallicRoughness": {
            "baseColorTexture": {"index": glb.texture(surface.texture)},
            "metallicFactor": 0.0,
            "roughnessFactor": 0.8,
        },
    }
    points = surface.points.astype(np.float32)  # glTF asks for the bounds of positions
    bounds = {"min": points.min(axis=0).tolist(), "max": points.max(axis=0).tolist()}
    attributes = {
        "POSITION": glb.accessor(points, **bounds),
        "TEXCOORD_0": glb.accessor(surface.uv),
    }
    if surface.normals is None:
        material["extensions"] = {"KHR_materials_unlit": {}}
    else:
        attributes["NORMAL"] = glb.accessor(surface.normals)
    if surface.joint is not None:
        carried = np.zeros((len(surface.joint), 4), np.uint8)
        carried[:, 0] = surface.joint
        attributes["JOINTS_0"] = glb.accessor(carried)
        attributes["WEIGHTS_0"] = glb.accessor(np.tile([1.0, 0, 0, 0], (len(carried), 1)))
    primitive = {
        "attributes": attributes,
        "indices": glb.accessor(surface.faces.astype(np.uint32).ravel()),
        "material": glb.add("materials", material),
    }
    return glb.add("meshes", {"primitives": [primitive]})
