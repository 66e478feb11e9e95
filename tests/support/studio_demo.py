"""The sample plate and its object as a shot of the studio, placed by hand."""

from __future__ import annotations

import json
import shutil
import struct
from pathlib import Path

from support.folders import ROOT

SHOT = """\
version = 1
[plate]
file = "in.mp4"
[object]
file = "object.glb"
[place]
at = [0.55, 0.76]
size = 0.36
yaw = 20
[camera]
horizon = 0.15
[output]
file = "out.mp4"
"""


def demo_shot(folder: Path) -> Path:
    """Plate, object and shot file in a folder; returns the shot file."""
    shutil.copy(ROOT / "samples" / "in.mp4", folder)
    (folder / "object.glb").write_bytes(_without_camera(ROOT / "samples" / "anim.glb"))
    (folder / "shot.toml").write_text(SHOT)
    return folder / "shot.toml"


def _without_camera(path: Path) -> bytes:
    """A GLB without its cameras."""
    data = path.read_bytes()
    (length,) = struct.unpack_from("<I", data, 12)
    scene = json.loads(data[20 : 20 + length])
    scene.pop("cameras", None)
    for node in scene["nodes"]:
        node.pop("camera", None)
    text = json.dumps(scene).encode()
    text += b" " * (-len(text) % 4)
    rest = data[20 + length :]
    head = struct.pack("<4sIIII", b"glTF", 2, 20 + len(text) + len(rest), len(text), 0x4E4F534A)
    return head + text + rest
