"""Sources of the object's layers: rendered from the GLB, or pre-rendered OpenEXR files."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from msgspec.structs import replace

from nlens_video.core.errors import InputError
from nlens_video.core.layers import Box, Float64, ObjectLayer
from nlens_video.core.lens_fit import LensFit
from nlens_video.core.optics import Shutter
from nlens_video.core.settings import ObjectSettings
from nlens_video.effects.motion_blur import NEGLIGIBLE_SPAN_PX
from nlens_video.graph.base.view import ScreenBounds, View, bounds_near_frame
from nlens_video.kernels.channels import any_channel
from nlens_video.kernels.scatter.furthest import furthest_reach
from nlens_video.scene.camera import Camera
from nlens_video.scene.scene import Scene
from nlens_video.scene.scene_light import SceneLight
from nlens_video.scene.screen_projection import places, travel_bound_px

if TYPE_CHECKING:
    from nlens_video.render.base.box_renderer import BoxRenderer
    from nlens_video.video.exr import LayerReader

_TRACE = 2.0**-24  # alpha below the precision of any plate
_MOMENT_S = 1e-6  # in which nothing moves visibly that moves at all


@dataclass(frozen=True, slots=True, kw_only=True)
class ObjectSource(ABC):
    """Bounds, geometry and rendering of the object on each frame.

    Attributes:
        scene: the GLB, which gives camera, ground and footprint.
        view: the frame that sees it.
        footprint_node: name of the node whose footprint finds the lens, None for all objects.
    """

    scene: Scene
    view: View
    footprint_node: str | None = None

    @property
    @abstractmethod
    def description(self) -> str:
        """The source in one phrase."""

    @property
    def notes(self) -> tuple[str, ...]:
        """Notes for the user."""
        return ()

    def opened(self) -> AbstractContextManager[object]:
        """What the render lane's thread holds open."""
        return nullcontext()

    @abstractmethod
    def locate(self, index: int, time_s: float) -> ScreenBounds | None:
        """Bounds on a frame; None where they miss it and all that can blur into it."""

    @abstractmethod
    def render(
        self, bounds: ScreenBounds, fit: LensFit | None, beyond_px: int = 0
    ) -> ObjectLayer | None:
        """The sharp layer, as far beyond the frame as its blur reaches back into it.

        Args:
            bounds: of the object on this frame.
            fit: the lens, None where it is not known.
            beyond_px: how much farther, where the object comes in while the shutter is open [px].
        """

    def render_part(self, bounds: ScreenBounds, box: Box) -> ObjectLayer | None:
        """The sharp layer of a box that may lie beyond the frame; None where nothing is known."""
        return None

    def camera(self, time_s: float) -> Camera:
        """The camera at a moment of the plate [s]."""
        return self.view.camera_at(self.scene, time_s)

    def footprint(self, time_s: float) -> Float64:
        """World-space triangles (T, 3, 3) of what stands on the ground [scene unit]."""
        return self.scene.triangles(time_s, self.footprint_node)

    def places(self, time_s: float, most: int | None = None) -> Float64 | None:
        """Columns, rows [px] and depths [scene unit] (V, 3) of the vertices; None if unknown.

        NaN for vertices behind the camera, and for those that are not drawn.

        Args:
            time_s: moment of the plate [s].
            most: of more vertices, only every second or third and so on; default: of all.
        """
        return None

    def shutter_at(self, shutter: Shutter, time_s: float) -> Shutter:
        """The plate's shutter on a frame; shorter where the object leaves its place at once.

        Where a loop begins anew or a key changes a value at once, nothing crosses the space
        between, and no mean over both sides is a blur.

        Args:
            shutter: of the plate.
            time_s: moment of the frame [s].
        """
        return shutter

    def travel_bound_px(self, moments: Sequence[float]) -> float:
        """Upper bound of any vertex's path on the screen over the moments; inf if unknown [px]."""
        return math.inf


@dataclass(frozen=True, slots=True, kw_only=True)
class RenderedObject(ObjectSource):
    """The objects of a GLB, drawn by a renderer."""

    renderer: BoxRenderer

    @property
    def description(self) -> str:
        """The renderer in one phrase."""
        return self.renderer.description

    @property
    def notes(self) -> tuple[str, ...]:
        """Light sources, and events such as a lost OpenGL context."""
        return (self.renderer.light_note, *self.renderer.notes)

    def opened(self) -> AbstractContextManager[object]:
        """The renderer, which owns an OpenGL context."""
        return self.renderer

    def locate(self, index: int, time_s: float) -> ScreenBounds | None:
        """Bounds on a frame; None where they miss it and all that can blur into it."""
        return bounds_near_frame(self.scene, self.view, time_s)

    def places(self, time_s: float, most: int | None = None) -> Float64:
        """As of `ObjectSource`."""
        points, drawn = self.scene.pose(time_s).points()
        every = 1 if most is None else math.ceil(len(points) / most)
        seen = places(points[::every], self.camera(time_s))
        seen[~drawn[::every]] = np.nan
        return seen

    def shutter_at(self, shutter: Shutter, time_s: float) -> Shutter:
        """As of `ObjectSource`."""
        start_s, _, end_s = shutter.edges(time_s)
        away = [abs(one - time_s) for one in self.scene.jumps(start_s, end_s) if self._jumps(one)]
        return shutter.shortened(2.0 * max(0.0, min(away) - _MOMENT_S)) if away else shutter

    def _jumps(self, time_s: float) -> bool:
        """Whether vertices are elsewhere, or there, right after a moment and not right before."""
        before, after = (self.places(time_s + side * _MOMENT_S) for side in (-1.0, 1.0))
        if (np.isnan(before) != np.isnan(after)).any():
            return True
        ways = np.abs(after[:, :2] - before[:, :2])
        return float(np.nanmax(ways, initial=0.0)) >= NEGLIGIBLE_SPAN_PX

    def travel_bound_px(self, moments: Sequence[float]) -> float:
        """As of `ObjectSource`, without moving a vertex."""
        if self.scene.morphs:
            return math.inf
        return travel_bound_px(
            [self.scene.hull(moment) for moment in moments],
            [self.camera(moment) for moment in moments],
        )

    def render(
        self, bounds: ScreenBounds, fit: LensFit | None, beyond_px: int = 0
    ) -> ObjectLayer | None:
        """Render with a margin for what the lens spreads into the frame from outside."""
        margin = self.view.overscan_px + beyond_px
        if fit is not None:
            ends = np.array([1 / bounds.nearest, 1 / bounds.farthest], np.float32)
            aspect = self.view.pixel_aspect
            reach = 0.5 * float(np.abs(fit.coc_px(ends)).max()) * max(1.0, aspect)
            margin += math.ceil(min(reach, furthest_reach(aspect))) + 1
        return self.renderer.render(
            bounds.time_s, bounds.camera, margin, plate_light=bounds.plate_light
        )

    def render_part(self, bounds: ScreenBounds, box: Box) -> ObjectLayer | None:
        """As of `ObjectSource`."""
        camera = bounds.camera.cropped(box)
        layer = self.renderer.render(bounds.time_s, camera, plate_light=bounds.plate_light)
        return layer and replace(layer, box=layer.box.translated(box.x0, box.y0))


@dataclass(frozen=True, slots=True, kw_only=True)
class PrerenderedObject(ObjectSource):
    """Layers that were rendered elsewhere."""

    layers: LayerReader

    @property
    def description(self) -> str:
        """The source in one phrase."""
        return "pre-rendered OpenEXR layers"

    @property
    def notes(self) -> tuple[str, ...]:
        """What is odd about the layers."""
        return self.layers.notes

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

    def render(
        self, bounds: ScreenBounds, fit: LensFit | None, beyond_px: int = 0
    ) -> ObjectLayer | None:
        """The layer that was read."""
        return bounds.layer


def covered_part(layer: ObjectLayer) -> ObjectLayer | None:
    """The layer cut to the pixels that have alpha or colour; None when there are none.

    Light without alpha, such as a flame's, gets a trace of it: it belongs to the object, with a
    depth, a CoC and an outline of its own.
    """
    covered = any_channel(layer.rgba)
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


def open_object(
    objects: ObjectSettings, scene: Scene, view: View, light: SceneLight
) -> ObjectSource:
    """Open the source of the object's layers.

    Args:
        objects: the object.
        scene: the GLB.
        view: the frame that sees it.
        light: lights of the file and the environment map.

    Raises:
        SceneError: there is no node of the footprint's name.
        InputError: the layers cannot be read.
    """
    node = objects.footprint
    if node is not None:
        scene.triangles(0.0, node)  # reports a wrong name before the run
    if objects.layers is not None:
        from nlens_video.video.exr import LayerReader

        layers = LayerReader(objects.layers, (view.width, view.height))
        return PrerenderedObject(scene=scene, view=view, footprint_node=node, layers=layers)
    from nlens_video.render.select import choose_renderer

    renderer = choose_renderer(scene, light)
    return RenderedObject(scene=scene, view=view, footprint_node=node, renderer=renderer)
