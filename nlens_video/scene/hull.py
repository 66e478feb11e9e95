"""Points that hold an object between them, found without moving its vertices."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from nlens_video.core.layers import Float64
from nlens_video.scene.deform import Instance
from nlens_video.scene.gltf.fields import check_range


@dataclass(frozen=True, slots=True, eq=False)
class Hull:
    """Boxes round all vertices, each carried by a node.

    Attributes:
        nodes: what carries each (B,).
        corners: in its space, homogeneous, as columns (B, 4, 8).
    """

    nodes: npt.NDArray[np.int64]
    corners: Float64

    @classmethod
    def of(cls, instances: Sequence[Instance], weights: dict[int, Float64]) -> Hull:
        """That of all instances, with animated morph weights by node."""
        boxes = [instance.boxes(weights.get(instance.node)) for instance in instances]
        return cls(
            np.array([node for nodes, _ in boxes for node in nodes], np.int64),
            np.concatenate([corners for _, corners in boxes]),
        )

    def at(self, world: Float64) -> Float64:
        """The corners in the world (8 B, 3), for world matrices of all nodes (N, 4, 4).

        Raises:
            SceneError: one lies beyond what float32 can multiply.
        """
        carried = world[self.nodes, :3] @ self.corners
        check_range(carried, "a vertex or a skin's joint")
        return np.ascontiguousarray(np.swapaxes(carried, 1, 2)).reshape(-1, 3)
