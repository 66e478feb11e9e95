"""Light of colours beyond BT.709 is negative in a channel, and stays so."""

import numpy as np
import pytest

from nlens_video.core.layers import (
    BlurredLayer,
    Box,
    DefocusedLayer,
    HiddenLayer,
    ObjectLayer,
)
from nlens_video.core.optics import Aberration
from nlens_video.effects.camera.chromatic_aberration import displace_channels
from nlens_video.kernels.scatter.scatter import blur_reach, scatter
from nlens_video.stages.l_depth_order import RepairDepthOrder
from nlens_video.stages.l_reblur import ReblurLayer

FRAME = Box(0, 0, 160, 120)
COLOUR = np.float32([-0.2, 0.6, 0.1, 1.0])


class Black:
    """A plate without light."""

    def linear(self, box):
        return np.zeros((box.height, box.width, 3), np.float32)


def no_network(geometry):
    raise AssertionError("what lies behind is known: nothing is left to judge")


def test_depth_order_leaves_colours_of_negative_red_as_they_are():
    rgba = np.zeros((FRAME.height, FRAME.width, 4), np.float32)
    coc = np.zeros(rgba.shape[:2], np.float32)
    rgba[20:100, 20:140], coc[20:100, 20:140] = COLOUR, -4.0
    rgba[30:90, 70:90], coc[30:90, 70:90] = (-0.2, 0.1, 0.6, 1.0), 14.0
    near = coc > 0.0
    behind = HiddenLayer(
        box=FRAME, rgba=COLOUR * near[..., None], coc_px=np.float32(-4.0) * near, front_rgba=rgba
    )
    layer = ObjectLayer(box=FRAME, rgba=rgba, depth=np.ones_like(coc))
    sharp = DefocusedLayer(layer=layer, coc_px=coc, behind=behind)
    before = ReblurLayer(scatter=scatter, reach=blur_reach)(sharp, FRAME)
    after = RepairDepthOrder(network=no_network, scatter=scatter, reach=blur_reach)(sharp, before)
    assert np.abs(after.rgba - before.rgba).max() > 0.05
    red, alpha = after.rgba[..., 0], after.rgba[..., 3]
    assert red == pytest.approx(-0.2 * alpha, abs=1e-5)
    assert 0.0 <= alpha.min() and alpha.max() <= 1.0


def test_chromatic_aberration_keeps_negative_red_and_makes_none_of_its_own():
    rgba = np.zeros((FRAME.height, FRAME.width, 4), np.float32)
    rgba[20:100, 20:140] = COLOUR
    aberration = Aberration(red=(1.5, 0.5), blue=(-1.5, 0.0))
    layer = BlurredLayer(box=FRAME, rgba=rgba)
    red = displace_channels(layer, aberration, Black(), FRAME).rgba[..., 0]
    assert red[26:94, 26:134] == pytest.approx(-0.2, abs=1e-5)
    bright = BlurredLayer(box=FRAME, rgba=np.abs(rgba))
    mirrored = displace_channels(bright, aberration, Black(), FRAME).rgba[..., 0]
    assert mirrored.min() == 0.0 and red == pytest.approx(-mirrored, abs=1e-6)
