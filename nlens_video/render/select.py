"""Choice of the renderer: OpenGL on a graphics device, else the software rasteriser.

Without a graphics device OpenGL would run on the processor (Mesa's llvmpipe): two to four times
slower than the software rasteriser, and it needs libraries to be installed.
"""

from __future__ import annotations

import os
from functools import cache
from pathlib import Path

from nlens_video.core.errors import UsageError
from nlens_video.render.base.box_renderer import BoxRenderer
from nlens_video.scene.scene import Scene
from nlens_video.scene.scene_light import SceneLight

VARIABLE = "NLENS_RENDERER"
"""Environment variable: `auto`, `opengl` or `software`."""
_DEVICES = ("dri/renderD*", "nvidiactl", "dxg", "kgsl-3d0", "mali*")  # graphics devices, in /dev
_ON_PROCESSOR = ("llvmpipe", "softpipe", "swrast")


def choose_renderer(scene: Scene, light: SceneLight | None = None) -> BoxRenderer:
    """The renderer for this machine, or the one that `NLENS_RENDERER` names.

    Args:
        scene: the object.
        light: what lights it; by default the file's lights, or a plausible light.

    Raises:
        UsageError: `NLENS_RENDERER` names none.
    """
    name, why = _chosen()
    renderer: BoxRenderer
    if name == "opengl":
        from nlens_video.render.opengl.object_renderer import PyrenderObjectRenderer

        renderer = PyrenderObjectRenderer(scene, light)
    else:
        from nlens_video.render.software.renderer import SoftwareObjectRenderer

        renderer = SoftwareObjectRenderer(scene, light)
    renderer.reason = why
    return renderer


def renderer_name() -> str:
    """`opengl` or `software`, whichever `choose_renderer` takes; a value of `NLENS_RENDERER`.

    Raises:
        UsageError: `NLENS_RENDERER` names none.
    """
    return _chosen()[0]


def renderer_choice() -> str:
    """Which renderer `choose_renderer` takes, and why.

    Raises:
        UsageError: `NLENS_RENDERER` names none.
    """
    name, why = _chosen()
    return f"{'OpenGL' if name == 'opengl' else 'software rasteriser'} ({why})"


def _chosen() -> tuple[str, str]:
    named = os.environ.get(VARIABLE, "auto")
    if named in ("opengl", "software"):
        return named, f"{VARIABLE}={named}"
    if named != "auto":
        raise UsageError(f"{VARIABLE}={named}: expected auto, opengl or software")
    why_not = _why_no_graphics()
    return ("software", why_not) if why_not else ("opengl", "on a graphics device")


@cache
def _why_no_graphics() -> str:
    """Why OpenGL would not run on a graphics device; empty where it does."""
    if not any(next(Path("/dev").glob(pattern), None) for pattern in _DEVICES):
        return "no graphics device"
    try:
        from nlens_video.render.opengl.egl_platform import describe, open_platform

        platform = open_platform()
    except (ImportError, AttributeError, OSError, RuntimeError) as error:
        # PyOpenGL and pyglet report a missing library as an attribute of None.
        return f"OpenGL cannot start: {' '.join(str(error).split())}"
    try:
        found = describe()
    finally:
        platform.delete_context()
    if any(name in found for name in _ON_PROCESSOR):
        return f"OpenGL would run on the processor: {found}"
    return ""
