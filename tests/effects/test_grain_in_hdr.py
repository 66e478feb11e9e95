"""Grain beyond diffuse white: measured and added in HDR and in plates of light itself."""

import numpy as np
import pytest
from msgspec.structs import replace

from nlens_video.core.color import transfer
from nlens_video.core.layers import BlurredLayer, Box
from nlens_video.effects.camera.grain import AddGrain, GrainModel, regrain, regrain_reference
from nlens_video.effects.camera.grain_code import HLG, LIGHT, PQ
from nlens_video.effects.camera.grain_measure import measure
from nlens_video.effects.camera.grain_restore import (
    RestoreGrain,
    light_deviation,
    restore_grain,
    restore_grain_reference,
)
from nlens_video.video.exr import LINEAR
from nlens_video.video.pixels.picture import SRGB, ArrayPicture

HEIGHT, WIDTH = 180, 320
FRAME = Box(0, 0, WIDTH, HEIGHT)


def blocks(curve, darkest, brightest):
    """Code values (H, W) of a still scene: steps of brightness from left to right."""
    light = darkest * (brightest / darkest) ** np.linspace(0.0, 1.0, WIDTH)
    steps = np.random.default_rng(0).uniform(-0.05, 0.05, (HEIGHT // 20, WIDTH // 20))
    return transfer(curve).to_coded(np.tile(light, (HEIGHT, 1))) + np.kron(steps, np.ones((20, 20)))


def filmed(curve, darkest, brightest, deviation):
    """10-bit pictures of a still camera with noise of one deviation in every code value."""
    rng = np.random.default_rng(1)
    codes = np.repeat(blocks(curve, darkest, brightest)[..., None], 3, axis=2)
    noisy = (codes + deviation * rng.standard_normal(codes.shape) for _ in range(5))
    tags = replace(SRGB, transfer=curve)
    return [
        ArrayPicture(
            np.uint16(np.clip(np.round(1023 * one), 0, 1023) * (65535 / 1023)), "rgb", tags
        )
        for one in noisy
    ]


def grained(stage, picture, light):
    """The light (H, W, 3) of an object of one light with grain."""
    rgba = np.ones((HEIGHT, WIDTH, 4), np.float32) * np.float32([light] * 3 + [1.0])
    return stage(picture, BlurredLayer(box=FRAME, rgba=rgba), 0).rgba[..., :3]


@pytest.mark.parametrize("brightest", [0.8, 3.0], ids=["white ends it", "beyond white"])
@pytest.mark.parametrize("curve", ["smpte2084", "arib-std-b67"])
def test_grain_in_hdr_is_the_plates_at_every_brightness_beyond_white_too(curve, brightest):
    shot = filmed(curve, 0.01, brightest, 0.005)
    found = measure(shot)
    assert found.called_for
    for light in (0.003, 0.05, 0.9, 1.5, 3.0):
        made = transfer(curve).to_coded(grained(AddGrain(found.model), shot[0], light))
        assert made.std(axis=(0, 1)) == pytest.approx(0.005, rel=0.08)
        assert made.mean() == pytest.approx(float(transfer(curve).to_coded(light)), abs=5e-4)


def test_grain_of_light_itself_is_the_plates_beyond_white():
    """A sensor's noise, whose variance is in proportion to the light."""
    light = transfer("smpte2084").to_linear(blocks("smpte2084", 0.02, 8.0))
    light = np.repeat(light[..., None], 3, axis=2)
    rng = np.random.default_rng(2)
    shot = [
        ArrayPicture(
            np.float32(light + 0.02 * np.sqrt(light) * rng.standard_normal(light.shape)), "rgb",
            LINEAR,
        )
        for _ in range(5)
    ]  # fmt: skip
    found = measure(shot)
    assert found.called_for
    for level in (0.05, 0.9, 2.0, 6.0):
        made = grained(AddGrain(found.model), shot[0], level)
        assert made.std(axis=(0, 1)) == pytest.approx(0.02 * np.sqrt(level), rel=0.12)


def test_plate_of_light_that_ends_at_white_has_the_grain_of_sdr():
    rng = np.random.default_rng(3)
    code = np.clip(blocks("iec61966-2-1", 0.02, 0.8), 0.02, 0.95)[..., None]
    noisy = [code + 0.01 * rng.standard_normal((HEIGHT, WIDTH, 3)) for _ in range(5)]
    sdr = measure([ArrayPicture(np.float32(one), "rgb") for one in noisy])
    light = [transfer("iec61966-2-1").to_linear(one) for one in noisy]
    same = measure([ArrayPicture(np.float32(one), "rgb", LINEAR) for one in light])
    assert same.value == pytest.approx(sdr.value, rel=0.02)
    assert same.model.levels == pytest.approx(sdr.model.levels)


def test_strength_of_grain_in_hdr_is_told_in_levels_of_srgb():
    deviation, curve = 0.004, "arib-std-b67"
    levels = (np.arange(12) + 0.5) / 12
    light = transfer("iec61966-2-1").to_linear(levels)
    slope = np.gradient(levels, transfer(curve).to_coded(light))
    expected = 255 * deviation * np.sqrt(np.mean(slope**2))
    found = measure(filmed(curve, 0.002, 1.5, deviation))
    assert found.value == pytest.approx(expected, rel=0.15)


@pytest.mark.parametrize("code", [PQ, HLG, LIGHT], ids=lambda code: code.curve)
def test_kernels_of_grain_beyond_white_equal_their_references(code):
    rng = np.random.default_rng(4)
    alpha = rng.choice([0.0, 0.3, 1.0], (30, 40, 1))
    rgba = np.concatenate([alpha * rng.uniform(0, 6, (30, 40, 3)), alpha], 2).astype(np.float32)
    plate = rng.uniform(0, 6, (30, 40, 3)).astype(np.float32)
    unit = rng.standard_normal((30, 40, 3)).astype(np.float32)
    curve = np.linspace([0.01, 0.02, 0.03], [0.03, 0.02, 0.01], 256).astype(np.float32)
    fast = regrain(rgba, plate, unit, curve, code)
    exact = regrain_reference(rgba, plate, unit, curve, code)
    assert fast == pytest.approx(exact, rel=2e-3, abs=2e-4)
    assert np.array_equal(fast[alpha[..., 0] == 0], rgba[alpha[..., 0] == 0])
    darkening = np.concatenate([np.zeros_like(plate), rng.uniform(0, 1, (30, 40, 1))], axis=2)
    darkening = darkening.astype(np.float32)
    deviation, by_largest = light_deviation(curve, code), code.normalised(plate)
    exact = restore_grain_reference(darkening, by_largest, unit, deviation)
    restore_grain(darkening, by_largest, unit, deviation)
    assert darkening == pytest.approx(exact, abs=1e-4)


@pytest.mark.parametrize("left", [0.3, 0.7])
def test_bright_ground_in_shadow_is_as_noisy_as_the_plate_is_at_that_level(left):
    codes = np.linspace(0.0, PQ.end, 200, dtype=np.float32)
    kernel = np.zeros((3, 7, 7), np.float32)
    kernel[:, 3, 3] = 1.0
    model = GrainModel(
        levels=codes, deviation=np.full((200, 3), 0.005, np.float32),
        mixing=np.eye(3, dtype=np.float32), kernels=kernel, persistence=0.0, code=PQ,
    )  # fmt: skip
    rng = np.random.default_rng(5)
    noisy = PQ.to_code(np.full((HEIGHT, WIDTH, 3), 4.0, np.float32))
    noisy += 0.005 * rng.standard_normal(noisy.shape)
    plate = ArrayPicture(PQ.to_linear(noisy), "rgb", LINEAR)
    rgba = np.zeros((HEIGHT, WIDTH, 4), np.float32)
    rgba[..., 3] = 1.0 - left
    layer = RestoreGrain(model, draw=2)(plate, BlurredLayer(box=FRAME, rgba=rgba), 0)
    plate.composite_over(FRAME, layer.rgba, of_plate=True)
    assert PQ.to_code(plate.array).std(axis=(0, 1)) == pytest.approx(0.005, rel=0.08)
