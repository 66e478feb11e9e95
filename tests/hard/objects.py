"""GLB files of hard geometry, and frames that go through the whole pipeline."""

from __future__ import annotations

import tempfile
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from support import shots
from support.glb_builder import GlbBuilder

from nlens_video import Compositor
from nlens_video.core.lens_fit import LensFit

SIZE = (shots.WIDTH, shots.HEIGHT)
LENS = LensFit(slope=60.0, intercept=-30.0, width=SIZE[0], height=SIZE[1])  # in focus at 2
PRESETS = ("draft", "realtime", "standard", "reference")


def plate_bgr() -> np.ndarray:
    """The usual plate of `shots`, as OpenCV gives it."""
    return np.ascontiguousarray(shots.plate()[..., ::-1])


@contextmanager
def folder():
    with tempfile.TemporaryDirectory() as name:
        yield Path(name)


def cube(path: Path, *, unit: float = 1.0, at=(0.0, 0.0, -1.6), size=0.35, lamp="sun") -> Path:
    """A cube on the ground, a camera and a lamp (or an unlit cube), all in units of `unit`."""
    builder = GlbBuilder()
    pbr = {"baseColorFactor": [0.8, 0.25, 0.1, 1], "metallicFactor": 0}
    paint = builder.add("materials", {"pbrMetallicRoughness": pbr, "doubleSided": True})
    corners = (shots.CUBE * np.float32(unit)).astype(np.float32)
    place = [float(np.float32(v * unit)) for v in at]
    mesh = builder.mesh(corners, shots.CUBE_FACES, material=paint)
    builder.node(mesh=mesh, translation=place, scale=[size] * 3)
    pose = shots.camera_pose()
    pose[:3, 3] *= unit
    lens = builder.camera(shots.YFOV, name="Plate", aspect=SIZE[0] / SIZE[1])
    builder.node(camera=lens, matrix=pose.T.ravel().tolist())
    if lamp == "none":  # the base colour is the radiance itself
        builder.document["materials"][paint]["extensions"] = {"KHR_materials_unlit": {}}
    elif lamp == "sun":
        builder.light(intensity=2.0, node={"rotation": [-0.5, 0.2, 0.0, 0.84]})
    else:  # a lamp's light falls off with the square of the distance
        there = [0.5 * unit, 1.5 * unit, -0.8 * unit]
        builder.light("point", intensity=6.0 * unit**2, node={"translation": there})
    return builder.write(path)


def composited(glb: Path, preset: str, fit: LensFit | None, frame=None, time=0.0, **more):
    """One frame through the whole pipeline, and the lens that it was made with."""
    frame = plate_bgr() if frame is None else frame
    with Compositor(glb, preset=preset, fit=fit, fps=25, **more) as lens:
        return lens.process(frame, time=time), lens.fit
