"""Write the objects' files: buffers, keys, camera and lights of one GLB (numpy and pygltflib)."""

from __future__ import annotations

import io
import math
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pygltflib as gl
from PIL import Image
from shot_list import HEIGHT, WIDTH, Shot

Floats = npt.NDArray[np.float64]
_KINDS = {1: "SCALAR", 2: "VEC2", 3: "VEC3", 4: "VEC4", 16: "MAT4"}


class Glb:
    """A glTF file in the making, its binary chunk beside it."""

    def __init__(self) -> None:
        self.gltf = gl.GLTF2(
            asset=gl.Asset(version="2.0", generator="nlens-video samples"),
            scenes=[gl.Scene(nodes=[])],
            scene=0,
            animations=[gl.Animation(name="clip", samplers=[], channels=[])],
        )
        self._blob = bytearray()
        self._times: dict[bytes, int] = {}

    def view(self, data: bytes, target: int | None = None) -> int:
        """Append bytes; returns the index of their buffer view."""
        self._blob += b"\0" * (-len(self._blob) % 4)
        self.gltf.bufferViews.append(
            gl.BufferView(buffer=0, byteOffset=len(self._blob), byteLength=len(data), target=target)
        )
        self._blob += data
        return len(self.gltf.bufferViews) - 1

    def accessor(
        self,
        values: npt.ArrayLike,
        component: int = gl.FLOAT,
        *,
        target: int | None = None,
        bounds: bool = False,
    ) -> int:
        """Append an array (N,) or (N, C); returns the index of its accessor."""
        kinds = {gl.FLOAT: np.float32, gl.UNSIGNED_SHORT: np.uint16, gl.UNSIGNED_BYTE: np.uint8}
        array = np.ascontiguousarray(values, kinds[component])
        columns = array.reshape(len(array), -1)
        made = gl.Accessor(
            bufferView=self.view(array.tobytes(), target),
            componentType=component,
            count=len(array),
            type=_KINDS[columns.shape[1]],
        )
        if bounds:
            made.min, made.max = columns.min(axis=0).tolist(), columns.max(axis=0).tolist()
        self.gltf.accessors.append(made)
        return len(self.gltf.accessors) - 1

    def node(self, name: str, parent: int | None = None, **fields: Any) -> int:  # noqa: ANN401  as glTF's nodes have
        """Add a node under `parent`, or at the root; returns its index."""
        self.gltf.nodes.append(gl.Node(name=name, children=[], **fields))
        index = len(self.gltf.nodes) - 1
        siblings = self.gltf.scenes[0].nodes if parent is None else self.gltf.nodes[parent].children
        siblings.append(index)
        return index

    def animate(self, node: int, path: str, times: Floats, values: Floats) -> None:
        """Add linear keys; clips that share `times` share its accessor."""
        key = np.asarray(times, np.float32).tobytes()
        if key not in self._times:
            self._times[key] = self.accessor(times, bounds=True)
        clip = self.gltf.animations[0]
        flat = values.ravel() if path == "weights" else values
        clip.samplers.append(
            gl.AnimationSampler(
                input=self._times[key], output=self.accessor(flat), interpolation="LINEAR"
            )
        )
        clip.channels.append(
            gl.AnimationChannel(
                sampler=len(clip.samplers) - 1,
                target=gl.AnimationChannelTarget(node=node, path=path),
            )
        )

    def primitive(
        self,
        positions: Floats,
        normals: Floats,
        uv: Floats,
        triangles: npt.NDArray[np.int64],
        material: int,
    ) -> gl.Primitive:
        """Indexed triangles; (V, 3), (V, 3), (V, 2), (T, 3)."""
        attributes = gl.Attributes(
            POSITION=self.accessor(positions, target=gl.ARRAY_BUFFER, bounds=True),
            NORMAL=self.accessor(normals, target=gl.ARRAY_BUFFER),
            TEXCOORD_0=self.accessor(uv, target=gl.ARRAY_BUFFER),
        )
        indices = self.accessor(
            triangles.ravel(), gl.UNSIGNED_SHORT, target=gl.ELEMENT_ARRAY_BUFFER
        )
        return gl.Primitive(attributes=attributes, indices=indices, material=material)

    def texture(self, srgb: npt.NDArray[np.uint8]) -> int:
        """Embed a picture (H, W, 3) as PNG; returns the index of its texture."""
        png = io.BytesIO()
        Image.fromarray(srgb).save(png, "PNG", optimize=True)
        self.gltf.images.append(
            gl.Image(bufferView=self.view(png.getvalue()), mimeType="image/png")
        )
        if not self.gltf.samplers:
            self.gltf.samplers.append(
                gl.Sampler(magFilter=gl.LINEAR, minFilter=gl.LINEAR_MIPMAP_LINEAR)
            )
        self.gltf.textures.append(gl.Texture(source=len(self.gltf.images) - 1, sampler=0))
        return len(self.gltf.textures) - 1

    def material(self, name: str, texture: int, roughness: float, *, matt: bool = False) -> int:
        """A dielectric that wears a texture, without gloss if `matt`; returns its index."""
        surface = gl.PbrMetallicRoughness(
            baseColorTexture=gl.TextureInfo(index=texture),
            metallicFactor=0.0,
            roughnessFactor=roughness,
        )
        extensions = {"KHR_materials_specular": {"specularFactor": 0.0}} if matt else {}
        if matt:
            self.gltf.extensionsUsed.append("KHR_materials_specular")
        self.gltf.materials.append(
            gl.Material(name=name, pbrMetallicRoughness=surface, extensions=extensions)
        )
        return len(self.gltf.materials) - 1

    def camera(self, shot: Shot, roll_deg: float = 0.0) -> None:
        """The plate's camera; roll is positive where the world's up leans right."""
        view = gl.Perspective(yfov=shot.yfov, aspectRatio=WIDTH / HEIGHT, znear=0.05, zfar=100.0)
        self.gltf.cameras.append(gl.Camera(name="camera", type="perspective", perspective=view))
        tilt, turn = -0.5 * math.radians(shot.pitch_deg), 0.5 * math.radians(roll_deg)
        sine, cosine = math.sin(tilt), math.cos(tilt)
        self.node(
            "camera",
            camera=0,
            translation=[0.0, shot.height_m, 0.0],
            rotation=[
                sine * math.cos(turn),
                -sine * math.sin(turn),
                cosine * math.sin(turn),
                cosine * math.cos(turn),
            ],
        )

    def lights(self, lights: list[dict[str, Any]]) -> None:
        """Directional lights: `name`, `towards` (glTF axes), `colour`, `intensity`."""
        punctual = [
            {
                "name": light["name"],
                "type": "directional",
                "color": light["colour"],
                "intensity": light["intensity"],
            }
            for light in lights
        ]
        self.gltf.extensionsUsed.append("KHR_lights_punctual")
        self.gltf.extensions = {"KHR_lights_punctual": {"lights": punctual}}
        for index, light in enumerate(lights):
            towards = np.asarray(light["towards"], float)
            self.node(
                light["name"],
                rotation=z_axis_to(towards).tolist(),
                extensions={"KHR_lights_punctual": {"light": index}},
            )

    def save(self, path: Path) -> None:
        """Write the file."""
        self.gltf.buffers = [gl.Buffer(byteLength=len(self._blob))]
        for node in self.gltf.nodes:
            node.children = node.children or None
        self.gltf.set_binary_blob(bytes(self._blob))
        self.gltf.save_binary(str(path))


def z_axis_to(direction: Floats) -> Floats:
    """Quaternion (x, y, z, w) that turns +z to a direction (a light shines along its -z)."""
    d = direction / np.linalg.norm(direction)
    quaternion = np.array([-d[1], d[0], 0.0, 1.0 + d[2]])
    return np.asarray(quaternion / np.linalg.norm(quaternion))


def quaternions(matrices: Floats) -> Floats:
    """Quaternions (N, 4) of rotation matrices (N, 3, 3), neighbours on the same side."""
    from scipy.spatial.transform import Rotation

    values = Rotation.from_matrix(matrices).as_quat()
    for k in range(1, len(values)):
        if values[k] @ values[k - 1] < 0.0:
            values[k] *= -1.0
    return np.asarray(values)


def smooth_normals(positions: Floats, triangles: npt.NDArray[np.int64]) -> Floats:
    """Area-weighted vertex normals; vertices at the same place share theirs."""
    _, same = np.unique(np.round(positions, 7), axis=0, return_inverse=True)
    corner = positions[triangles]
    face = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    total = np.zeros((same.max() + 1, 3))
    for k in range(3):
        np.add.at(total, same.ravel()[triangles[:, k]], face)
    total /= np.linalg.norm(total, axis=1, keepdims=True)
    return np.asarray(total[same.ravel()])
