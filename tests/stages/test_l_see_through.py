"""Depth order where light comes through the nearer surface: each surface has its own blur."""

import numpy as np
import pytest
from support.glb_builder import QUAD, QUAD_UV, GlbBuilder
from support.quads import camera_at, quad, unlit

from nlens_video.core.layers import Box
from nlens_video.core.lens_fit import LensFit
from nlens_video.kernels.scatter.scatter import blur_reach, scatter
from nlens_video.render.opengl.object_renderer import PyrenderObjectRenderer
from nlens_video.render.software.renderer import SoftwareObjectRenderer
from nlens_video.scene import Scene
from nlens_video.stages.l_depth_order import RepairDepthOrder
from nlens_video.stages.l_reblur import ReblurLayer, depth_peel, object_coc

WIDTH, HEIGHT = 160, 120
FRAME = Box(0, 0, WIDTH, HEIGHT)
CAMERA = camera_at(4.0, WIDTH, HEIGHT)
NEAR, FAR, FARTHEST = 3.0, 4.0, 4.5
FIT = LensFit(slope=200.0, intercept=-50.0, width=WIDTH, height=HEIGHT)  # focused at `FAR`
INSIDE = (slice(40, 80), slice(55, 105))  # of both cards, a disc away from their edges
SCATTER = ReblurLayer(scatter=scatter, reach=blur_reach)


def unasked(geometry):
    raise AssertionError("the network is not asked where it is known what is hidden")


REPAIR = RepairDepthOrder(network=unasked, scatter=scatter, reach=blur_reach)


def add_card(builder, depth, *, half, **fields):
    """A card of so many pixels each way around the middle of the frame."""
    size = half * depth / (20.0 * 4.0)
    corners = QUAD * np.array([size[0], size[1], 1.0]) + [0.0, 0.0, 4.0 - depth]
    quad(builder, corners.astype(np.float32), unlit(builder, **fields), TEXCOORD_0=QUAD_UV)


def add_bars(builder):
    """In focus: bars of two pixels in two colours."""
    pixels = np.zeros((4, 64, 3), np.uint8)
    pixels[:, ::2], pixels[:, 1::2] = (230, 120, 60), (20, 60, 120)
    texture = {"baseColorTexture": {"index": builder.texture(pixels, magFilter=9728)}}
    add_card(builder, FAR, half=np.array([64.0, 48.0]), pbr=texture)


def add_pane(builder, alpha, depth=NEAR):
    color = (0.02, 0.3, 0.05, alpha)
    add_card(builder, depth, half=np.array([50.0, 40.0]), color=color, alphaMode="BLEND")


@pytest.fixture(params=[pytest.param("opengl", marks=pytest.mark.needs_gl), "software"])
def seen(tmp_path, request):
    """What the lens sees of what functions add to a file; (H, W, 4)."""
    kind = {"opengl": PyrenderObjectRenderer, "software": SoftwareObjectRenderer}[request.param]

    def look(*added):
        builder = GlbBuilder()
        for add in added:
            add(builder)
        with kind(Scene.load(builder.write(tmp_path / "a.glb"))) as renderer:
            sharp = object_coc(renderer.render(0.0, CAMERA, 30), FIT)
            sharp = depth_peel(sharp, FIT, FARTHEST, renderer)
            blurred = REPAIR(sharp, SCATTER(sharp, FRAME))
        out = np.zeros((HEIGHT, WIDTH, 4), np.float32)
        out[blurred.box.slices_in(FRAME)] = blurred.rgba
        return out

    return look


def over(near, far):
    return near + (1.0 - near[..., 3:]) * far


@pytest.mark.parametrize("alpha", [1 / 255, 0.1, 0.5, 0.9])
def test_what_is_seen_through_a_pane_keeps_its_own_blur(seen, alpha):
    def pane(builder):
        add_pane(builder, alpha)

    found, expected = seen(add_bars, pane), over(seen(pane), seen(add_bars))
    assert expected[INSIDE][..., 0].std() > 0.02
    assert found[INSIDE] == pytest.approx(expected[INSIDE], abs=2e-3)
    assert np.abs(found - expected).max() < 0.03  # at the edges of the pane, too


def test_pane_with_an_opaque_frame_has_its_own_blur_in_both(seen):
    """The frame of a window is before the pane; what it hides is not seen, the rest is."""

    def window(builder):
        add_pane(builder, 0.2)
        side = QUAD * np.array([0.1, 1.5, 1.0]) + [-1.8, 0.0, 4.0 - NEAR]
        quad(builder, side.astype(np.float32), unlit(builder, color=(0.6, 0.6, 0.6, 1.0)))

    found, expected = seen(add_bars, window), over(seen(window), seen(add_bars))
    assert np.sqrt(((found - expected) ** 2).mean()) < 5e-3


def test_two_panes_before_each_other_let_the_sharp_card_through(seen):
    def panes(builder):
        add_pane(builder, 0.3, 3.1)
        add_pane(builder, 0.4, NEAR)

    found = seen(add_bars, panes)[INSIDE][..., 0]
    bars = seen(add_bars)[INSIDE][..., 0]
    assert found.std() == pytest.approx(0.7 * 0.6 * bars.std(), rel=0.02)
