"""Draco meshes: the same triangles as without compression, and damaged data."""

import importlib.util

import DracoPy
import numpy as np
import pytest
from support.glb_builder import GlbBuilder

from nlens_video.core.errors import SceneError
from nlens_video.scene import Scene
from nlens_video.scene.gltf.accessors import DRACO

POSITIONS = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 2]], np.float32)
FACES = np.array([[0, 1, 2], [0, 2, 3]], np.uint32)
NORMALS = np.tile([[0.0, 0.0, 1.0]], (4, 1))


def compressed(*, damage=None, **primitive):
    """A GLB of two meshes, each in Draco; `damage` changes the first one's bytes."""
    builder = GlbBuilder()
    builder.document["extensionsRequired"] = [DRACO]
    for number in range(2):
        data = bytearray(
            DracoPy.encode(
                POSITIONS + number, FACES, quantization_bits=14, normals=NORMALS,
                preserve_order=True,
            )
        )  # fmt: skip
        if damage is not None and number == 0:
            data = damage(data)
        found = {a["attribute_type"]: a["unique_id"] for a in meant(number)}
        accessors = [
            builder.add("accessors", {"componentType": code, "count": count, "type": kind})
            for code, count, kind in ((5123, 6, "SCALAR"), (5126, 4, "VEC3"), (5126, 4, "VEC3"))
        ]
        held = {
            "bufferView": builder.view(bytes(data)),
            "attributes": {"POSITION": found[0], "NORMAL": found[1]},
        }
        item = {
            "indices": accessors[0],
            "attributes": {"POSITION": accessors[1], "NORMAL": accessors[2]},
            "extensions": {DRACO: held},
            **primitive,
        }
        builder.node(mesh=builder.add("meshes", {"primitives": [item]}))
    return builder


def meant(number):
    data = DracoPy.encode(POSITIONS + number, FACES, normals=NORMALS, preserve_order=True)
    return DracoPy.decode(data).attributes


def load(builder, tmp_path):
    return Scene.load(builder.write(tmp_path / "scene.glb"))


def test_draco_compressed_mesh_decodes_to_its_triangles(tmp_path):
    triangles = load(compressed(), tmp_path).triangles(0.0)
    expected = np.concatenate([POSITIONS[FACES], POSITIONS[FACES] + 1])
    np.testing.assert_allclose(triangles, expected, atol=3e-4)


@pytest.mark.parametrize(
    "damage",
    [
        lambda data: data[: len(data) // 2],
        lambda data: bytearray(b"\xff" * len(data)),
        lambda data: bytearray(8),
        lambda data: data[:11] + b"\xff" * 8 + data[19:],
    ],
)
def test_damaged_draco_data_is_refused_in_one_line(tmp_path, damage):
    with pytest.raises(SceneError, match=r"Draco meshes are broken|accessors|indices|holds no"):
        load(compressed(damage=damage), tmp_path)


def test_missing_draco_decoder_error_states_how_to_install_it(tmp_path, monkeypatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(SceneError, match=r"pip install nlens-video\[draco\]; or decode it first"):
        load(compressed(), tmp_path)


def test_draco_triangle_strip_is_refused(tmp_path):
    with pytest.raises(SceneError, match=r"mode is 5, expected triangles"):
        load(compressed(mode=5), tmp_path)
