"""The node hierarchy: local transforms to world matrices, and skins, whose joints are nodes."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
import numpy.typing as npt
from msgspec import Struct

from nlens_video.core.errors import SceneError
from nlens_video.core.layers import Bool, Float64
from nlens_video.scene.gltf.accessors import AccessorReader
from nlens_video.scene.gltf.animation_kernels import multiply
from nlens_video.scene.gltf.document import Document
from nlens_video.scene.gltf.extensions import hidden_nodes
from nlens_video.scene.gltf.fields import Fields, check_range

Indices = npt.NDArray[np.int64]
_DEEPEST = 2000  # no scene is: a chain like that is there to do harm
_EYE = tuple(float(v) for v in np.eye(4).ravel())


class Hierarchy(Struct, frozen=True, kw_only=True, eq=False):
    """The forest of nodes.

    Attributes:
        rest: translation [scene unit], rotation (a unit quaternion x y z w) and scale of each node
            without animation (N, 10).
        matrices: local matrices (N, 4, 4) of nodes that have one.
        has_matrix: which nodes have one (N,).
        visible: nodes of the chosen scene.
        drawn: those of them whose meshes and lights are not hidden.
        parents: parent of each node, -1 for a root.
        order: nodes and their parents (N, 2), parents first.
    """

    rest: Float64
    matrices: Float64
    has_matrix: Bool
    visible: frozenset[int]
    drawn: frozenset[int]
    parents: tuple[int, ...]
    order: Indices

    def with_ancestors(self, nodes: Iterable[int]) -> frozenset[int]:
        """Nodes, and all that carry them."""
        found: set[int] = set()
        for node in nodes:
            while node >= 0 and node not in found:
                found.add(node)
                node = self.parents[node]
        return frozenset(found)

    def with_descendants(self, nodes: Iterable[int]) -> frozenset[int]:
        """Nodes, and all that they carry."""
        return _with_descendants(self.order, nodes)

    def world(self, local: Float64) -> Float64:
        """World matrices (N, 4, 4) of all nodes.

        Args:
            local: what `rest` is, at some moment (N, 10).

        Raises:
            SceneError: a node is moved or scaled beyond what float32 can multiply.
        """
        world = np.empty((len(local), 4, 4))
        multiply(local, self.order, self.matrices, self.has_matrix, world)
        return check_range(world, "a node's place or scale")

    def oriented(self, local: Float64) -> Float64:
        """World matrices (N, 4, 4) for what has a direction and no size, as lights and cameras.

        A scale of 0, by which exporters hide things, is 1 in their axes; all else is as of `world`.
        """
        world, none = self.world(local), local[:, 7:] == 0.0
        if none.any():
            scaled = local.copy()
            scaled[:, 7:][none] = 1.0
            world[:, :3, :3] = self.world(scaled)[:, :3, :3]
        return world


def _with_descendants(order: Indices, nodes: Iterable[int]) -> frozenset[int]:
    found = set(nodes)
    for node, parent in order.tolist():
        if parent in found:
            found.add(node)
    return frozenset(found)


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
    order = _order(parents)
    rest = [
        _rows(nodes, "translation", (0.0, 0.0, 0.0)),
        normalized(_rows(nodes, "rotation", (0.0, 0.0, 0.0, 1.0))),
        _rows(nodes, "scale", (1.0, 1.0, 1.0)),
    ]
    matrices = np.swapaxes(_rows(nodes, "matrix", _EYE).reshape(-1, 4, 4), 1, 2)
    visible = _visible(document, order, scene)
    return Hierarchy(
        rest=np.concatenate(rest, axis=1),
        matrices=np.ascontiguousarray(matrices),
        has_matrix=np.array(["matrix" in node for node in nodes], dtype=bool),
        visible=visible,
        drawn=visible - _with_descendants(order, hidden_nodes(nodes)),
        parents=tuple(parents),
        order=order,
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


def _order(parents: list[int]) -> Indices:
    children: list[list[int]] = [[] for _ in parents]
    for child, parent in enumerate(parents):
        if parent >= 0:
            children[parent].append(child)
    level = [index for index, parent in enumerate(parents) if parent < 0]
    nodes: list[int] = []
    depth = 0
    while level:
        nodes += level
        level = [child for index in level for child in children[index]]
        depth += 1
        if level and depth > _DEEPEST:
            raise SceneError(f"nodes are nested more than {_DEEPEST} deep; flatten the scene")
    if len(nodes) != len(parents):
        raise SceneError("nodes form a cycle; expected a tree; export the file again")
    return np.array([(node, parents[node]) for node in nodes], np.int64).reshape(-1, 2)


def _visible(document: Document, order: Indices, scene: str | None) -> frozenset[int]:
    scenes = document.items("scenes")
    if not scenes:
        if scene is not None:
            raise SceneError(f"it has no scenes, so none is '{scene}'; leave --scene out")
        return frozenset(range(len(order)))
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
    return _with_descendants(order, scenes[chosen].integers("nodes", len(order)))


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


class Skin(Struct, frozen=True, eq=False):
    """Joints of a skinned mesh.

    Attributes:
        joints: their nodes (J,).
        inverse_bind: matrices (J, 4, 4) from the mesh's space to each joint's at rest.
    """

    joints: tuple[int, ...]
    inverse_bind: Float64

    def matrices(self, world: Float64) -> Float64:
        """Matrices (J, 4, 4) from the mesh's rest space to the world.

        Raises:
            SceneError: an entry is out of range.
        """
        return check_range(world[list(self.joints)] @ self.inverse_bind, "a skin's joint")


def read_skins(document: Document, accessors: AccessorReader) -> tuple[Skin, ...]:
    """All skins of the file.

    Raises:
        SceneError: a skin without joints, or with too few inverse bind matrices.
    """
    nodes = len(document.items("nodes"))
    skins = []
    for item in document.items("skins"):
        joints = item.integers("joints", nodes)
        if not joints:
            raise SceneError(f"{item.place} has no joints; export the file again")
        index = item.reference("inverseBindMatrices", accessors.count)
        inverse = np.broadcast_to(np.eye(4), (len(joints), 4, 4))
        if index is not None:
            flat = accessors.floats(index, 16)[: len(joints)].astype(np.float64)
            inverse = np.swapaxes(flat.reshape(-1, 4, 4), 1, 2)
        if len(inverse) < len(joints):
            raise SceneError(
                f"{item.place} has {len(joints)} joints and {len(inverse)} inverse bind matrices; "
                "export the file again"
            )
        skins.append(Skin(joints, inverse))
    return tuple(skins)


def mesh_scales(document: Document, accessors: AccessorReader) -> dict[int, dict[int, float]]:
    """Scale at which each node of a mesh draws it, by the mesh's index and the node's [1].

    It is the cube root of how often the mesh's volume fits into what is drawn; of an animated
    scale the largest, as things grow out of nothing. A skin's is the mean of its joints'.

    Raises:
        SceneError: a skin or a scale's keys are damaged.
    """
    nodes, meshes = document.items("nodes"), len(document.items("meshes"))
    scales = _node_scales(document, accessors, nodes)
    skins = [
        float(np.mean(scales[list(skin.joints)] * _linear_scale(skin.inverse_bind)))
        for skin in read_skins(document, accessors)
    ]
    found: dict[int, dict[int, float]] = {}
    for index, node in enumerate(nodes):
        mesh, skin = node.reference("mesh", meshes), node.reference("skin", len(skins))
        scale = float(scales[index]) if skin is None else skins[skin]
        if mesh is not None:
            known = math.isfinite(scale) and scale > 0.0
            found.setdefault(mesh, {})[index] = float(f"{scale:.6g}") if known else 1.0
    return found


def _node_scales(
    document: Document, accessors: AccessorReader, nodes: tuple[Fields, ...]
) -> Float64:
    """Scale of each node's space in the world (N,), the largest over all animations."""
    own: Float64 = np.cbrt(np.abs(np.prod(_rows(nodes, "scale", (1.0, 1.0, 1.0)), axis=1)))
    own *= _linear_scale(_rows(nodes, "matrix", _EYE).reshape(-1, 4, 4))
    for clip in document.items("animations"):
        samplers = clip.children("samplers")
        for channel in clip.children("channels"):
            target = channel.child("target")
            node = target.reference("node", len(nodes))
            if node is None or target.text("path") != "scale":
                continue
            sampler = samplers[channel.integer("sampler", below=len(samplers))]
            output = sampler.integer("output", below=accessors.count)
            keys = accessors.floats(output, 3).astype(np.float64)
            if sampler.text("interpolation") == "CUBICSPLINE":
                keys = keys[1::3]  # between tangents
            own[node] = max(own[node], np.cbrt(np.abs(np.prod(keys, axis=1)).max(initial=0.0)))
    with np.errstate(over="ignore", invalid="ignore"):
        for node, parent in _order(_parents(nodes)).tolist():
            own[node] *= own[parent] if parent >= 0 else 1.0
    return own


def _linear_scale(matrices: Float64) -> Float64:
    """How much longer matrices (N, 4, 4) make things, whatever the direction (N,)."""
    return np.asarray(np.cbrt(np.abs(np.linalg.det(matrices[:, :3, :3]))))
