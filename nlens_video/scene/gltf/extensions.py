"""The extensions that are read, and what to do about a file that requires another."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import chain

from nlens_video.core.errors import SceneError
from nlens_video.scene.gltf.fields import Fields
from nlens_video.scene.gltf.meshopt import EXTENSIONS as MESHOPT

SUPPORTED_EXTENSIONS = frozenset(
    {
        *MESHOPT,
        "EXT_texture_avif",
        "EXT_texture_webp",
        "KHR_animation_pointer",
        "KHR_draco_mesh_compression",
        "KHR_lights_punctual",
        "KHR_materials_anisotropy",
        "KHR_materials_clearcoat",
        "KHR_materials_emissive_strength",
        "KHR_materials_ior",
        "KHR_materials_sheen",
        "KHR_materials_specular",
        "KHR_materials_transmission",
        "KHR_materials_unlit",
        "KHR_materials_variants",
        "KHR_materials_volume",
        "KHR_mesh_quantization",
        "KHR_node_visibility",
        "KHR_texture_basisu",
        "KHR_texture_transform",
    }
)
DECODE_FIRST = "decode it first: gltf-transform cp IN.glb OUT.glb"
_REMEDY = {
    "KHR_materials_pbrSpecularGlossiness": "convert it: gltf-transform metalrough IN.glb OUT.glb",
}
_HARMLESS = frozenset({"KHR_xmp", "KHR_xmp_json_ld"})


def check_required(root: Fields) -> None:
    """Refuse a file that requires an extension which is not supported.

    Raises:
        SceneError: with what to do.
    """
    for name in root.texts("extensionsRequired"):
        if name not in SUPPORTED_EXTENSIONS:
            remedy = _REMEDY.get(name, "export the file without it")
            raise SceneError(f"the file requires the extension {name}, not supported; {remedy}")


def left_out(root: Fields) -> list[str]:
    """What the file may have that is not drawn, one line each."""
    lines = []
    for name in dict.fromkeys((*root.texts("extensionsUsed"), *_undeclared(root))):
        if name not in SUPPORTED_EXTENSIONS and name not in _HARMLESS:
            remedy = f"; {_REMEDY[name]}" if name in _REMEDY else ""
            shown = "".join(c for c in name if c.isprintable())
            lines.append(f"{shown} is not supported: drawn without it{remedy}")
    variants = root.extension("KHR_materials_variants")
    names = [item.name for item in variants.children("variants")] if variants else []
    if names:
        lines.append(f"the default materials are drawn, none of the variants ({', '.join(names)})")
    return lines


def _undeclared(root: Fields) -> Iterator[str]:
    """Extensions of what is drawn, which files may use without saying so."""
    primitives = (mesh.children("primitives") for mesh in root.children("meshes"))
    drawn = (root.children(key) for key in ("nodes", "materials", "textures"))
    for item in chain(*primitives, *drawn):
        yield from item.child("extensions").data


def hidden_nodes(nodes: Sequence[Fields]) -> Iterator[int]:
    """Nodes that KHR_node_visibility hides, with all that they carry."""
    for index, node in enumerate(nodes):
        visibility = node.extension("KHR_node_visibility")
        if visibility is not None and "visible" in visibility and not visibility.flag("visible"):
            yield index
