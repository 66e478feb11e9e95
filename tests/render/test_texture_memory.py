"""Textures take their levels in memory, and little beside them."""

import subprocess
import sys

import numpy as np
import pytest
from support.glb_builder import QUAD_UV, GlbBuilder
from support.quads import quad, unlit

from nlens_video.render.software.renderer import Rasteriser
from nlens_video.scene.scene import Scene

LEVELS = 2 * 4 / 3  # of 16 bits each, with their halves, by the decoded 8 bits
MEASURE = """
import sys
from pathlib import Path
from nlens_video.render.software.renderer import Rasteriser
from nlens_video.scene.scene import Scene

def peak_bytes():
    return int(Path("/proc/self/status").read_text().split("VmHWM:")[1].split()[0]) << 10

before = peak_bytes()
Rasteriser().moved(Scene.load(Path(sys.argv[1])).pose(0.0))
print(peak_bytes() - before)
"""


def textured(folder, side, count):
    """A file with a quad of each of a few opaque, smooth textures."""
    builder, rng = GlbBuilder(), np.random.default_rng(1)
    for _ in range(count):
        pixels = rng.integers(0, 256, (side // 16, side // 16, 3), np.uint8)
        pixels = pixels.repeat(16, 0).repeat(16, 1)
        texture = builder.texture(pixels, magFilter=9729, minFilter=9987)
        number = unlit(builder, pbr={"baseColorTexture": {"index": texture}})
        quad(builder, number=number, TEXCOORD_0=QUAD_UV)
    path = folder / "textured.glb"
    path.write_bytes(builder.bytes())
    return path


@pytest.mark.skipif(
    sys.platform != "linux",
    reason="a process reads its own peak of memory off /proc, which Linux alone has",
)
def test_textures_take_their_levels_and_a_picture_more(tmp_path):
    side, count = 2048, 8
    command = [sys.executable, "-c", MEASURE, str(textured(tmp_path, side, count))]
    run = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert run.returncode == 0, run.stderr
    assert int(run.stdout) / (count * 4 * side**2) < LEVELS + 0.5


def test_another_renderer_of_the_scene_has_the_same_textures(tmp_path):
    scene = Scene.load(textured(tmp_path, 256, 2))
    first, second = (Rasteriser().moved(scene.pose(0.0)).paint[-1] for _ in range(2))
    for one, other in zip(first, second, strict=True):
        np.testing.assert_array_equal(one, other)
