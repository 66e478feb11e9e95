"""A GLB file that uses everything the scene reader supports."""

import numpy as np
from support.glb_builder import QUAD, QUAD_UV, GlbBuilder

NORMALS = np.tile(np.array([[0, 0, 1]], np.float32), (4, 1))


def rich():
    """A small file with all that the reader knows."""
    builder = GlbBuilder()
    texture = builder.texture(np.full((2, 2, 3), 200, np.uint8))
    info = {"index": texture, "extensions": {"KHR_texture_transform": {"scale": [2, 2]}}}
    material = {"pbrMetallicRoughness": {"baseColorTexture": info}, "alphaMode": "BLEND"}
    sparse = {
        "count": 1,
        "indices": {"bufferView": builder.view(bytes([1])), "componentType": 5121},
        "values": {"bufferView": builder.view(np.ones(3, np.float32).tobytes())},
    }
    moved = builder.add(
        "accessors", {"componentType": 5126, "count": 4, "type": "VEC3", "sparse": sparse}
    )
    joints = np.zeros((4, 4), np.uint8)
    weights = np.tile(np.array([[255, 0, 0, 0]], np.uint8), (4, 1))
    mesh = builder.mesh(
        material=builder.add("materials", material),
        targets=[{"POSITION": QUAD}],
        NORMAL=NORMALS,
        TEXCOORD_0=QUAD_UV,
        COLOR_0=builder.accessor(np.full((4, 4), 128, np.uint8), normalized=True),
        JOINTS_0=builder.accessor(joints),
        WEIGHTS_0=builder.accessor(weights, normalized=True),
    )
    builder.document["meshes"][0]["primitives"][0]["targets"].append({"POSITION": moved})
    joint = builder.node()
    node = builder.node(mesh=mesh, skin=builder.skin([joint], np.eye(4)[None]))
    builder.node(camera=builder.camera())
    builder.light("spot", node={"translation": [0, 2, 0]})
    builder.animation(
        (joint, "rotation", [0, 1], [[0, 0, 0, 1], [0, 1, 0, 0]], "LINEAR"),
        (node, "weights", [0, 1], [[0, 0], [1, 1]], "STEP"),
    )
    return builder
