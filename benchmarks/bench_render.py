"""Time what a frame's object costs, in CPU time of all threads, by both renderers in turn.

Run: python benchmarks/bench_render.py. Each figure is the least of many rounds: CPU time depends
less on what else the machine does than the clock's, yet caches are shared. The ratio says most.

The object is a bumpy ellipsoid of 200x400 px on a frame of 960x512: textured, carried by 24 joints
and lit by three lamps.
"""

from __future__ import annotations

import argparse
import math
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import PIL.Image

from nlens_video.core.layers import Float32
from nlens_video.render.opengl.object_renderer import PyrenderObjectRenderer
from nlens_video.render.software.renderer import SoftwareObjectRenderer
from nlens_video.scene import Camera, Scene
from nlens_video.scene.gltf.writer import GlbWriter

WIDTH, HEIGHT = 960, 512
JOINTS = 24
RADII = (0.5, 1.0, 0.5)


def ellipsoid(triangles: int) -> tuple[Float32, Float32, Float32, np.typing.NDArray[np.uint32]]:
    """Positions (V, 3), normals (V, 3), texture coordinates (V, 2) and faces (F, 3)."""
    rows = max(4, round(math.sqrt(triangles / 4)))
    columns = 2 * rows
    v, u = np.meshgrid(np.linspace(0, 1, rows + 1), np.linspace(0, 1, columns + 1), indexing="ij")
    around, down = 2 * math.pi * u, math.pi * v
    radius = 1.0 + 0.03 * np.sin(9 * around) * np.sin(8 * down)
    unit = np.stack(
        [np.sin(down) * np.cos(around), np.cos(down), -np.sin(down) * np.sin(around)], -1
    )
    positions = (radius[..., None] * unit * RADII).reshape(-1, 3)
    normals = (unit / RADII).reshape(-1, 3)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    a = (np.arange(rows)[:, None] * (columns + 1) + np.arange(columns)).ravel()
    b = a + columns + 1
    faces = np.concatenate([np.stack([a, b, a + 1], 1), np.stack([a + 1, b, b + 1], 1)])
    uv = np.stack([2 * u, v], -1).reshape(-1, 2)
    return (
        positions.astype(np.float32), normals.astype(np.float32), uv.astype(np.float32),
        faces.astype(np.uint32),
    )  # fmt: skip


def write_glb(path: Path, triangles: int, alpha_mode: str = "OPAQUE") -> Path:
    """The ellipsoid, carried by joints that sway, with three lamps."""
    positions, normals, uv, faces = ellipsoid(triangles)
    glb = GlbWriter()
    place = (positions[:, 1] / RADII[1] + 1.0) * 0.5 * (JOINTS - 1)
    first = np.clip(np.floor(place), 0, JOINTS - 2)
    part = np.clip(place - first, 0.0, 1.0)
    heights = np.linspace(-RADII[1], RADII[1], JOINTS)
    bind = np.tile(np.eye(4), (JOINTS, 1, 1))
    bind[:, 1, 3] = -heights
    coarse = np.random.default_rng(0).integers(60, 220, (64, 64, 3), np.uint8)
    fine = PIL.Image.fromarray(coarse).resize((1024, 1024), PIL.Image.Resampling.BICUBIC)
    paint = {
        "pbrMetallicRoughness": {
            "baseColorTexture": {"index": glb.texture(np.asarray(fine))},
            "metallicFactor": 0.1, "roughnessFactor": 0.5,
        },
        "alphaMode": alpha_mode,
    }  # fmt: skip
    primitive = {
        "attributes": {
            "POSITION": glb.accessor(positions),
            "NORMAL": glb.accessor(normals),
            "TEXCOORD_0": glb.accessor(uv),
            "JOINTS_0": glb.accessor(
                np.stack([first, first + 1, 0 * first, 0 * first], 1).astype(np.uint8)
            ),
            "WEIGHTS_0": glb.accessor(np.stack([1 - part, part, 0 * part, 0 * part], 1)),
        },
        "indices": glb.accessor(faces.ravel()),
        "material": glb.add("materials", paint),
    }
    joints = [glb.node(translation=[0.0, float(height), 0.0]) for height in heights]
    mesh = glb.add("meshes", {"primitives": [primitive]})
    glb.node(mesh=mesh, skin=glb.skin(joints, bind))
    times = glb.accessor(np.array([0, 5, 10], np.float32))
    samplers, channels = [], []
    for number, joint in enumerate(joints):
        keys = np.zeros((3, 3))
        keys[:, 0] = 0.05 * np.sin([number, number + 2.0, number])
        keys[:, 1] = heights[number]
        samplers.append({"input": times, "output": glb.accessor(keys)})
        target = {"node": joint, "path": "translation"}
        channels.append({"sampler": number, "target": target})
    glb.add("animations", {"samplers": samplers, "channels": channels})
    for number in range(3):
        turn = [-0.3, 0.5 * (number - 1), 0.0, math.sqrt(1 - 0.09 - 0.25 * (number - 1) ** 2)]
        glb.light(node={"rotation": turn}, intensity=2.0 - 0.5 * number)
    return glb.write(path)


def camera() -> Camera:
    """A camera that sees the ellipsoid 200x400 px large."""
    pose = np.eye(4)
    pose[2, 3] = 6.0
    return Camera(
        world_from_camera=pose, fx=1200, fy=1200, cx=480, cy=256, width=WIDTH, height=HEIGHT
    )


def cpu_ms(work: Callable[[int], object], rounds: int) -> float:
    """The least CPU time of all threads that a round takes, after two to warm up [ms]."""
    times = []
    for number in range(rounds + 2):
        start = time.process_time()
        work(number)
        times.append(time.process_time() - start)
    return 1e3 * min(times[2:])


def main() -> None:
    """Print one line a mesh: the pose, then a frame by each renderer, in turn."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--rounds", type=int, default=20)
    rounds = parser.parse_args().rounds
    print("triangles  vertices  pose [ms]  software [ms]  OpenGL [ms]  ratio  at rest [ms]")
    view = camera()
    for triangles in (5_000, 20_000, 50_000):
        with tempfile.TemporaryDirectory() as folder:
            scene = Scene.load(write_glb(Path(folder) / "ellipsoid.glb", triangles))
        posed = scene.pose(0.0)
        pose = cpu_ms(lambda n, scene=scene: scene.pose(0.1 + 0.01 * n), rounds)
        with SoftwareObjectRenderer(scene) as ours, PyrenderObjectRenderer(scene) as theirs:
            least = [math.inf, math.inf]
            for block in range(4):  # in turn, so that both meet the same machine
                for at, renderer in enumerate((ours, theirs)):
                    spent = cpu_ms(
                        lambda n, r=renderer, b=block: r.render(b + 0.01 * n, view), rounds // 4
                    )
                    least[at] = min(least[at], spent)
            rest = cpu_ms(lambda _, r=ours: r.render(0.5, view), rounds)
        print(
            f"{len(posed.meshes[0].faces):9}  {len(posed.vertices()):8}  {pose:9.2f}  "
            f"{least[0]:13.1f}  {least[1]:11.1f}  {least[1] / least[0]:5.1f}  {rest:12.2f}"
        )


if __name__ == "__main__":
    main()
