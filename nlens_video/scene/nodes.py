"""The node hierarchy: local transforms to world matrices."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np
import numpy.typing as npt

from nlens_video.errors import SceneError
from nlens_video.frames import Bool, Float64
from nlens_video.scene.document import Document
from nlens_video.scene.fields import Fields, check_range

Indices = npt.NDArray[np.intp]
_DEEPEST = 2000  # each level costs time on each frame
_EYE = tuple(float(v) for v in np.eye(4).ravel())


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LocalPose:
    """Local transforms of all nodes at one moment.

    Attributes:
        translation: (N, 3) [scene unit].
        rotation: unit quaternions (N, 4), x y z w.
        scale: (N, 3).
    """

    translation: Float64
    rotation: Float64
    scale: Float64

    def copy(self) -> LocalPose:
        """A pose to be changed."""
        return LocalPose(
            translation=self.translation.copy(),
            rotation=self.rotation.copy(),
            scale=self.scale.copy(),
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Hierarchy:
    """The forest of nodes.

    Attributes:
        rest: local transforms without animation.
        matrices: local matrices (N, 4, 4) of nodes that have one.
        has_matrix: which nodes have one (N,).
        levels: pairs (nodes, their parents) from the roots' children downwards.
        visible: nodes of the chosen scene.
        parents: parent of each node, -1 for a root.
        strides: pairs (nodes, their ancestors 1, 2, 4 ... levels above them).
    """

    rest: LocalPose
    matrices: Float64
    has_matrix: Bool
    levels: tuple[tuple[Indices, Indices], ...]
    visible: frozenset[int]
    parents: tuple[int, ...]
    strides: tuple[tuple[Indices, Indices], ...] = field(init=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "strides", _strides(self.parents))

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

    def world(self, pose: LocalPose) -> Float64:
        """World matrices (N, 4, 4) of all nodes.

        Raises:
            SceneError: a node is moved or scaled beyond what float32 can multiply.
        """
        world = compose(pose)
        world[self.has_matrix] = self.matrices[self.has_matrix]
        with np.errstate(over="ignore", invalid="ignore"):  # looked for once, at the end
            for nodes, ancestors in self.strides:  # a product of all of a chain in few steps
                world[nodes] = world[ancestors] @ world[nodes]
        check_range(world, "a node's place or scale")
        return world


def compose(pose: LocalPose) -> Float64:
    """Matrices (N, 4, 4) of translation * rotation * scale."""
    x, y, z, w = pose.rotation.T
    matrix = np.zeros((len(pose.translation), 4, 4))
    matrix[:, 0, 0] = 1.0 - 2.0 * (y * y + z * z)
    matrix[:, 0, 1] = 2.0 * (x * y - z * w)
    matrix[:, 0, 2] = 2.0 * (x * z + y * w)
    matrix[:, 1, 0] = 2.0 * (x * y + z * w)
    matrix[:, 1, 1] = 1.0 - 2.0 * (x * x + z * z)
    matrix[:, 1, 2] = 2.0 * (y * z - x * w)
    matrix[:, 2, 0] = 2.0 * (x * z - y * w)
    matrix[:, 2, 1] = 2.0 * (y * z + x * w)
    matrix[:, 2, 2] = 1.0 - 2.0 * (x * x + y * y)
    matrix[:, :3, :3] *= pose.scale[:, None, :]
    matrix[:, :3, 3] = pose.translation
    matrix[:, 3, 3] = 1.0
    return matrix


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
    rest = LocalPose(
        translation=_rows(nodes, "translation", (0.0, 0.0, 0.0)),
        rotation=normalized(_rows(nodes, "rotation", (0.0, 0.0, 0.0, 1.0))),
        scale=_rows(nodes, "scale", (1.0, 1.0, 1.0)),
    )
    matrices = np.swapaxes(_rows(nodes, "matrix", _EYE).reshape(-1, 4, 4), 1, 2)
    return Hierarchy(
        rest=rest,
        matrices=matrices,
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


def _strides(parents: Sequence[int]) -> tuple[tuple[Indices, Indices], ...]:
    above = np.array(parents, dtype=np.intp)
    strides: list[tuple[Indices, Indices]] = []
    while (above >= 0).any():
        nodes = np.flatnonzero(above >= 0)
        strides.append((nodes, above[nodes]))
        twice = np.full_like(above, -1)
        twice[nodes] = above[above[nodes]]
        above = twice
    return tuple(strides)


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
        nodes = np.array(current, dtype=np.intp)
        levels.append((nodes, np.array([parents[i] for i in current], dtype=np.intp)))
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
