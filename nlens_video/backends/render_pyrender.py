"""P's renderer: the object through pyrender, without a screen, in scene-linear light.

OpenGL is loaded when the first picture is asked for, so that a machine without it gets one clear
line, and only if something must be rendered.
"""

from __future__ import annotations

import math
import threading
from dataclasses import dataclass
from types import TracebackType
from typing import TYPE_CHECKING

import numpy as np

from nlens_video.errors import NlensError, SceneError
from nlens_video.frames import BehindLayer, Box, Float32, Float64, ObjectLayer
from nlens_video.scene.camera import Camera
from nlens_video.scene.gltf import Scene
from nlens_video.scene.posed import PosedScene
from nlens_video.scene.scene_light import SceneLight

if TYPE_CHECKING:
    from nlens_video.backends.gl_lighting import Lighting
    from nlens_video.backends.gl_platform import HeadlessPlatform
    from nlens_video.backends.gl_renderer import LinearRenderer, View

# Nearest depth that is drawn, as a share of the farthest: closer, a float32 depth buffer would not
# tell 1e-4 of the far depth any more.
_NEAR_SHARE = 1e-3


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Drawn:
    """How a picture was drawn."""

    posed: PosedScene
    camera: Camera
    box: Box
    near: float
    far: float

    @property
    def refusal(self) -> tuple[str, str]:
        """What to say where OpenGL refuses it."""
        size = f"{self.box.width}x{self.box.height}"
        return f"cannot draw a picture of {size} pixels", "use a smaller frame"

    def view(self, box: Box) -> View:
        """The same view of a part of the frame."""
        from nlens_video.backends.gl_renderer import View

        return View(
            camera_from_world=self.camera.camera_from_world,
            eye=self.camera.world_from_camera[:3, 3],
            clip_from_camera=_projection(self.camera, box, self.near, self.far),
            near=self.near,
            far=self.far,
            width=box.width,
            height=box.height,
        )


class PyrenderObjectRenderer:
    """Renders a scene's object on the box of the frame that it covers.

    The OpenGL context belongs to the thread that renders first; call `close` there.

    Args:
        scene: the object.
        light: what lights it; by default the file's lights, or a plausible light.
    """

    def __init__(self, scene: Scene, light: SceneLight | None = None) -> None:
        self._scene = scene
        self._light = light or SceneLight(scene.light_count)
        self._platform: HeadlessPlatform | None = None
        self._renderer: LinearRenderer | None = None
        self._posed: PosedScene | None = None
        self._last: tuple[ObjectLayer, _Drawn] | None = None
        self._thread = 0
        self._closed = False

    def __enter__(self) -> PyrenderObjectRenderer:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    @property
    def light_note(self) -> str:
        """What lights the object, in words."""
        return self._light.note

    def render(
        self, time_s: float, camera: Camera, margin: int = 0, *, nearest: bool = False
    ) -> ObjectLayer | None:
        """The object at a time, sharp.

        `camera` may be any pinhole camera: moved and with a shifted principal point it is a point
        of the lens' aperture.

        Args:
            time_s: time of the animation [s].
            camera: where from, on which frame.
            margin: how far beyond the frame the object is still rendered [px].
            nearest: whether depth may be that of a pixel's nearest sample, which is quicker.

        Returns:
            The layer on the box of the object's bounds on the screen, one pixel larger, inside the
            frame grown by `margin`; None where the object is out of view.

        Raises:
            NlensError: OpenGL cannot start or refuses the object or the picture, or another thread
                owns the context.
            SceneError: the animation scales the object beyond all numbers.
        """
        if self._posed is None or self._posed.time_s != time_s:
            self._posed = self._scene.pose(time_s)
        seen = _project(self._posed.vertices(), camera, margin)
        if seen is None:
            return None
        box, near, far = seen
        drawn = _Drawn(posed=self._posed, camera=camera, box=box, near=near, far=far)
        rgba, depth = self._draw(drawn, nearest=nearest)
        layer = ObjectLayer(box=box, rgba=rgba, depth=depth)
        self._last = (layer, drawn)
        return layer

    def _draw(self, drawn: _Drawn, *, nearest: bool) -> tuple[Float32, Float32]:
        renderer = self._open(drawn.posed)
        from nlens_video.backends.gl_platform import refusals

        with refusals(*drawn.refusal):
            return renderer.draw(
                drawn.posed, drawn.view(drawn.box), self._lighting(drawn.posed), nearest=nearest
            )

    def render_behind(
        self, front: ObjectLayer, region: Box, disparity_step: float
    ) -> BehindLayer | None:
        """What the nearest surfaces of a picture hide.

        Args:
            front: the picture that `render` has drawn last.
            region: where to look, a part of its box.
            disparity_step: how much less disparity than the nearest surface what it hides has
                at least, > 0 [1 / scene unit].

        Returns:
            The layer on the region; None where nothing is hidden.

        Raises:
            NlensError: as `render`, or `front` is not the last picture.
            ValueError: the region is not within it.
        """
        if self._last is None or self._last[0] is not front:
            raise NlensError(
                "the object was drawn again before it was looked behind; in the pipeline file put "
                "the stage 'peel' right after 'object-coc'"
            )
        if region.empty or region.intersection(front.box) != region:
            raise ValueError(f"{region} is not within {front.box}")
        drawn = self._last[1]
        renderer = self._open(drawn.posed)
        from nlens_video.backends.gl_behind import Front
        from nlens_video.backends.gl_platform import refusals

        shown = Front(
            depth=front.depth[region.slices_in(front.box)],
            disparity_step=disparity_step,
            corner=(region.x0 - front.box.x0, region.y0 - front.box.y0),
        )
        with refusals(*drawn.refusal):
            seen = renderer.draw_behind(
                drawn.posed, drawn.view(region), self._lighting(drawn.posed), shown
            )
        if seen is None:
            return None
        hidden = ObjectLayer(box=region, rgba=seen.rgba, depth=seen.depth)
        return BehindLayer(hidden=hidden, front_rgba=seen.front_rgba)

    def _lighting(self, posed: PosedScene) -> Lighting:
        from nlens_video.backends.gl_lighting import Lighting

        return Lighting.of(self._light.on_object(posed.lights))

    def _open(self, posed: PosedScene) -> LinearRenderer:
        if self._closed:
            raise NlensError("the renderer is closed; make a new one")
        if self._renderer is None or self._platform is None:
            self._thread = threading.get_ident()
            self._platform, self._renderer = _start(posed)
        elif self._thread != threading.get_ident():
            raise NlensError("the renderer belongs to the thread that rendered first; use it there")
        self._platform.make_current()
        return self._renderer

    def close(self) -> None:
        """Free the GPU objects and the context; may be called again."""
        self._closed = True
        renderer, platform = self._renderer, self._platform
        self._renderer = self._platform = self._posed = self._last = None
        if renderer is not None and platform is not None:
            platform.make_current()
            renderer.delete()
            platform.delete_context()


def _start(posed: PosedScene) -> tuple[HeadlessPlatform, LinearRenderer]:
    try:
        from nlens_video.backends.gl_platform import open_platform, refusals
        from nlens_video.backends.gl_renderer import LinearRenderer

        platform = open_platform()
    except (ImportError, AttributeError, OSError, RuntimeError) as error:
        # PyOpenGL and pyglet report a missing library as an attribute of None.
        raise NlensError(
            f"OpenGL cannot start without a screen ({error}); "
            "install it: apt-get install libegl1 libgl1"
        ) from error
    try:
        with refusals("cannot hold the object", "export it with smaller textures and meshes"):
            return platform, LinearRenderer(posed)
    except BaseException:
        platform.delete_context()
        raise


def _project(vertices: Float32, camera: Camera, margin: int) -> tuple[Box, float, float] | None:
    """The box that the vertices (V, 3) cover, with near and far depth; None if out of view."""
    local = camera.to_camera(vertices.astype(np.float64))
    depth = -local[:, 2]
    far = float(depth.max()) * (1.0 + 1e-4)
    if not math.isfinite(far):
        raise SceneError("the object has no finite size at this time; check its scale")
    if not far > 0.0:
        return None
    lowest = float(depth.min()) * (1.0 - 1e-4)
    near = max(lowest, _NEAR_SHARE * far)
    limit = Box(0, 0, camera.width, camera.height).grown(margin)
    box = limit
    if lowest >= near:  # else a triangle may cross the near plane and cover anything
        seen = camera.pixels(local)
        box = _outward(seen.min(axis=0), seen.max(axis=0), limit)
    return None if box.empty else (box, near, far)


def _outward(low: Float64, high: Float64, limit: Box) -> Box:
    """Whole pixels around a range of positions (2,), one more on each side, inside `limit`."""
    x0, y0 = (math.floor(max(v, -1e9)) - 1 for v in np.minimum(low, 1e9))
    x1, y1 = (math.ceil(min(v, 1e9)) + 1 for v in np.maximum(high, -1e9))
    return Box(x0, y0, x1, y1).intersection(limit)


def _projection(camera: Camera, box: Box, near: float, far: float) -> Float64:
    """Clip space of a box of the frame (4, 4); row 0 of the box lies at clip y = -1."""
    matrix = np.zeros((4, 4))
    matrix[0, 0] = 2.0 * camera.fx / box.width
    matrix[0, 2] = 1.0 - 2.0 * (camera.cx - box.x0) / box.width
    matrix[1, 1] = -2.0 * camera.fy / box.height
    matrix[1, 2] = 1.0 - 2.0 * (camera.cy - box.y0) / box.height
    matrix[2, 2] = -(far + near) / (far - near)
    matrix[2, 3] = -2.0 * far * near / (far - near)
    matrix[3, 2] = -1.0
    return matrix
