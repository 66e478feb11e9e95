"""Plates of a textured ground by a camera with a known path."""

from __future__ import annotations

import av
import cv2
import numpy as np
from support.camera_paths import SIZE, focal_of

WIDTH, HEIGHT = SIZE
FOV_DEG = 50.0


def view(texture, turn, eye):
    """A textured ground seen by a camera (H, W, 3)."""
    focal = focal_of(FOV_DEG)
    lens = np.array([[focal, 0.0, -WIDTH / 2], [0.0, -focal, -HEIGHT / 2], [0.0, 0.0, -1.0]])
    size = texture.shape[0]
    # texture pixels to the ground: 12 units wide, from 2 behind the camera to 10 before it
    ground = np.array([[12.0 / size, 0.0, -6.0], [0.0, 0.0, 0.0], [0.0, 12.0 / size, -10.0]])
    from_ground = lens @ turn.T @ (ground - np.outer(eye, (0.0, 0.0, 1.0)))
    rows, columns = np.mgrid[0:HEIGHT, 0:WIDTH] + 0.5
    back = np.linalg.inv(from_ground)
    at = np.tensordot(back, np.stack([columns, rows, np.ones_like(rows)]), axes=1)
    x, y = (at[:2] / at[2]).astype(np.float32)
    seen = cv2.remap(texture, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT)
    behind = (from_ground @ np.stack([x, y, np.ones_like(x)]).reshape(3, -1))[2] <= 0.0
    seen[behind.reshape(HEIGHT, WIDTH)] = 190
    return seen


def pictures(poses):
    """The ground as a camera at each pose sees it (H, W, 3)."""
    rng = np.random.default_rng(4)
    texture = cv2.resize(
        rng.integers(40, 220, (128, 128, 3), np.uint8), (2048, 2048), interpolation=cv2.INTER_CUBIC
    )
    for turn, eye in poses:
        yield np.ascontiguousarray(view(texture, turn, np.array(eye)))


def write_plate(path, poses):
    """A clip of a ground by a camera that moves; lossless."""
    return write_clip(path, pictures(poses))


def write_clip(path, shown):
    """A lossless clip of pictures (H, W, 3), sRGB."""
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264rgb", rate=24, options={"crf": "0"})
        stream.width, stream.height, stream.pix_fmt = WIDTH, HEIGHT, "rgb24"
        for picture in shown:
            container.mux(stream.encode(av.VideoFrame.from_ndarray(picture, "rgb24")))
        container.mux(stream.encode(None))
    return path
