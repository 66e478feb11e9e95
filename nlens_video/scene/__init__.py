"""The virtual scene: glTF loading, animation, deformation, camera, lights."""

from nlens_video.scene.camera import Camera
from nlens_video.scene.gltf import Scene
from nlens_video.scene.posed import PosedMesh, PosedScene

__all__ = ["Camera", "PosedMesh", "PosedScene", "Scene"]
