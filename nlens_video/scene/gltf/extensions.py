"""The extensions that are read, and what to do about a file that requires another."""

from __future__ import annotations

from nlens_video.core.errors import SceneError
from nlens_video.scene.gltf.fields import Fields
from nlens_video.scene.gltf.meshopt import EXTENSIONS as MESHOPT

SUPPORTED_EXTENSIONS = frozenset(
    {
        *MESHOPT,
        "EXT_texture_webp",
        "KHR_animation_pointer",
        "KHR_draco_mesh_compression",
        "KHR_lights_punctual",
        "KHR_materials_emissive_strength",
        "KHR_materials_ior",
        "KHR_materials_specular",
        "KHR_materials_unlit",
        "KHR_mesh_quantization",
        "KHR_texture_transform",
    }
)
DECODE_FIRST = "decode it first: gltf-transform cp IN.glb OUT.glb"
_REMEDY = {
    "KHR_texture_basisu": "decode it first: gltf-transform ktxdecompress IN.glb OUT.glb",
}


def check_required(root: Fields) -> None:
    """Refuse a file that requires an extension which is not supported.

    Raises:
        SceneError: with what to do.
    """
    for name in root.texts("extensionsRequired"):
        if name not in SUPPORTED_EXTENSIONS:
            remedy = _REMEDY.get(name, "export the file without it")
            raise SceneError(f"the file requires the extension {name}, not supported; {remedy}")
