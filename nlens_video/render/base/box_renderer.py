"""Base class of renderers: pose, screen-space box, reuse of the layer of an object at rest."""

from __future__ import annotations

import math
import weakref
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from functools import partial
from typing import Self

from msgspec.structs import replace

from nlens_video.core.errors import NlensError, Note, NoteKind
from nlens_video.core.layers import BehindLayer, Box, Float32, Float64, ObjectLayer
from nlens_video.render.base.drawer import BehindPicture, FrontSurfaces, ViewSetup, view_setup
from nlens_video.render.base.light_depth import LightDepthCache, no_light_depth
from nlens_video.render.base.shader_inputs import Lighting
from nlens_video.scene.camera import Camera
from nlens_video.scene.illumination import LUMINANCE, Illumination
from nlens_video.scene.posed import PosedScene
from nlens_video.scene.scene import Scene
from nlens_video.scene.scene_light import SceneLight
from nlens_video.scene.surround import ROUGHEST


class BoxRenderer(ABC):
    """Renders a scene's object on the box of the frame that it covers.

    Args:
        scene: the object.
        light: what lights it; by default the file's lights, or a plausible light.

    Attributes:
        name: of the renderer, for people.
        reason: why it was chosen; empty where there was no choice.
        notes: events the user should know of, such as a lost OpenGL context.
    """

    name: str
    reason = ""

    def __init__(self, scene: Scene, light: SceneLight | None = None) -> None:
        self._scene = scene
        self._light_depth: LightDepthCache | None = None
        self._light = light or SceneLight(scene.light_count)
        self._posed: PosedScene | None = None
        self._last: tuple[tuple[object, ...], ObjectLayer] | None = None
        self._sources: dict[int, ViewSetup] = {}  # of the layers in use, by their identity
        self._on_target: ViewSetup | None = None  # of the picture that was drawn last
        self.notes: list[str] = []
        self._closed = False

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def rearrange(self, scene: Scene, light: SceneLight | None = None) -> None:
        """Draw the same files from now on where another scene places them, under other light."""
        self._scene, self._light = scene, light or self._light
        self._posed = self._last = self._on_target = None

    def shade_itself(self) -> None:
        """Let parts of the object, and objects, cast shadows on each other from now on."""
        self._light_depth = LightDepthCache()

    def see_from_lights(
        self, time_s: float, camera: Camera, plate_light: Illumination | None = None
    ) -> None:
        """Draw the object's depth as its lights see it, for the pictures of a time that follow.

        Args:
            time_s: time of the animation [s].
            camera: of these pictures; they need maps as fine as the object is large there.
            plate_light: as for `render`.
        """
        self._moment(time_s, plate_light, camera)

    @property
    def light_note(self) -> Note:
        """Description of the light sources."""
        return self._light.note

    @property
    def description(self) -> str:
        """Description of the renderer and the reason for its choice."""
        return f"{self.name}{f' ({self.reason})' if self.reason else ''}, the object's box only"

    def render(
        self,
        time_s: float,
        camera: Camera,
        margin: int = 0,
        *,
        nearest: bool = False,
        plate_light: Illumination | None = None,
    ) -> ObjectLayer | None:
        """The object at a time, sharp.

        `camera` may be any pinhole camera: moved and with a shifted principal point it is a point
        of the lens' aperture. While object, camera and light are unchanged, the same layer object
        is returned, whatever was drawn with `nearest` in between.

        Args:
            time_s: time of the animation [s].
            camera: where from, on which frame.
            margin: how far beyond the frame the object is still rendered [px].
            nearest: whether depth may be that of a pixel's nearest sample, which is quicker.
            plate_light: lights the object where its file does not; None for a plausible light.

        Returns:
            The layer on the box of the object's bounds on the screen, one pixel larger, inside the
            frame grown by `margin`; None where the object is out of view.

        Raises:
            NlensError: the object or the picture is too large to be drawn; OpenGL cannot start, or
                another thread owns the context.
            SceneError: the animation scales the object beyond all numbers.
        """
        posed, lighting, origin = self._moment(time_s, plate_light, camera)
        camera = camera.about(origin)
        key = (*_key(posed, camera, lighting), margin)
        if not nearest and self._last is not None and self._last[0] == key:
            return self._last[1]
        view = view_setup(posed, lighting, camera, margin, nearest=nearest)
        if view is None:
            return None
        rgba, depth = self._draw(view)
        layer = ObjectLayer(box=view.box, rgba=rgba, depth=depth)
        self._on_target = view
        if not nearest:
            self._last = key, layer
            self._sources[id(layer)] = view
            weakref.finalize(layer, self._sources.pop, id(layer), None)
        return layer

    def render_views(
        self,
        time_s: float,
        cameras: Sequence[Camera],
        margin: int,
        use: Callable[[int, ObjectLayer | None], None],
        *,
        nearest: bool = False,
        plate_light: Illumination | None = None,
    ) -> None:
        """Render the object from several cameras, and wait until all layers are used.

        Args:
            time_s: time of the animation [s].
            cameras: as for `render`.
            margin: likewise.
            use: receives each camera's index and layer, in order, on a second thread while this one
                draws the next view.
            nearest: as for `render`.
            plate_light: likewise.

        Raises:
            As `render`, and what `use` raises.
        """
        with ThreadPoolExecutor(1, thread_name_prefix="views") as using:
            before: Future[None] | None = None
            for at, camera in enumerate(cameras):
                layer = self.render(
                    time_s, camera, margin, nearest=nearest, plate_light=plate_light
                )
                if before is not None:
                    before.result()
                before = using.submit(use, at, layer)
            if before is not None:
                before.result()

    def render_behind(
        self, front: ObjectLayer, region: Box, disparity_step: float
    ) -> BehindLayer | None:
        """Depth-peel: the second surface of a rendered layer.

        Args:
            front: a layer from `render`, without `nearest`.
            region: the part of its box to peel.
            disparity_step: least difference in disparity between the nearest surface and the one
                it hides, > 0 [1 / scene unit].

        Returns:
            The layer on the region; None where nothing is hidden.

        Raises:
            NlensError: as `render`.
            ValueError: `front` is no layer of this renderer, or the region is not within its box.
        """
        self._check()
        source = self._sources.get(id(front))
        if source is None:
            raise ValueError("the layer was not rendered by this renderer")
        if region.empty or region.intersection(front.box) != region:
            raise ValueError(f"{region} is not within {front.box}")
        if self._on_target is not source:
            self._draw(source)
            self._on_target = source
        shown = FrontSurfaces(
            depth=front.depth[region.slices_in(front.box)],
            disparity_step=disparity_step,
            corner=(region.x0 - front.box.x0, region.y0 - front.box.y0),
        )
        seen = self._draw_behind(replace(source, box=region), shown)
        if seen is None:
            return None
        hidden = ObjectLayer(box=region, rgba=seen.rgba, depth=seen.depth)
        return BehindLayer(hidden=hidden, front_rgba=seen.front_rgba)

    @abstractmethod
    def _draw(self, view: ViewSetup) -> tuple[Float32, Float32]:
        """Premultiplied linear RGBA (h, w, 4) and depth (h, w), +inf where nothing is."""

    @abstractmethod
    def _draw_behind(self, view: ViewSetup, front: FrontSurfaces) -> BehindPicture | None:
        """What lies behind a part of the last picture, without what blends; None for nothing."""

    def _moment(
        self, time_s: float, plate_light: Illumination | None, camera: Camera
    ) -> tuple[PosedScene, Lighting, Float64 | None]:
        """The object and its light at a time, about its `origin`, and that."""
        self._check()
        if self._posed is None or self._posed.time_s != time_s:
            self._posed = self._scene.pose(time_s)
        posed = self._posed.about_origin()
        said = plate_light if plate_light is not None and not plate_light.provisional else None
        if posed.lights and said is not None and said.exposure != 1.0:
            self._say(
                "the file's lights are far brighter than the plate's (in lux, as Blender exports "
                f"them): exposed for the plate, {math.log2(said.exposure):+.1f} stops"
            )
        if said is not None and said.shadow_left is not None:
            share = 100.0 * float(said.shadow_left @ LUMINANCE)
            self._say(f"the sun's shadow leaves {share:.0f} % of the light, as the plate's own do")
        light = self._light.on_object(posed.lights, plate_light)
        mirrored = any(mesh.geometry.material.mirrors(ROUGHEST) for mesh in posed.meshes)
        origin = self._posed.origin
        depth = no_light_depth
        if self._light_depth is not None:
            depth = partial(self._light_depth.of, posed, camera.about(origin))
        return posed, Lighting.of(light, mirrored=mirrored, depth=depth), origin

    def _say(self, text: str) -> None:
        note = Note(text, NoteKind.INFORMATION)
        if note not in self.notes:
            self.notes.append(note)

    def _check(self) -> None:
        """Raise if the renderer cannot draw now, on this thread."""
        if self._closed:
            raise NlensError("the renderer is closed; make a new one")

    def close(self) -> None:
        """Free all resources; further calls do nothing."""
        self._closed = True
        self._posed = self._last = self._on_target = None


def _key(posed: PosedScene, camera: Camera, lighting: Lighting) -> tuple[object, ...]:
    """Cache key of a picture; meshes at rest keep their identity (`Instance.place`)."""
    return (
        tuple(map(id, posed.meshes)),
        camera.world_from_camera.tobytes(),
        (camera.fx, camera.fy, camera.cx, camera.cy, camera.width, camera.height),
        lighting.lamp_rows(camera.world_from_camera[:3, 3]).tobytes(),
        lighting.ambient_rows().tobytes(),
        lighting.ambient is None,
        id(lighting.surround),
    )
