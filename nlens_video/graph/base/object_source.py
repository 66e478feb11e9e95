"""Sources of the object's layers: rendered from the GLB here, read from files in `prerendered`."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from nlens_video.core.errors import Note, NoteKind, UsageError
from nlens_video.core.layers import Box, Float64, ObjectLayer
from nlens_video.core.lens_fit import LensFit
from nlens_video.core.placement import ASSUMED_FOCAL_MM, Placement, focal_of_fov
from nlens_video.core.settings import ObjectSettings
from nlens_video.scene.camera import Camera
from nlens_video.scene.extent import extent, misses, travel_bound_px
from nlens_video.scene.illumination import Illumination
from nlens_video.scene.placement_camera import contact_point, place_camera
from nlens_video.scene.posed import PosedScene
from nlens_video.scene.scene import Scene
from nlens_video.stages.protocols import BehindRenderer, ViewRenderer

MARGIN_LIMIT_PX = 256  # the most that is rendered beyond the frame: no kernel spreads farther
_NEAREST = 1e-3  # of the object's greatest depth: nearer than that is taken for behind the camera


@dataclass(frozen=True, slots=True, kw_only=True)
class View:
    """How the frame's pixels see the scene.

    Attributes:
        width: columns [px].
        height: rows [px].
        pixel_aspect: width of a pixel by its height [1].
        camera: name of the camera in the file, None for the first perspective one.
        focal_35mm: 35 mm equivalent focal length of the plate, None where it is unknown [mm].
        placed: a camera that stands in for those of the file, None where there is none.
        overscan_px: how far beyond the frame the object is rendered, without its blur [px].
    """

    width: int
    height: int
    pixel_aspect: float = 1.0
    camera: str | None = None
    focal_35mm: float | None = None
    placed: Camera | None = None
    overscan_px: int = 0

    @property
    def box(self) -> Box:
        """The whole frame."""
        return Box(0, 0, self.width, self.height)

    def camera_at(self, scene: Scene, time_s: float) -> Camera:
        """What sees a scene at a moment of the plate [s]."""
        if self.placed is not None:
            return self.placed
        return scene.camera(
            time_s, self.width, self.height, name=self.camera, pixel_aspect=self.pixel_aspect
        )


@dataclass(frozen=True, slots=True, kw_only=True)
class ScreenBounds:
    """Camera, screen bounds and depth range of the object at one moment.

    Attributes:
        time_s: moment of the animation [s].
        camera: that moment's camera.
        box: the object's bounds on the frame's pixel grid; may reach beyond the frame.
        nearest: least depth of the object in front of the camera [scene unit].
        farthest: greatest depth [scene unit].
        layer: the object's layer, where it was read rather than rendered.
        plate_light: lighting estimated from the plate, None for a default light.
    """

    time_s: float
    camera: Camera
    box: Box
    nearest: float
    farthest: float
    layer: ObjectLayer | None = None
    plate_light: Illumination | None = None


def place_object(
    view: View, scene: Scene, placing: Placement, focal: float, ground_y: float | None
) -> View:
    """A view whose camera sees the object, as it is at first, where it is to stand.

    Args:
        view: the frame.
        scene: the object.
        placing: where it is to stand.
        focal: 35 mm equivalent focal length [mm].
        ground_y: height of the ground plane, None for the object's lowest point [scene unit].

    Raises:
        SceneError: no camera sees it so.
    """
    vertices = scene.pose(0.0).vertices()
    camera = place_camera(
        vertices,
        contact_point(vertices, ground_y),
        placing,
        focal,
        (view.width, view.height),
        view.pixel_aspect,
    )
    return replace(view, placed=camera)


def choose_camera(
    objects: ObjectSettings, scene: Scene, view: View
) -> tuple[View, tuple[str, ...]]:
    """The camera that sees the object: the file's, or one that sees it where it is placed.

    Args:
        objects: the object, and where it is to stand.
        scene: its file.
        view: the frame.

    Returns:
        The view with that camera, and a note on it.

    Raises:
        SceneError: no camera sees it so, or the file has none.
        UsageError: layers were rendered through another camera.
    """
    if objects.placing is None:
        scene.camera(0.0, view.width, view.height, name=view.camera, pixel_aspect=view.pixel_aspect)
        return view, ()
    if objects.layers is not None:
        raise UsageError("--layers were rendered through the GLB's own camera; leave --at out")
    focal = view.focal_35mm or ASSUMED_FOCAL_MM
    known = "as the plate says" if view.focal_35mm else "assumed"
    if objects.fov_deg is not None:
        focal = focal_of_fov(objects.fov_deg, (view.width, view.height), view.pixel_aspect)
        known = f"by --fov {objects.fov_deg:g}"
    unused = "; the file's own camera is not used" if scene.camera_names else ""
    return place_object(view, scene, objects.placing, focal, objects.ground_y), (
        Note(
            f"placed by {objects.placing.describe()}, focal length {focal:.4g} mm "
            f"(35 mm equivalent, {known}){unused}",
            NoteKind.CAMERA if unused else NoteKind.OTHER,
        ),
    )


class ObjectSource(Protocol):
    """Bounds, geometry and rendering of the object on each frame."""

    @property
    def description(self) -> str:
        """The source in one phrase."""
        ...

    def locate(self, index: int, time_s: float) -> ScreenBounds | None:
        """Where the object is on a frame; None when it is out of view."""
        ...

    def camera(self, time_s: float) -> Camera:
        """The camera at a moment of the plate [s]."""
        ...

    def places(self, time_s: float) -> Float64 | None:
        """Its vertices: columns, rows [px], depths [scene unit] (V, 3); None if one lies behind."""
        ...

    def travel_bound_px(self, moments: Sequence[float]) -> float:
        """What no vertex moves more than on the screen from moment to moment, summed up [px]."""
        ...

    def footprint(self, time_s: float) -> Float64:
        """World-space triangles (T, 3, 3) of what stands on the ground [scene unit]."""
        ...

    def render(self, bounds: ScreenBounds, fit: LensFit | None) -> ObjectLayer | None:
        """The sharp layer, as far beyond the frame as its blur reaches back into it."""
        ...

    def warm_up(self) -> None:
        """Compile what rendering needs, if anything."""
        ...


class Renderer(BehindRenderer, ViewRenderer, Protocol):
    """Draws a scene; see `render.base.box_renderer`."""

    @property
    def description(self) -> str:
        """What draws, in words."""
        ...

    def warm_up(self) -> None:
        """Compile what drawing needs, if anything."""
        ...


@dataclass(frozen=True, slots=True)
class RenderedObject:
    """The objects of a GLB, drawn by a renderer."""

    scene: Scene
    renderer: Renderer
    view: View
    footprint_node: str | None = None  # the node whose footprint finds the lens; None: all objects

    @property
    def description(self) -> str:
        """The source in one phrase."""
        return self.renderer.description

    def camera(self, time_s: float) -> Camera:
        """The camera at a moment of the plate [s]."""
        return self.view.camera_at(self.scene, time_s)

    def places(self, time_s: float) -> Float64 | None:
        """Its vertices: columns, rows [px], depths [scene unit] (V, 3); None if one lies behind."""
        camera = self.camera(time_s)
        seen = camera.to_camera(self.scene.pose(time_s).vertices().astype(np.float64))
        if not (seen[:, 2] < 0.0).all():
            return None
        return np.column_stack([camera.pixels(seen), -seen[:, 2]])

    def travel_bound_px(self, moments: Sequence[float]) -> float:
        """What no vertex moves more than on the screen from moment to moment, summed up [px].

        Found without moving a vertex; infinite where that does not tell.
        """
        if self.scene.morphs:
            return math.inf
        return travel_bound_px(
            [self.scene.hull(moment) for moment in moments],
            [self.camera(moment) for moment in moments],
        )

    def locate(self, index: int, time_s: float) -> ScreenBounds | None:
        """Bounds on the screen; None when they miss the frame and all that can blur into it."""
        return bounds_near_frame(self.scene, self.view, time_s)

    def footprint(self, time_s: float) -> Float64:
        """World-space triangles (T, 3, 3) of what stands on the ground [scene unit]."""
        return self.scene.triangles(time_s, self.footprint_node)

    def render(self, bounds: ScreenBounds, fit: LensFit | None) -> ObjectLayer | None:
        """Render with a margin for what the lens spreads into the frame from outside."""
        margin = self.view.overscan_px
        if fit is not None:
            ends = np.array([1 / bounds.nearest, 1 / bounds.farthest], np.float32)
            reach = 0.5 * float(np.abs(fit.coc_px(ends)).max()) * max(1.0, self.view.pixel_aspect)
            margin += math.ceil(min(reach, MARGIN_LIMIT_PX)) + 1
        return self.renderer.render(
            bounds.time_s, bounds.camera, margin, plate_light=bounds.plate_light
        )

    def warm_up(self) -> None:
        """Compile what rendering needs, if anything."""
        self.renderer.warm_up()


def bounds_near_frame(scene: Scene, view: View, time_s: float) -> ScreenBounds | None:
    """Where an object is at a moment [s]; None when it misses the frame and all that blurs in."""
    camera = view.camera_at(scene, time_s)
    surroundings = view.box.expanded(MARGIN_LIMIT_PX)
    if misses(scene.hull(time_s), camera, surroundings):
        return None  # without moving a vertex
    bounds = _bounds(scene.pose(time_s), camera)
    if bounds is None:
        return None
    box, nearest, farthest = bounds
    if box.intersection(surroundings).empty:
        return None
    return ScreenBounds(time_s=time_s, camera=camera, box=box, nearest=nearest, farthest=farthest)


def _bounds(posed: PosedScene, camera: Camera) -> tuple[Box, float, float] | None:
    """Screen bounds and depth range of what lies in front of the camera; None if nothing does.

    A body that reaches behind the camera may cover any pixel: its bounds are the whole frame.
    """
    seen = extent(posed, camera)
    if not seen.farthest > 0:
        return None
    nearest = max(seen.nearest, _NEAREST * seen.farthest)
    if seen.nearest < nearest:
        return Box(0, 0, camera.width, camera.height), nearest, seen.farthest
    limit = 1e6  # far off is far off: keeps whole numbers small
    x0, y0 = (math.floor(min(max(v, -limit), limit)) for v in seen.low)
    x1, y1 = (math.ceil(min(max(v, -limit), limit)) for v in seen.high)
    return Box(x0, y0, x1 + 1, y1 + 1), nearest, seen.farthest
