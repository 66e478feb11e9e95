"""Textures on surfaces that are seen at a slant: sharp along one axis, filtered along the other."""

import cv2
import numpy as np
import pytest
from support.glb_builder import QUAD, QUAD_UV, GlbBuilder
from support.quads import camera_at, draw, quad, unlit

from nlens_video.render.opengl.object_renderer import PyrenderObjectRenderer
from nlens_video.render.software.renderer import SoftwareObjectRenderer

SIZE = (160, 64)


def slanted_card(turn_deg):
    """An unlit card with smooth noise, turned in its plane and then tilted by 75 degrees."""
    rng = np.random.default_rng(1)
    noise = rng.integers(0, 256, (64, 64, 3), np.uint8)
    noise = cv2.resize(noise, (512, 512), interpolation=cv2.INTER_CUBIC)
    builder = GlbBuilder()
    paint = {"index": builder.texture(noise, magFilter=9729, minFilter=9987)}
    card = unlit(builder, pbr={"baseColorTexture": paint})
    tilt, turn = np.radians([-75.0, turn_deg]) / 2
    (s, c), (z, w) = (np.sin(tilt), np.cos(tilt)), (np.sin(turn), np.cos(turn))
    node = {"rotation": [s * w, -s * z, c * z, c * w]}
    quad(builder, 4 * QUAD, card, node, TEXCOORD_0=QUAD_UV)
    return builder


def picture(renderer, builder, folder, zoom):
    """What a renderer draws, reduced by area to the size without the zoom (H, W, 4)."""
    width, height = SIZE[0] * zoom, SIZE[1] * zoom
    layer = draw(
        renderer, builder, folder, camera_at(6.0, width, height, fx=120.0 * zoom, fy=120.0 * zoom)
    )
    whole = np.zeros((height, width, 4), np.float32)
    whole[layer.box.y0 : layer.box.y1, layer.box.x0 : layer.box.x1] = layer.rgba
    return cv2.resize(whole, SIZE, interpolation=cv2.INTER_AREA)


@pytest.mark.parametrize("turn_deg", [0.0, 30.0, 45.0])
@pytest.mark.parametrize(
    "renderer, most",
    [
        (SoftwareObjectRenderer, 0.08),
        # the driver chooses where it reads
        pytest.param(PyrenderObjectRenderer, 0.2, marks=pytest.mark.needs_gl),
    ],
)
def test_texture_on_a_slanted_card_is_its_mean_over_each_pixel(tmp_path, renderer, most, turn_deg):
    card = slanted_card(turn_deg)
    seen, exact = (picture(renderer, card, tmp_path, zoom) for zoom in (1, 12))
    inside = cv2.erode((exact[..., 3] > 0.999).astype(np.uint8), np.ones((3, 3))) > 0
    assert inside.sum() > 5000
    off = np.sqrt(np.mean((seen - exact)[inside] ** 2))
    assert off < most * exact[inside][:, :3].std()
