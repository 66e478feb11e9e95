"""Perspective cameras of the file."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from nlens_video.core.errors import Note, NoteKind, SceneError
from nlens_video.core.layers import Float64
from nlens_video.scene.gltf.document import Document


@dataclass(frozen=True, slots=True, kw_only=True)
class Perspective:
    """A camera as the file declares it.

    Attributes:
        name: its own name, else its node's, else `camera N`.
        node_name: name of the node that carries it.
        node: index of that node.
        yfov: vertical field of view [rad].
        aspect_ratio: width by height it was made for, or None [1].
    """

    name: str
    node_name: str
    node: int
    yfov: float
    aspect_ratio: float | None


def read_cameras(document: Document, visible: frozenset[int]) -> tuple[Perspective, ...]:
    """Perspective cameras of the default scene, in the order of their nodes.

    Raises:
        SceneError: a field of view that no camera can have.
    """
    declared = document.items("cameras")
    cameras = []
    for index, node in enumerate(document.items("nodes")):
        number = node.reference("camera", len(declared))
        if number is None or index not in visible:
            continue
        item = declared[number]
        if item.text("type") != "perspective":
            document.warn(
                Note(f"{item.place} is not a perspective camera and is not used", NoteKind.CAMERA)
            )
            continue
        lens = item.child("perspective")
        yfov = lens.number("yfov")
        if not 0.0 < yfov < math.pi:
            raise lens.wrong("yfov", "an angle between 0 and pi")
        aspect = lens.number("aspectRatio") if "aspectRatio" in lens else None
        if aspect is not None and aspect <= 0.0:
            raise lens.wrong("aspectRatio", "a number above 0")
        node_name = node.name
        cameras.append(
            Perspective(
                name=item.name or node_name or f"camera {number}",
                node_name=node_name,
                node=index,
                yfov=yfov,
                aspect_ratio=aspect,
            )
        )
    return tuple(cameras)


def rigid(world: Float64) -> Float64:
    """A node's world matrix (4, 4) without scale and shear: what a camera sees along -Z, Y up.

    Raises:
        SceneError: the node is scaled to zero.
    """
    back, up = world[:3, 2], world[:3, 1]
    z = back / max(float(np.linalg.norm(back)), 1e-300)
    x = np.cross(up, z)
    length = float(np.linalg.norm(x))
    if length == 0.0:
        raise SceneError("its node is scaled to zero; give it a scale")
    x = x / length
    pose = np.eye(4)
    pose[:3, 0], pose[:3, 1], pose[:3, 2], pose[:3, 3] = x, np.cross(z, x), z, world[:3, 3]
    return pose
