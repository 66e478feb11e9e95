"""The GLB files of `bench` and of the study: textured surfaces, two lights, a camera."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt
from msgspec import Struct

from nlens_video.core.layers import Float64, UInt8
from nlens_video.scene.gltf.writer import Fields, GlbWriter

_KEY, _FILL = (-0.3, 0.25, 0.0, 0.9), (0.35, -0.3, 0.0, 0.9)  # from above right, from below left


class TexturedMesh(Struct, frozen=True, kw_only=True):
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


class Joint(Struct, frozen=True, kw_only=True):
    """A joint: its place at rest (3,) [scene unit], its pose as a quaternion (x, y, z, w).

    The parent is the number of a joint before this one, None for the root.
    """

    at: Float64
    parent: int | None = None
    turn: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 1.0)


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
