"""The plate of a scene, the export of its objects, and the result in Blender."""

from __future__ import annotations

import re
from pathlib import Path
from typing import NamedTuple

import bpy


class Plate(NamedTuple):
    """A plate: file, or pattern of a sequence (`numbered`), and size [px]."""

    path: str
    size: tuple[int, int]
    numbered: bool = False


def of_scene(scene: bpy.types.Scene) -> Plate:
    """The scene's movie clip, else what lies behind its camera.

    Raises:
        ValueError: neither is there.
    """
    camera = scene.camera
    if camera is None:
        raise ValueError("the scene has no camera; import a solved one")
    behind = [one for one in camera.data.background_images if one.show_background_image]
    for found in (scene.active_clip, *(one.clip or one.image for one in behind)):
        if found is not None and found.filepath:
            path = bpy.path.abspath(found.filepath)
            numbered = found.source == "SEQUENCE"
            if numbered:
                path = re.sub(r"(\d+)(?=\.\w+$)", lambda digits: f"%0{len(digits[1])}d", path)
            return Plate(path, (int(found.size[0]), int(found.size[1])), numbered)
    raise ValueError("the scene has no movie clip, and its camera no background image")


def rate(scene: bpy.types.Scene) -> float:
    """Frames per second of the scene [1/s]."""
    return float(scene.render.fps / scene.render.fps_base)


def need_numpy() -> None:
    """Blender's glTF add-on imports it, and Debian's Blender comes without.

    That of Blender 3.4 says `numpy.bool`, which numpy 1.24 to 1.26 lack; Debian 12 has both.

    Raises:
        ValueError: Blender's Python does not have it.
    """
    try:
        import numpy
    except ImportError:
        raise ValueError(
            "Blender's glTF add-on needs numpy, which Blender's Python does not have; on Debian "
            "and Ubuntu: apt-get install python3-numpy"
        ) from None
    if not hasattr(numpy, "bool"):
        numpy.bool = bool


def export(context: bpy.types.Context, shown: Plate, target: Path) -> Path:
    """Write the selected objects, the camera and the lights by Blender's own exporter.

    A glTF camera has the aspect of the picture, so the plate's size is the scene's meanwhile.
    Lights in excluded collections do not shine.

    Raises:
        ValueError: the exporter lacks numpy.
    """
    need_numpy()
    scene, render = context.scene, context.scene.render
    chosen, size = list(context.selected_objects), (render.resolution_x, render.resolution_y)
    there = context.view_layer.objects
    also = [one for one in there if one.type == "LIGHT" or one == scene.camera]
    added = [one for one in also if not one.select_get()]
    render.resolution_x, render.resolution_y = shown.size
    try:
        for one in added:
            one.select_set(True)
        bpy.ops.export_scene.gltf(
            filepath=str(target), export_format="GLB", use_selection=True, export_cameras=True,
            export_lights=True, export_apply=True, **_as_shown(),
        )  # fmt: skip
    finally:
        render.resolution_x, render.resolution_y = size
        for one in added:
            one.select_set(one in chosen)
    return target


def _as_shown() -> dict[str, object]:
    """Options for motion as the scene shows it, without actions that are only kept in the NLA."""
    known = bpy.ops.export_scene.gltf.get_rna_type().properties
    if "export_animation_mode" in known:
        return {"export_animation_mode": "SCENE", "export_anim_scene_split_object": False}
    return {"export_nla_strips": False}  # before Blender 3.6: the active actions


def import_scene(path: Path) -> None:
    """Read a glTF file by Blender's own importer.

    Raises:
        ValueError: the importer lacks numpy, or the file is missing or damaged.
    """
    need_numpy()
    if not path.is_file():
        raise ValueError(f"{path}: there is no such file")
    try:
        bpy.ops.import_scene.gltf(filepath=str(path))
    except RuntimeError as error:  # what the importer refuses, or its whole traceback
        said = str(error).strip().removeprefix("Error: ")
        reason = "it is damaged" if "Traceback" in said else " ".join(said.split())
        raise ValueError(f"{path}: cannot be read as glTF ({reason})") from None


def show(context: bpy.types.Context, result: Path) -> None:
    """The result in the image editors, and as a strip of the sequencer."""
    image = bpy.data.images.load(str(result), check_existing=True)
    image.reload()
    for area in context.screen.areas if context.screen else ():
        if area.type == "IMAGE_EDITOR":
            area.spaces.active.image = image
    editor = context.scene.sequence_editor_create()
    strips = editor.strips if hasattr(editor, "strips") else editor.sequences  # before 4.4
    for strip in [one for one in strips if one.name == "nlens-video"]:
        strips.remove(strip)
    channel = 1 + max((one.channel for one in strips), default=0)
    strips.new_movie("nlens-video", str(result), channel, context.scene.frame_start)
