"""A small GLB writer for the scenes of `bench` and of the study."""

from __future__ import annotations

import json
import struct
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from nlens_video.core.layers import Float64

UInt8 = npt.NDArray[np.uint8]

_FLOAT, _UINT8, _UINT32 = 5126, 5121, 5125
_LINEAR, _MIPMAPS = 9729, 9987
_LIGHTS = [
    {"type": "directional", "intensity": 2.5},
    {"type": "directional", "intensity": 1.2},
]
_SHINE = ((-0.3, 0.25, 0.0, 0.9), (0.35, -0.3, 0.0, 0.9))  # from above right, from below left
_KINDS = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}


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
    """A joint of a skeleton at rest and as it is posed.

    Attributes:
        at: where it lies at rest (3,) [scene unit].
        parent: number of the joint it hangs on, before this one; None for the root.
        turn: quaternion (x, y, z, w) of its pose.
    """

    at: Float64
    parent: int | None = None
    turn: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 1.0)


@dataclass(slots=True)
class _Glb:
    """A file in the making."""

    document: dict[str, list[object]] = field(default_factory=dict)
    binary: bytearray = field(default_factory=bytearray)

    def add(self, key: str, item: object) -> int:
        items = self.document.setdefault(key, [])
        items.append(item)
        return len(items) - 1

    def view(self, data: bytes) -> int:
        self.binary += b"\0" * (-len(self.binary) % 4)
        place = {"buffer": 0, "byteOffset": len(self.binary), "byteLength": len(data)}
        self.binary += data
        return self.add("bufferViews", place)

    def accessor(self, values: npt.NDArray[np.generic], component: int) -> int:
        flat = values.reshape(len(values), -1)
        described: dict[str, object] = {
            "bufferView": self.view(np.ascontiguousarray(flat).tobytes()),
            "componentType": component,
            "count": len(flat),
            "type": _KINDS[flat.shape[1]],
        }
        if flat.shape[1] == 3 and component == _FLOAT:  # glTF asks for the bounds of positions
            described |= {"min": flat.min(axis=0).tolist(), "max": flat.max(axis=0).tolist()}
        return self.add("accessors", described)

    def floats(self, values: Float64) -> int:
        return self.accessor(values.astype(np.float32), _FLOAT)

    def bytes(self) -> bytes:
        document = {
            "asset": {"version": "2.0"},
            "extensionsUsed": ["KHR_materials_unlit", "KHR_lights_punctual"],
            "extensions": {"KHR_lights_punctual": {"lights": _LIGHTS}},
            "buffers": [{"byteLength": len(self.binary)}],
            "scene": 0,
            **self.document,
        }
        text = json.dumps(document).encode()
        text += b" " * (-len(text) % 4)
        self.binary += b"\0" * (-len(self.binary) % 4)
        chunks = struct.pack("<II", len(text), 0x4E4F534A) + text
        chunks += struct.pack("<II", len(self.binary), 0x004E4942) + self.binary
        return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def write_glb(
    path: Path, surfaces: Sequence[TexturedMesh], yfov: float, joints: Sequence[Joint] = ()
) -> None:
    """Write surfaces, a camera at the origin that looks along -z, and two lights.

    Args:
        path: the file.
        surfaces: what is seen.
        yfov: vertical field of view [rad].
        joints: the skeleton that carries them, none if nothing is carried.
    """
    file = _Glb()
    file.add("cameras", {"type": "perspective", "perspective": {"yfov": yfov, "znear": 0.01}})
    roots = [file.add("nodes", {"camera": 0})]
    for number, turn in enumerate(_SHINE):
        light = {"KHR_lights_punctual": {"light": number}}
        roots.append(file.add("nodes", {"rotation": _unit(turn), "extensions": light}))
    skin: dict[str, int] = {}
    if joints:
        roots.append(_add_skeleton(file, joints))
        skin = {"skin": 0}
    for surface in surfaces:
        roots.append(file.add("nodes", {"mesh": _add_mesh(file, surface), **skin}))
    file.add("scenes", {"nodes": roots})
    path.write_bytes(file.bytes())


def _unit(quaternion: Sequence[float]) -> list[float]:
    values = np.asarray(quaternion, np.float64)
    return [float(value) for value in values / np.linalg.norm(values)]


def _add_skeleton(file: _Glb, joints: Sequence[Joint]) -> int:
    """The joints' nodes and the skin; the root's node."""
    first = len(file.document["nodes"])
    bind = np.tile(np.eye(4), (len(joints), 1, 1))
    for number, joint in enumerate(joints):
        away = np.zeros(3) if joint.parent is None else joints[joint.parent].at
        children = [first + at for at, other in enumerate(joints) if other.parent == number]
        node: dict[str, object] = {
            "translation": (joint.at - away).tolist(),
            "rotation": _unit(joint.turn),
        }
        file.add("nodes", node | ({"children": children} if children else {}))
        bind[number, :3, 3] = -joint.at
    columns = np.swapaxes(bind, 1, 2).reshape(-1, 16)
    nodes = list(range(first, first + len(joints)))
    file.add("skins", {"joints": nodes, "inverseBindMatrices": file.floats(columns)})
    return first


def _add_mesh(file: _Glb, surface: TexturedMesh) -> int:
    ok, png = cv2.imencode(".png", surface.texture[..., ::-1])
    if not ok:
        raise RuntimeError("OpenCV does not write PNG")
    image = file.add("images", {"bufferView": file.view(png.tobytes()), "mimeType": "image/png"})
    sampler = file.add("samplers", {"magFilter": _LINEAR, "minFilter": _MIPMAPS})
    texture = file.add("textures", {"source": image, "sampler": sampler})
    material: dict[str, object] = {
        "doubleSided": True,
        "pbrMetallicRoughness": {
            "baseColorTexture": {"index": texture},
            "metallicFactor": 0.0,
            "roughnessFactor": 0.8,
        },
    }
    attributes = {"POSITION": file.floats(surface.points), "TEXCOORD_0": file.floats(surface.uv)}
    if surface.normals is None:
        material["extensions"] = {"KHR_materials_unlit": {}}
    else:
        attributes["NORMAL"] = file.floats(surface.normals)
    if surface.joint is not None:
        carried = np.zeros((len(surface.joint), 4), np.uint8)
        carried[:, 0] = surface.joint
        attributes["JOINTS_0"] = file.accessor(carried, _UINT8)
        attributes["WEIGHTS_0"] = file.floats(np.tile([1.0, 0, 0, 0], (len(carried), 1)))
    primitive = {
        "attributes": attributes,
        "indices": file.accessor(surface.faces.astype(np.uint32).ravel(), _UINT32),
        "material": file.add("materials", material),
    }
    return file.add("meshes", {"primitives": [primitive]})
