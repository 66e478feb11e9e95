"""Textured cards before a sampled lens."""

import numpy as np
from support.glb_builder import QUAD, QUAD_FACES, QUAD_UV

from nlens_video.core.layers import Box
from nlens_video.kernels.scatter.scatter import blur_reach, scatter
from nlens_video.scene import Camera
from nlens_video.stages.l_reblur import ReblurLayer

WIDTH, HEIGHT, FOCAL = 160, 120, 150.0


FRAME = Box(0, 0, WIDTH, HEIGHT)


BLUR = ReblurLayer(scatter=scatter, reach=blur_reach)


def camera(aspect=1.0):
    return Camera(
        world_from_camera=np.eye(4), fx=FOCAL / aspect, fy=FOCAL, cx=WIDTH / 2, cy=HEIGHT / 2,
        width=WIDTH, height=HEIGHT,
    )  # fmt: skip


def card(builder, depth, *, at=(0.0, 0.0), half=(0.3, 0.25), lean=0.0, seed=0):
    """A textured rectangle, `lean` deeper per unit to the right, at a place of the frame."""
    rng = np.random.default_rng(seed)
    tiles = np.kron(rng.integers(20, 236, (8, 8, 3)), np.ones((16, 16, 1)))
    info = {"index": builder.texture(tiles, magFilter=9729, minFilter=9987)}
    number = builder.add(
        "materials",
        {"pbrMetallicRoughness": {"baseColorTexture": info}, "extensions": UNLIT},
    )
    corners = QUAD * [half[0] * depth, half[1] * depth, 0.0] + [at[0] * depth, at[1] * depth, 0]
    corners[:, 2] -= depth + lean * (corners[:, 0] - at[0] * depth)
    mesh = builder.mesh(corners.astype(np.float32), QUAD_FACES, material=number,
                        TEXCOORD_0=QUAD_UV)  # fmt: skip
    builder.node(mesh=mesh)


UNLIT = {"KHR_materials_unlit": {}}


NEAR_OVER_FAR = ((1.4, {"half": (0.08, 0.3), "at": (0.02, 0.0)}), (4.0, {"half": (0.3, 0.2)}))
