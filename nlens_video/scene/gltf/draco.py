"""Draco: meshes of KHR_draco_mesh_compression, decoded in a process of their own.

The decoder is native code that trusts its input: there it can neither crash this process nor take
its memory. All of a file's meshes are decoded at once, because a process takes long to start.
"""

from __future__ import annotations

import importlib.util
import io
import subprocess
import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from nlens_video.core.errors import SceneError
from nlens_video.scene.gltf.accessors import AccessorReader
from nlens_video.scene.gltf.document import DECODE_FIRST, Document
from nlens_video.scene.gltf.fields import Fields

EXTENSION = "KHR_draco_mesh_compression"
_SECONDS = 120
_TRIANGLES = 4


@dataclass(slots=True)
class DracoReader:
    """Hands the document's Draco meshes to its accessors.

    Attributes:
        document: the file.
        accessors: its accessors; those of a Draco mesh have no buffer view.
    """

    document: Document
    accessors: AccessorReader
    _decoded: dict[str, npt.NDArray[Any]] | None = field(default=None)

    def provide(self, primitive: Fields, compressed: Fields) -> None:
        """Give the accessors of a primitive their values.

        Raises:
            SceneError: no decoder, broken data, or an attribute that it does not hold.
        """
        if primitive.integer("mode", default=_TRIANGLES) != _TRIANGLES:
            raise primitive.wrong("mode", "triangles (4), as Draco holds them")
        if self._decoded is None:
            self._decoded = self._decode()
        view = compressed.integer("bufferView", below=len(self.document.items("bufferViews")))
        attributes, ids = primitive.child("attributes"), compressed.child("attributes")
        for name in ids.data:
            self._give(attributes, name, f"{view}/{ids.integer(name)}", compressed)
        if "indices" in primitive:
            self._give(primitive, "indices", f"{view}/faces", compressed)

    def _give(self, owner: Fields, name: str, key: str, compressed: Fields) -> None:
        values = (self._decoded or {}).get(key)
        if values is None:
            raise SceneError(f"{compressed.place} holds no {name[:40]}; {DECODE_FIRST}")
        index = owner.integer(name, below=self.accessors.count)
        self.accessors.provide(index, values)

    def _decode(self) -> dict[str, npt.NDArray[Any]]:
        if importlib.util.find_spec("DracoPy") is None:
            raise SceneError(
                f"its meshes are compressed ({EXTENSION}) and the decoder is not installed: "
                f"pip install nlens-video[draco]; or {DECODE_FIRST}"
            )
        packed = io.BytesIO()
        np.savez(packed, **self._views())  # type: ignore[arg-type]  # the names are ours
        # By its path, so that it need not load this package.
        command = [sys.executable, "-P", str(Path(__file__).with_name("draco_worker.py"))]
        try:
            run = subprocess.run(
                command, input=packed.getvalue(), capture_output=True, timeout=_SECONDS, check=False
            )
        except (OSError, subprocess.TimeoutExpired) as error:
            raise SceneError(f"its Draco meshes cannot be decoded ({error})") from error
        if run.returncode != 0:
            raise SceneError(f"its Draco meshes are broken or too large; {DECODE_FIRST}")
        with np.load(io.BytesIO(run.stdout), allow_pickle=False) as found:
            return {name: found[name] for name in found.files}

    def _views(self) -> dict[str, npt.NDArray[np.uint8]]:
        views: dict[str, npt.NDArray[np.uint8]] = {}
        count = len(self.document.items("bufferViews"))
        for mesh in self.document.items("meshes"):
            for primitive in mesh.children("primitives"):
                compressed = primitive.extension(EXTENSION)
                if compressed is not None:
                    view = compressed.integer("bufferView", below=count)
                    if str(view) not in views:
                        data = self.document.buffer_view(view)
                        self.document.spend(len(data), compressed.place)
                        views[str(view)] = np.frombuffer(data, np.uint8)
        return views
