"""Layers over samples in C++: as the reference defines it across blocks, and the same bits."""

import copy

import av
import numpy as np
import pytest
from support.native_levels import assert_same_bits

from nlens_video.core.layers import Box
from nlens_video.video.pixels import blend, blend_ref
from nlens_video.video.pixels.samples import frame_samples, frame_tags

WIDTH, HEIGHT = 331, 12  # more coarse samples across than the kernel takes at once
BOXES = (Box(0, 0, WIDTH, HEIGHT), Box(5, 3, 290, 10), Box(129, 0, 131, 1), Box(330, 11, 331, 12))


def noise(pixel_format):
    rng = np.random.default_rng(0)
    codes = rng.integers(0, 256, (HEIGHT, WIDTH, 3), np.uint8)
    if pixel_format == "gbrpf32le":  # swscale's threads write over the ends of its odd rows
        frame = av.VideoFrame.from_ndarray(np.float32(codes) / 255, pixel_format)
    else:
        frame = av.VideoFrame.from_ndarray(codes, "rgb24").reformat(format=pixel_format)
    return frame_samples(frame, frame_tags(frame))


def layer(box):
    """Holes of one pixel and of many, light above white and below black."""
    rng = np.random.default_rng(box.width)
    rgba = rng.random((box.height, box.width, 4), dtype=np.float32)
    rgba[..., :3] *= 1.6 * rgba[..., 3:] - 0.1
    rgba[rng.random(rgba.shape[:2]) < 0.3] = 0.0
    rgba[:, 20:170] = 0.0
    return rgba


@pytest.mark.parametrize("of_plate", [False, True])
@pytest.mark.parametrize("box", BOXES)
@pytest.mark.parametrize("pixel_format", ["yuv420p", "yuv411p", "yuv444p", "yuva420p", "gray"])
def test_a_layer_wider_than_a_block_is_within_a_code_value_of_the_reference(
    pixel_format, box, of_plate
):
    fast = noise(pixel_format)
    slow = copy.deepcopy(fast)
    blend.composite_over(fast, box, layer(box), of_plate=of_plate)
    blend_ref.composite_over(slow, box, layer(box), of_plate=of_plate)
    for one, other in zip(fast.planes, slow.planes, strict=True):
        assert np.abs(one.astype(int) - other.astype(int)).max() <= 1


@pytest.mark.parametrize("pixel_format", ["yuv420p", "yuva420p", "yuv420p10le", "gbrpf32le"])
def test_a_layer_over_samples_is_the_same_at_every_level(pixel_format, monkeypatch):
    def composited(module):
        monkeypatch.setattr(blend, "kernels", module)
        samples = noise(pixel_format)
        for box, of_plate in ((BOXES[0], False), (BOXES[1], True)):
            blend.composite_over(samples, box, layer(box), of_plate=of_plate)
        return [np.array(plane) for plane in samples.planes]

    assert_same_bits(composited)


@pytest.mark.parametrize("pixel_format", ["yuv420p", "yuv411p", "yuv420p10le", "rgba", "gbrpf32le"])
def test_the_light_of_samples_is_the_same_at_every_level(pixel_format, monkeypatch):
    def decoded(module):
        monkeypatch.setattr(blend, "kernels", module)
        samples = noise(pixel_format)
        corners = [(box.x0, box.y0) for box in BOXES]
        lights = [blend.linear(samples, box) for box in BOXES]
        patches = blend.green_patches(samples, corners, 1)
        return [
            *lights,
            blend.srgb(samples),
            blend.shown(samples),
            patches,
            blend.downsample(samples, 50, 4),
        ]

    assert_same_bits(decoded)
