"""Pre-rendered objects: OpenEXR layers, with camera, ground and footprint of their GLB."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from nlens_video.core.box import Box
from nlens_video.core.errors import InputError
from nlens_video.core.layers import Float64, ObjectLayer
from nlens_video.core.lens_fit import LensFit
from nlens_video.graph.base.object_source import ScreenBounds, View
from nlens_video.scene.camera import Camera
from nlens_video.scene.scene import Scene

_TRACE = 2.0**-24  # alpha below the precision of any plate


@dataclass(frozen=True, slots=True)
class PrerenderedObject:
    """Pre-rendered layers; the GLB still gives camera, ground and footprint."""

    scene: Scene
    layers: LayerReader
    view: View
    footprint_node: str | None = None

    @property
    def description(self) -> str:
        """What makes the layers, in words."""
        return "pre-rendered OpenEXR layers"

    def camera(self, time_s: float) -> Camera:
        """The camera at a moment of the plate [s]."""
        return self.view.camera_at(self.scene, time_s)

    def places(self, time_s: float) -> Float64 | None:
        """Unknown for pre-rendered layers."""
        return None

    def travel_bound_px(self, moments: Sequence[float]) -> float:
        """Unknown for pre-rendered layers."""
        return math.inf

    def locate(self, index: int, time_s: float) -> ScreenBounds | None:
        """Read the frame's layer, cut to what it covers."""
        layer = covered_part(self.layers.read(index))
        if layer is None:
            return None
        depth = layer.depth[np.isfinite(layer.depth)]
        if not depth.size:
            raise InputError(
                f"layer of frame {index}: alpha without depth anywhere; expected camera-space "
                "depth in channel Z"
            )
        return ScreenBounds(
            time_s=time_s,
            camera=self.camera(time_s),
            box=layer.box,
            nearest=float(depth.min()),
            farthest=float(depth.max()),
            layer=layer,
        )

    def footprint(self, time_s: float) -> Float64:
        """World-space triangles (T, 3, 3) of what stands on the ground [scene unit]."""
        return self.scene.triangles(time_s, self.footprint_node)

    def render(self, bounds: ScreenBounds, fit: LensFit | None) -> ObjectLayer | None:
        """The layer that was read."""
        return bounds.layer

    def warm_up(self) -> None:
        """Nothing is compiled."""


class LayerReader(Protocol):
    """Reads pre-rendered layers; see `video.exr`."""

    def read(self, index: int) -> ObjectLayer:
        """The layer of a frame, on the whole frame or part of it."""
        ...


def covered_part(layer: ObjectLayer) -> ObjectLayer | None:
    """The layer cut to the pixels that have alpha or colour; None when there are none.

    Light without alpha, such as a flame's, gets a trace of it: it belongs to the object, with a
    depth, a CoC and an outline of its own.
    """
    covered = (layer.rgba != 0).any(axis=2)
    rows, columns = np.flatnonzero(covered.any(axis=1)), np.flatnonzero(covered.any(axis=0))
    if not rows.size:
        return None
    y0, y1, x0, x1 = int(rows[0]), int(rows[-1]) + 1, int(columns[0]), int(columns[-1]) + 1
    rgba = layer.rgba[y0:y1, x0:x1].copy()
    rgba[covered[y0:y1, x0:x1] & (rgba[..., 3] == 0), 3] = _TRACE
    return ObjectLayer(
        box=Box(layer.box.x0 + x0, layer.box.y0 + y0, layer.box.x0 + x1, layer.box.y0 + y1),
        rgba=rgba,
        depth=layer.depth[y0:y1, x0:x1],
    )
