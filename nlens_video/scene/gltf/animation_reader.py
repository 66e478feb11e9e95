"""Reader of animations: channels of nodes, and of pointers into the file.

KHR_animation_pointer names what a channel animates by its path in the file's JSON. Played are a
camera's vertical field of view, and nodes as other channels move them.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from dataclasses import dataclass, field

import numpy as np

from nlens_video.core.errors import SceneError
from nlens_video.scene.gltf.accessors import AccessorReader
from nlens_video.scene.gltf.animation_kernels import CUBIC, LINEAR, STEP
from nlens_video.scene.gltf.animations import Animations, AnimationTrack, TrackKey
from nlens_video.scene.gltf.document import Document
from nlens_video.scene.gltf.fields import Fields
from nlens_video.scene.gltf.nodes import Hierarchy, normalized
from nlens_video.scene.gltf.writer import POINTER

_WIDTHS = {"translation": 3, "rotation": 4, "scale": 3, "yfov": 1}
_NODE_PATHS = ("translation", "rotation", "scale", "weights")
_KINDS = {"STEP": STEP, "LINEAR": LINEAR, "CUBICSPLINE": CUBIC}
_POINTER = re.compile(
    r"/nodes/(?P<node>\d{1,9})/(?P<path>translation|rotation|scale|weights)"
    r"|/cameras/(?P<camera>\d{1,9})/perspective/yfov"
)


def read_animations(
    document: Document, accessors: AccessorReader, hierarchy: Hierarchy, morphs: dict[int, int]
) -> Animations:
    """All animations of the file.

    Args:
        document: the file.
        accessors: its accessors.
        hierarchy: its nodes.
        morphs: number of morph targets by node.

    Raises:
        SceneError: key times that do not increase, or values that do not fit them.
    """
    reader = _TrackReader(document, accessors, hierarchy, morphs)
    items = document.items("animations")
    return Animations(
        names=tuple(item.name for item in items),
        clips=tuple(reader.clip(item) for item in items),
    )


@dataclass(slots=True)
class _TrackReader:
    document: Document
    accessors: AccessorReader
    hierarchy: Hierarchy
    morphs: dict[int, int]
    _times: dict[int, tuple[float, ...]] = field(default_factory=dict)

    def clip(self, clip: Fields) -> dict[TrackKey, AnimationTrack]:
        """An animation's tracks by node and property."""
        samplers = clip.children("samplers")
        tracks: dict[TrackKey, AnimationTrack] = {}
        unplayed: Counter[str] = Counter()
        examples: dict[str, str] = {}
        for channel in clip.children("channels"):
            node, path = self._target(channel.child("target"))
            fault = self._fault(node, path)
            if fault or node is None:
                unplayed[fault] += 1
                examples.setdefault(fault, "" if node is not None else f", such as '{path[:60]}'")
                continue
            sampler = samplers[channel.integer("sampler", below=len(samplers))]
            width = self.morphs[node] if path == "weights" else _WIDTHS[path]
            tracks[node, path] = self._track(sampler, node, path, width)
        for fault, count in unplayed.items():
            self.document.warn(
                f"{clip.place}: {count} channels are not played: {fault}{examples[fault]}"
            )
        return tracks

    def _target(self, target: Fields) -> tuple[int | None, str]:
        """Index and property of the node or camera that a channel animates; no index for others."""
        path, nodes = target.text("path"), len(self.hierarchy.has_matrix)
        pointer = target.extension(POINTER)
        if path != "pointer" or pointer is None:
            node = target.reference("node", nodes)
            return (node if path in _NODE_PATHS else None), path
        named = _POINTER.fullmatch(pointer.text("pointer"))
        if named is None:
            return None, pointer.text("pointer")
        if named["camera"] is None:
            node = int(named["node"])
            if node >= nodes:
                raise pointer.wrong("pointer", f"a node below {nodes}")
            return node, named["path"]
        cameras, camera = self.document.items("cameras"), int(named["camera"])
        if camera >= len(cameras):
            raise pointer.wrong("pointer", f"a camera below {len(cameras)}")
        return camera, "yfov"

    def _fault(self, node: int | None, path: str) -> str:
        """Why a channel is not played, empty where it is."""
        if path == "yfov" and node is not None:
            return ""
        if node is None:
            return "they animate neither nodes nor a camera's field of view"
        if path == "weights" and not self.morphs.get(node):
            return "they animate weights of a node that is not drawn or has no morph targets"
        if path != "weights" and self.hierarchy.has_matrix[node]:
            return "they animate a node with a matrix"
        return ""

    def _track(self, sampler: Fields, node: int, path: str, width: int) -> AnimationTrack:
        kind = _KINDS[sampler.choice("interpolation", _KINDS, "LINEAR")]
        times = self._key_times(sampler)
        output = sampler.integer("output", below=self.accessors.count)
        self.document.spend(2 * 8 * 3 * len(times) * width, sampler.place)
        flat = self.accessors.floats(output, 1 if path == "weights" else width)
        per_key = 3 if kind == CUBIC else 1
        if flat.size != len(times) * per_key * width:
            raise SceneError(
                f"{sampler.place}.output has {flat.size} numbers, expected "
                f"{len(times) * per_key * width} for {len(times)} keys; export the file again"
            )
        keys = flat.astype(np.float64).reshape(len(times), per_key, width)
        if per_key == 1:
            zero = np.zeros_like(keys)
            keys = np.concatenate([zero, keys, zero], axis=1)
        if path == "yfov" and not ((keys[:, 1] > 0.0) & (keys[:, 1] < math.pi)).all():
            raise SceneError(
                f"{sampler.place}.output holds fields of view that are no angles between 0 and pi; "
                "export the file again"
            )
        if path == "rotation" and per_key == 1:
            keys[:, 1] = normalized(keys[:, 1])
        return AnimationTrack(node, path, kind, times, keys)

    def _key_times(self, sampler: Fields) -> tuple[float, ...]:
        index = sampler.integer("input", below=self.accessors.count)
        if index not in self._times:
            self.document.spend(48 * self.accessors.length(index), sampler.place)
            times = self.accessors.floats(index, 1)[:, 0].astype(np.float64)
            if (np.diff(times) <= 0.0).any() or times[0] < 0.0:
                raise SceneError(
                    f"{sampler.place}.input holds times that do not increase from 0; export again"
                )
            self._times[index] = tuple(times.tolist())
        return self._times[index]
