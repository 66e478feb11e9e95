"""The GLB of a drawn clip: a box where the object stands, and the camera."""

from __future__ import annotations

import math

import numpy as np

from nlens_video.evaluate.bench.glb_writer import GlbWriter

_FACES = [(0, 1, 3), (0, 3, 2), (4, 6, 7), (4, 7, 5), (0, 4, 5), (0, 5, 1),
          (2, 3, 7), (2, 7, 6), (0, 2, 6), (0, 6, 4), (1, 5, 7), (1, 7, 3)]  # fmt: skip


def add_box(writer: GlbWriter, foot: tuple[float, float], size: tuple[float, float, float]) -> None:
    """Add a box that stands on the ground, y = 0.

    Args:
        writer: of the file.
        foot: of its middle, to the right and away from the camera's first place [m].
        size: width, height and depth [m].
    """
    (x, z), (width, height, depth) = foot, size
    corners = [(x + a * width / 2, b * height, -z + c * depth / 2)
               for a in (-1, 1) for b in (0, 1) for c in (-1, 1)]  # fmt: skip
    mesh = writer.add("meshes", {"primitives": [{
        "attributes": {"POSITION": writer.accessor(np.array(corners, np.float32))},
        "indices": writer.accessor(np.array(_FACES, np.uint32).ravel()),
    }]})  # fmt: skip
    writer.node(mesh=mesh)


def add_lens(writer: GlbWriter, focal_px: float, rows: int) -> int:
    """Add a camera without a place; its number in the file.

    Args:
        writer: of the file.
        focal_px: focal length [px].
        rows: of the frame [px].
    """
    lens = {"yfov": 2 * math.atan(rows / 2 / focal_px), "znear": 0.1}
    return writer.add("cameras", {"type": "perspective", "perspective": lens})
