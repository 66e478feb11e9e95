"""Sets up the object of a run: lighting, and renderer or layer reader."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import AbstractContextManager, nullcontext

from nlens_video.core.settings import ObjectSettings
from nlens_video.graph.base.context import ShadowScene
from nlens_video.graph.base.object_source import ObjectSource, RenderedObject, View
from nlens_video.graph.base.prerendered import PrerenderedObject
from nlens_video.scene.illumination import SceneLight
from nlens_video.scene.scene import Scene


def shadow_scene(objects: ObjectSettings, scene: Scene) -> ShadowScene:
    """Geometry and lighting of the shadow: the posed scene, lights and environment map.

    Raises:
        InputError: the environment map cannot be read.
    """
    environment = None
    light = objects.light
    if light.env is not None:
        from nlens_video.scene.environment import load_environment

        environment = load_environment(light.env, light.env_rotation_deg, light.env_exposure_ev)
    given = light.shadow_strength
    return ShadowScene(
        pose=scene.pose,
        light=SceneLight(scene.light_count, environment),
        pre_rendered=objects.layers is not None,
        strength=1.0 if given is None else given,
        strength_given=given is not None,
    )


def open_object(
    objects: ObjectSettings, scene: Scene, view: View, light: SceneLight
) -> tuple[
    ObjectSource,
    Callable[[], AbstractContextManager[object]],
    Callable[[], tuple[str, ...]],
]:
    """Open the source of the object's layers.

    Args:
        objects: the object.
        scene: the GLB.
        view: the frame that sees it.
        light: lights of the file and the environment map.

    Returns:
        The source; a context that the render lane's thread holds open; notes for the user.

    Raises:
        SceneError: there is no node of the footprint's name.
        InputError: the layers cannot be read.
    """
    if objects.footprint is not None:
        scene.triangles(0.0, objects.footprint)  # reports a wrong name before the run
    if objects.layers is not None:
        from nlens_video.video.exr import LayerReader

        layers = LayerReader(objects.layers, (view.width, view.height))
        return PrerenderedObject(scene, layers, view, objects.footprint), nullcontext, tuple
    from nlens_video.render.select import choose_renderer

    renderer = choose_renderer(scene, light)
    return (
        RenderedObject(scene, renderer, view, objects.footprint),
        lambda: renderer,
        lambda: (renderer.light_note, *renderer.notes),
    )
