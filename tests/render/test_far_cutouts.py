"""Textures that cut or blend keep what they show of a thing when it is far away."""

import cv2
import numpy as np
import pytest
from support.glb_builder import QUAD_UV, GlbBuilder
from support.quads import camera_at, draw, quad, unlit

from nlens_video.core.color import transfer
from nlens_video.render.base.mipmaps import mipmaps
from nlens_video.render.opengl.object_renderer import PyrenderObjectRenderer
from nlens_video.render.software.renderer import SoftwareObjectRenderer
from nlens_video.scene.gltf.textures import Image, Picture

GREEN = np.array([60, 160, 40], np.uint8)
SMOOTH = {"magFilter": 9729, "minFilter": 9987}


@pytest.fixture(params=[pytest.param("opengl", marks=pytest.mark.needs_gl), "software"])
def renderer_class(request):
    """The tests of pictures are ones of each renderer."""
    return {"opengl": PyrenderObjectRenderer, "software": SoftwareObjectRenderer}[request.param]


def linear(codes):
    return transfer("iec61966-2-1").to_linear(np.asarray(codes) / 255.0)


def leaves():
    """Strokes of green, RGBA (512, 512, 4), black where alpha is 0."""
    rng = np.random.default_rng(1)
    alpha = np.zeros((512, 512), np.uint8)
    for _ in range(300):
        start, way = rng.integers(0, 512, 2), rng.normal(size=2)
        end = start + 40.0 * way / np.linalg.norm(way)
        cv2.line(alpha, start.tolist(), end.astype(int).tolist(), 255, 3)
    return np.dstack([GREEN * (alpha[..., None] > 0), alpha])


@pytest.mark.parametrize("alpha", [{"alphaMode": "MASK"}, {"alphaMode": "BLEND"}])
@pytest.mark.parametrize("size", [400, 100, 64, 40, 20])
def test_far_leaves_keep_their_share_and_their_colour(renderer_class, tmp_path, size, alpha):
    builder = GlbBuilder()
    pixels = leaves()
    info = {"index": builder.texture(pixels, **SMOOTH)}
    number = unlit(builder, pbr={"baseColorTexture": info}, **alpha)
    quad(builder, number=number, TEXCOORD_0=QUAD_UV)
    camera = camera_at(4.0, size + 16, size + 16, fx=2.0 * size, fy=2.0 * size)
    layer = draw(renderer_class, builder, tmp_path, camera)
    total = layer.rgba.sum(axis=(0, 1), dtype=np.float64)
    share = (pixels[..., 3] > 127).mean()
    assert total[3] / size**2 == pytest.approx(share, rel=0.25)
    np.testing.assert_allclose(total[:3] / total[3], linear(GREEN), rtol=0.02)


def level(pixels, number, **image):
    picture = Picture(lambda: np.array(pixels, np.uint8))
    rgba = mipmaps(Image(picture=picture, srgb=True, **image))[number]
    return rgba / 65535.0


@pytest.mark.parametrize("cutoff", [0.0, 0.4])
def test_colours_count_by_their_alpha_where_it_tells_what_is_seen(cutoff):
    red, green = [200, 0, 0, 255], [0, 100, 0, 51]
    last = level([[red, green]], -1, cutoff=cutoff)[0, 0]
    expected = (linear(red[:3]) + 0.2 * linear(green[:3])) / 1.2
    np.testing.assert_allclose(last[:3], expected, atol=1e-4)


def test_colours_count_alike_where_alpha_tells_nothing():
    red, green = [200, 0, 0, 255], [0, 100, 0, 51]
    expected = 0.5 * (linear(red[:3]) + linear(green[:3]))
    np.testing.assert_allclose(level([[red, green]], -1)[0, 0, :3], expected, atol=1e-4)


def test_unseen_texels_take_the_colours_around_them():
    pixels = np.zeros((8, 8, 4), np.uint8)
    pixels[:, :3] = *GREEN, 255
    first = level(pixels, 0, cutoff=0.0)
    np.testing.assert_allclose(first[..., :3] - linear(GREEN), 0.0, atol=1e-3)
    np.testing.assert_array_equal(first[..., 3] * 255, pixels[..., 3])


@pytest.mark.parametrize("alpha", [0, 140, 255])
def test_texture_of_one_alpha_is_cut_on_every_level_as_on_the_first(alpha):
    pixels = np.full((8, 8, 4), alpha, np.uint8)
    for number in range(4):
        seen = level(pixels, number, cutoff=0.5)[..., 3]
        assert (seen >= 0.5).all() if alpha > 127 else (seen < 0.5).all()


def test_solid_parts_stay_solid_where_others_are_thin():
    pixels = np.zeros((64, 64, 4), np.uint8)
    pixels[:, :32, 3] = 255  # half is solid
    pixels[:, 40::8, 3] = 255  # and strands of a texel beside it
    for number in range(4):
        seen = level(pixels, number, cutoff=0.5)[..., 3]
        assert (seen[:, : seen.shape[1] // 2 - 1] == 1.0).all()
