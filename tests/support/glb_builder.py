"""A small writer of GLB files for tests: `from support.glb_builder import GlbBuilder`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from nlens_video.scene.gltf.writer import GlbWriter

QUAD = np.array([[-1, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0]], np.float32)
QUAD_FACES = np.array([[0, 1, 2], [0, 2, 3]], np.uint16)
QUAD_UV = np.array([[0, 1], [1, 1], [1, 0], [0, 0]], np.float32)


class GlbBuilder(GlbWriter):
    """The writer of `bench` with meshes, cameras and clips in one call each."""

    def mesh(
        self,
        positions: Any = QUAD,
        faces: Any = QUAD_FACES,
        *,
        material: int | None = None,
        targets: Sequence[dict[str, Any]] = (),
        weights: Sequence[float] = (),
        mode: int = 4,
        **attributes: Any,
    ) -> int:
        """A mesh of one primitive; attributes by their glTF names."""
        named = {"POSITION": positions, **attributes}
        primitive: dict[str, Any] = {
            "attributes": {
                k: v if isinstance(v, int) else self.accessor(v) for k, v in named.items()
            },
            "mode": mode,
        }
        if faces is not None:
            primitive["indices"] = self.accessor(np.asarray(faces, np.uint32).ravel())
        if material is not None:
            primitive["material"] = material
        if targets:
            primitive["targets"] = [
                {k: self.accessor(np.asarray(v, np.float32)) for k, v in t.items()} for t in targets
            ]
        mesh: dict[str, Any] = {"primitives": [primitive]}
        if weights:
            mesh["weights"] = list(weights)
        return self.add("meshes", mesh)

    def camera(self, yfov: float = 0.8, *, name: str = "", aspect: float | None = None) -> int:
        """A perspective camera."""
        lens = {"yfov": yfov, "znear": 0.1}
        if aspect is not None:
            lens["aspectRatio"] = aspect
        return self.add("cameras", {"type": "perspective", "perspective": lens, "name": name})

    def texture(self, pixels: Any, **sampler: int) -> int:
        """A texture of uint8 pixels (H, W, 3 or 4), nearest filter unless told."""
        return super().texture(pixels, **{"magFilter": 9728, "minFilter": 9728, **sampler})
