"""Normal maps on stretched, skewed and mirrored texture coordinates, against MikkTSpace's frame."""

import math

import numpy as np
import pytest
from support.glb_builder import QUAD, QUAD_UV, GlbBuilder
from support.quads import camera_at, draw, material, quad

from nlens_video.render.opengl.object_renderer import PyrenderObjectRenderer
from nlens_video.render.software.renderer import SoftwareObjectRenderer

SUN = np.array([0.5, 0.6, 1.0]) / np.linalg.norm([0.5, 0.6, 1.0])
BUMPS = [(0.5, 0.0, 1.0), (0.0, 0.5, 1.0), (-0.4, 0.5, 1.0)]


@pytest.fixture(params=[pytest.param("opengl", marks=pytest.mark.needs_gl), "software"])
def renderer_class(request):
    """Every test of this file is one of each renderer."""
    return {"opengl": PyrenderObjectRenderer, "software": SoftwareObjectRenderer}[request.param]


def toward(direction):
    """A node turned so that its light comes from a direction."""
    axis = np.cross([0.0, 0.0, 1.0], direction)
    turn = np.array([*axis, 1.0 + direction[2]])
    return {"rotation": (turn / np.linalg.norm(turn)).tolist()}


def facing(renderer_class, folder, bump, uv):
    """Cosine of a normal-mapped quad's normal to the sun, and the map's unit normal."""
    builder = GlbBuilder()
    texel = np.round((np.array(bump) / np.linalg.norm(bump) * 0.5 + 0.5) * 255).astype(np.uint8)
    info = {"index": builder.texture(np.tile(texel[None, None], (4, 4, 1)))}
    number = material(builder, normalTexture=info)
    quad(builder, number=number, TEXCOORD_0=uv.astype(np.float32))
    builder.light(intensity=math.pi, node=toward(SUN))
    layer = draw(renderer_class, builder, folder, camera_at(1000.0))
    normal = texel / 255 * 2 - 1
    return layer.rgba[32 - layer.box.y0, 32 - layer.box.x0, 0], normal / np.linalg.norm(normal)


def mikktspace(uv):
    """Tangent and bitangent (3,) of a quad in the plane of x and y; v grows downwards."""
    edges, changes = QUAD[1:3] - QUAD[0], uv[1:3] - uv[0]
    tangent = np.linalg.solve(changes, edges)[0]
    tangent /= np.linalg.norm(tangent)
    side = np.sign(np.linalg.det(changes * [1, -1]) * np.linalg.det(edges[:, :2]))
    return tangent, side * np.cross([0.0, 0.0, 1.0], tangent)


@pytest.mark.parametrize("bump", BUMPS)
@pytest.mark.parametrize(
    "mapping",
    [
        [[4, 0], [0, 1]],
        [[1, 0], [0, 10]],
        [[-3, 0], [0, 1]],  # mirrored
        [[0, 2], [-1, 0]],  # turned by a quarter
        [[1, 0.8], [0, 1]],  # u changes along y too
        [[1, 0], [1.5, 2]],  # v changes along x too
    ],
)
def test_normal_map_tilts_by_its_texels_however_coordinates_are_stretched(
    renderer_class, tmp_path, bump, mapping
):
    uv = QUAD_UV @ np.array(mapping).T
    tangent, bitangent = mikktspace(uv)
    found, normal = facing(renderer_class, tmp_path, bump, uv)
    tilted = normal[0] * tangent + normal[1] * bitangent + normal[2] * np.array([0.0, 0.0, 1.0])
    assert found == pytest.approx(tilted @ SUN, abs=4e-3)


@pytest.mark.parametrize("along", [[1, 0], [0, 1], [0, 0]])
def test_coordinates_that_change_in_one_direction_only_tilt_nothing(
    renderer_class, tmp_path, along
):
    found, _ = facing(renderer_class, tmp_path, BUMPS[2], QUAD_UV * along)
    assert found == pytest.approx(SUN[2], abs=4e-3)
