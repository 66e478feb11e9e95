"""The node hierarchy: local transforms to world matrices."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from nlens_video.core.errors import SceneError
from nlens_video.core.layers import Bool, Float64
from nlens_video.scene.gltf.document import Document
from nlens_video.scene.gltf.fields import Fields, check_range

Indices = npt.NDArray[np.int64]
_DEEPEST = 2000  # no scene is: a chain like that is there to do harm
_EYE = tuple(float(v) for v in np.eye(4).ravel())


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Hierarchy:
    """The forest of nodes.

    Attributes:
        rest: translation [scene unit], rotation (a unit quaternion x y z w) and scale of each node
            without animation (N, 10).
        matrices: local matrices (N, 4, 4) of nodes that have one.
        has_matrix: which nodes have one (N,).
        levels: pairs (nodes, their parents) from the roots' children downwards.
        visible: nodes of the chosen scene.
        parents: parent of each node, -1 for a root.
        order: nodes and their parents (N, 2), parents first.
    """

    rest: Float64
    matrices: Float64
    has_matrix: Bool
    levels: tuple[tuple[Indices, Indices], ...]
    visible: frozenset[int]
    parents: tuple[int, ...]
    order: Indices = field(init=False)

    def __post_init__(self) -> None:
        roots = [node for node, parent in enumerate(self.parents) if parent < 0]
        nodes = np.concatenate([np.array(roots, np.int64), *(nodes for nodes, _ in self.levels)])
        parents = np.array(self.parents, np.int64)[nodes]
        object.__setattr__(self, "order", np.stack([nodes, parents], axis=1))

    def with_ancestors(self, nodes: Iterable[int]) -> frozenset[int]:
        """Nodes, and all that carry them."""
        found: set[int] = set()
        for node in nodes:
            while node >= 0 and node not in found:
                found.add(node)
                node = self.parents[node]
        return frozenset(found)

    def with_descendants(self, node: int) -> frozenset[int]:
        """A node, and all that it carries."""
        found = {node}
        for children, parents in self.levels:
            pairs = zip(children.tolist(), parents.tolist(), strict=True)
            found.update(child for child, parent in pairs if parent in found)
        return frozenset(found)

    def world(self, local: Float64) -> Float64:
        """World matrices (N, 4, 4) of all nodes.

        Args:
            local: what `rest` is, at some moment (N, 10).

        Raises:
            SceneError: a node is moved or scaled beyond what float32 can multiply.
        """
        from nlens_video.scene.animation.kernels import multiply  # here: numba takes long to load

        world = np.empty((len(local), 4, 4))
        multiply(local, self.order, self.matrices, self.has_matrix, world)
        check_range(world, "a node's place or scale")
        return world


def normalized(quaternions: Float64) -> Float64:
    """Unit quaternions (N, 4); the identity where one has no length."""
    length = np.sqrt(np.einsum("ij,ij->i", quaternions, quaternions))[:, None]
    identity = np.array([0.0, 0.0, 0.0, 1.0])
    return np.where(length > 0.0, quaternions / np.where(length > 0.0, length, 1.0), identity)


def read_hierarchy(document: Document, scene: str | None = None) -> Hierarchy:
    """All nodes of the file.

    Args:
        document: the file.
        scene: name of the scene that is visible, else its number from 0; None for its default.

    Raises:
        SceneError: a node has two parents, lies in a cycle, or holds wrong numbers; no such scene.
    """
    nodes = document.items("nodes")
    parents = _parents(nodes)
    levels = _levels(parents)
    rest = [
        _rows(nodes, "translation", (0.0, 0.0, 0.0)),
        normalized(_rows(nodes, "rotation", (0.0, 0.0, 0.0, 1.0))),
        _rows(nodes, "scale", (1.0, 1.0, 1.0)),
    ]
    matrices = np.swapaxes(_rows(nodes, "matrix", _EYE).reshape(-1, 4, 4), 1, 2)
    return Hierarchy(
        rest=np.concatenate(rest, axis=1),
        matrices=np.ascontiguousarray(matrices),
        has_matrix=np.array(["matrix" in node for node in nodes], dtype=bool),
        levels=levels,
        visible=_visible(document, len(nodes), levels, scene),
        parents=tuple(parents),
    )


def _rows(nodes: tuple[Fields, ...], key: str, default: tuple[float, ...]) -> Float64:
    rows = [node.vector(key, len(default), default) for node in nodes]
    return np.array(rows, dtype=np.float64).reshape(len(nodes), len(default))


def _parents(nodes: tuple[Fields, ...]) -> list[int]:
    parents = [-1] * len(nodes)
    for index, node in enumerate(nodes):
        for child in node.integers("children", len(nodes)):
            if parents[child] != -1 or child == index:
                raise SceneError(f"nodes[{child}] has two parents or is its own; export again")
            parents[child] = index
    return parents


def _levels(parents: list[int]) -> tuple[tuple[Indices, Indices], ...]:
    children: list[list[int]] = [[] for _ in parents]
    for child, parent in enumerate(parents):
        if parent >= 0:
            children[parent].append(child)
    current = [index for index, parent in enumerate(parents) if parent < 0]
    seen = len(current)
    levels: list[tuple[Indices, Indices]] = []
    while current := [child for index in current for child in children[index]]:
        seen += len(current)
        if len(levels) == _DEEPEST:
            raise SceneError(f"nodes are nested more than {_DEEPEST} deep; flatten the scene")
        nodes = np.array(current, dtype=np.int64)
        levels.append((nodes, np.array([parents[i] for i in current], dtype=np.int64)))
    if seen != len(parents):
        raise SceneError("nodes form a cycle; expected a tree; export the file again")
    return tuple(levels)


def _visible(
    document: Document,
    count: int,
    levels: tuple[tuple[Indices, Indices], ...],
    scene: str | None,
) -> frozenset[int]:
    scenes = document.items("scenes")
    if not scenes:
        if scene is not None:
            raise SceneError(f"it has no scenes, so none is '{scene}'; leave --scene out")
        return frozenset(range(count))
    chosen = document.root.integer("scene", below=len(scenes), default=0)
    # A name matters only where there is a choice.
    names = [item.name for item in scenes] if scene is not None or len(scenes) > 1 else []
    if scene is not None:
        chosen = _chosen(names, scene)
    elif len(scenes) > 1:
        others = ", ".join(_called(names, at) for at in range(len(names)) if at != chosen)
        document.warn(
            f"of {len(names)} scenes {_called(names, chosen)} is shown; "
            f"--scene NAME shows another: {others}"
        )
    visible = np.zeros(count, dtype=bool)
    visible[list(scenes[chosen].integers("nodes", count))] = True
    for nodes, parents in levels:
        visible[nodes] |= visible[parents]
    return frozenset(np.flatnonzero(visible).tolist())


def _chosen(names: list[str], scene: str) -> int:
    if scene in names:
        return names.index(scene)
    if scene.isdecimal() and int(scene) < len(names):
        return int(scene)
    known = ", ".join(_called(names, at) for at in range(len(names)))
    raise SceneError(f"no scene is named '{scene}'; expected one of {known}")


def _called(names: list[str], at: int) -> str:
    """A scene as one can ask for it."""
    return names[at] if names[at] and names.index(names[at]) == at else str(at)
