"""The virtual scene: glTF loading, animation, deformation, camera, lights."""

from nlens_video.scene.camera import Camera
from nlens_video.scene.posed import PosedMesh, PosedScene
from nlens_video.scene.scene import Scene

__all__ = ["Camera", "PosedMesh", "PosedScene", "Scene"]
