"""The layers of `nlens-video --aov` in Blender's compositor, as one node group."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import bpy

NAME = "nlens-video layers"
_COLOUR, _VALUE = "NodeSocketColor", "NodeSocketFloat"


class Output(NamedTuple):
    """A socket of the group: the layer and the pass of the files that it shows."""

    name: str
    kind: str
    layer: str
    part: str


OUTPUTS = (
    Output("Layer", _COLOUR, "", "Combined"),
    Output("Object", _COLOUR, "object", "Combined"),
    Output("Object Depth", _VALUE, "object", "Depth"),
    Output("Object CoC", _VALUE, "object", "coc_px"),
    Output("Plate CoC", _VALUE, "plate", "coc_px"),
    Output("Plate CoC Error", _VALUE, "plate", "sigma_px"),
    Output("Mask", _VALUE, "projection", "mask"),
)


def files_of(chosen: Path) -> list[Path]:
    """The files of a run, in their order.

    Args:
        chosen: its folder, or one of them.

    Raises:
        ValueError: there are none.
    """
    folder = chosen if chosen.is_dir() else chosen.parent
    found = sorted(one for one in folder.glob("*.exr") if one.stem.isdigit())
    if not found:
        raise ValueError(f"{folder}: no layers in it; nlens-video writes them with --aov")
    return found


def add_group(scene: bpy.types.Scene, chosen: Path) -> bpy.types.NodeTree:
    """Make the group of a run's files; the scene's first frame shows the first of them.

    Its input is the plate, its first output the composite.

    Raises:
        ValueError: no files, or files of something else.
    """
    files = files_of(chosen)
    image = bpy.data.images.load(str(files[0]), check_existing=True)
    image.source = "FILE"  # until its layers are known
    tree = bpy.data.node_groups.new(NAME, "CompositorNodeTree")
    _socket(tree, "INPUT", _COLOUR, "Plate")
    _socket(tree, "OUTPUT", _COLOUR, "Image")
    for one in OUTPUTS:
        _socket(tree, "OUTPUT", one.kind, one.name)
    ends = tree.nodes.new("NodeGroupInput"), tree.nodes.new("NodeGroupOutput")
    ends[0].location, ends[1].location = (-300, 200), (600, 0)
    shown = {}
    for row, layer in enumerate(dict.fromkeys(one.layer for one in OUTPUTS)):
        node = shown[layer] = tree.nodes.new("CompositorNodeImage")
        node.image, node.location = image, (-300, -300 * row)
        try:
            if layer:
                node.layer = layer
        except TypeError:
            bpy.data.node_groups.remove(tree)
            raise ValueError(f"{files[0]}: not written by nlens-video --aov") from None
    for one in OUTPUTS:
        tree.links.new(shown[one.layer].outputs[one.part], ends[1].inputs[one.name])
    over = tree.nodes.new("CompositorNodeAlphaOver")  # the layer is premultiplied, as it expects
    over.location = (200, 200)
    behind, before = (one for one in over.inputs if one.type == "RGBA")
    tree.links.new(ends[0].outputs["Plate"], behind)
    tree.links.new(shown[""].outputs["Combined"], before)
    tree.links.new(over.outputs["Image"], ends[1].inputs["Image"])
    image.source = "SEQUENCE"
    for node in shown.values():
        node.frame_duration, node.frame_start = len(files), scene.frame_start
        node.frame_offset = int(files[0].stem) - 1  # Blender counts files from 1
    return tree


def place(scene: bpy.types.Scene, tree: bpy.types.NodeTree) -> bpy.types.Node:
    """Put the group into the scene's compositor, behind its active clip, and before its output."""
    if hasattr(scene, "compositing_node_group"):  # Blender 5
        whole = scene.compositing_node_group
        if whole is None:
            whole = bpy.data.node_groups.new("Compositor", "CompositorNodeTree")
            _socket(whole, "OUTPUT", _COLOUR, "Image")
            scene.compositing_node_group = whole
        kind = "NodeGroupOutput"
    else:
        new = scene.node_tree is None
        scene.use_nodes = True
        whole, kind = scene.node_tree, "CompositorNodeComposite"
        if new:
            whole.nodes.clear()  # Blender's own first nodes would render the scene
    group = whole.nodes.new("CompositorNodeGroup")
    group.node_tree = tree
    if scene.active_clip is not None:
        plate = whole.nodes.new("CompositorNodeMovieClip")
        plate.clip, plate.location = scene.active_clip, (-250, 0)
        whole.links.new(plate.outputs["Image"], group.inputs["Plate"])
    out = next((one for one in whole.nodes if one.bl_idname == kind), None)
    if out is None:
        out = whole.nodes.new(kind)
        out.location = (250, 0)
    whole.links.new(group.outputs["Image"], out.inputs[0])
    return group


def _socket(tree: bpy.types.NodeTree, side: str, kind: str, name: str) -> None:
    if hasattr(tree, "interface"):  # Blender 4
        tree.interface.new_socket(name=name, in_out=side, socket_type=kind)
    else:
        (tree.inputs if side == "INPUT" else tree.outputs).new(kind, name)
