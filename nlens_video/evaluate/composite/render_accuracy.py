"""Mask and depth of the software rasteriser against a path tracer's layer."""

from __future__ import annotations

import numpy as np

from nlens_video.core.layers import Box
from nlens_video.evaluate.plates import Plate
from nlens_video.evaluate.tables import Column, Entry, Table
from nlens_video.scene.scene import Scene

ROW = "software rasteriser"
_HALF = 0.5  # coverage from which a pixel belongs to a mask [1]


def render_accuracy_table() -> Table:
    """An empty table of rendered objects."""
    return Table(
        name="drawn",
        title="Mask and depth of the rendered object, against its layer",
        columns=(
            Column("iou", "mask, IoU", 4),
            Column("depth_error", "depth, mean error [%]", 4),
            Column("depth_error_99", "99 % below [%]", 4),
            Column("iou", "plates", 0, "count"),
        ),
        detail="iou",
        notes=(
            f"Masks are the pixels covered by {_HALF:g} or more; errors of depth are shares of it, "
            "over the pixels that the object covers wholly in both.",
        ),
    )


def measure_render(scene: Scene, known: Plate, alpha: np.ndarray) -> Entry:
    """Render a plate's object and compare it with its ground-truth layer.

    Args:
        scene: the object.
        known: the plate.
        alpha: of the layer (H, W) [1].
    """
    from nlens_video.render.software.renderer import SoftwareObjectRenderer

    height, width = alpha.shape
    mine, depth = np.zeros((height, width), np.float32), np.full((height, width), np.inf)
    with SoftwareObjectRenderer(scene) as renderer:
        layer = renderer.render(0.0, known.camera)
    if layer is not None:
        frame = Box(0, 0, width, height)
        common = layer.box.intersection(frame)
        inside = common.slices_in(layer.box)
        mine[common.slices_in(frame)] = layer.rgba[inside][..., 3]
        depth[common.slices_in(frame)] = layer.depth[inside]
    one, other = mine >= _HALF, alpha >= _HALF
    both = known.solid & (mine >= 1.0 - 1e-4) & np.isfinite(depth)
    error = 100.0 * np.abs(depth[both] / known.object_depth[both] - 1.0)
    figures = {
        "iou": float((one & other).sum()) / max(1, int((one | other).sum())),
        "depth_error": float(error.mean()) if error.size else np.nan,
        "depth_error_99": float(np.percentile(error, 99)) if error.size else np.nan,
    }
    return Entry(ROW, known.name, figures)
