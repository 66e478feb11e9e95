"""Grain: measured on known noise, and added to the object within a tenth of it."""

import json

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support import shots
from support.effects.synthetic_frames import HEIGHT, WIDTH, noise, pictures, scene

from nlens_video.cli.main import main
from nlens_video.core.layers import BlurredLayer, Box
from nlens_video.effects.camera import grain as grain_noise
from nlens_video.effects.camera.grain import AddGrain, past_shares
from nlens_video.effects.camera.grain_measure import measure
from nlens_video.effects.camera.grain_restore import (
    RestoreGrain,
    restore_grain,
    restore_grain_reference,
)
from nlens_video.video.exr import LINEAR
from nlens_video.video.pixels.picture import ArrayPicture

FRAME = Box(0, 0, WIDTH, HEIGHT)
INSIDE = (slice(150, 165), slice(232, 248))  # of the cube, which stands still


def test_white_noise_of_a_part_is_a_crop_of_the_whole_and_of_the_reference():
    small = grain_noise.white_noise((-3, 7), (5, 9), 12, 3)
    definition = grain_noise.white_noise_reference((-3, 7), (5, 9), 12, 3)
    assert small == pytest.approx(definition, abs=1e-6)
    large = grain_noise.white_noise((-8, 0), (40, 50), 12, 3)
    assert np.array_equal(large[5:10, 7:16], small)


def test_white_noise_is_normal_uncorrelated_and_differs_between_frames():
    first, second = (grain_noise.white_noise((0, 0), (400, 500), at, 1) for at in (5, 6))
    assert first.mean() == pytest.approx(0, abs=0.01)
    assert first.std() == pytest.approx(1, abs=0.01)
    assert np.abs(first).max() < 4
    for other in (
        second,
        np.roll(first, 1, 0),
        np.roll(first, 1, 1),
        np.roll(first, (1, 1), (0, 1)),
    ):
        assert np.corrcoef(first.ravel(), other.ravel())[0, 1] == pytest.approx(0, abs=0.01)


@given(
    box=st.tuples(
        st.integers(-40, 40), st.integers(-40, 40), st.integers(1, 30), st.integers(1, 30)
    ),
    places=st.lists(st.tuples(st.integers(0, 15), st.integers(0, 15)), min_size=1, max_size=4),
)
def test_sum_of_tiles_equals_the_reference(box, places):
    x0, y0, width, height = box
    on = Box(x0, y0, x0 + width, y0 + height)
    tile = np.random.default_rng(0).normal(size=(16, 16, 3)).astype(np.float32)
    shares = [0.7**number for number in range(len(places))]
    found = grain_noise.tiled(tile, on, places, shares)
    expected = grain_noise.tiled_reference(tile, on, places, shares)
    np.testing.assert_allclose(found, expected, atol=1e-5)


def smooth_model(persistence=0.0):
    """Noise that is smooth over some pixels."""
    near = np.exp(-0.5 * (np.arange(-3, 4) / 1.2) ** 2)
    kernel = np.outer(near, near)
    kernel /= np.sqrt((kernel**2).sum())
    levels = np.linspace(0.0, 1.0, 5, dtype=np.float32)
    return grain_noise.GrainModel(
        levels=levels, deviation=np.full((5, 3), 0.01, np.float32),
        mixing=np.eye(3, dtype=np.float32), kernels=np.stack([kernel] * 3).astype(np.float32),
        persistence=persistence,
    )  # fmt: skip


def test_noise_of_a_part_of_the_frame_is_a_crop_of_that_of_the_whole():
    stage = AddGrain(smooth_model(0.3))
    whole = stage.model.unit_noise(Box(0, 0, 900, 700), 5)
    part = stage.model.unit_noise(Box(450, 380, 800, 690), 5)
    assert np.array_equal(part, whole[380:690, 450:800])


def test_noise_of_frames_is_as_alike_as_the_plates_and_no_frame_depends_on_another():
    stage = AddGrain(smooth_model(0.4))
    box = Box(0, 0, 600, 500)
    noise_of = [stage.model.unit_noise(box, at)[..., 0].ravel() for at in (10, 11, 12, 40)]
    assert np.std(noise_of[0]) == pytest.approx(1.0, abs=0.02)
    alike = np.corrcoef(noise_of)
    assert alike[0, 1] == pytest.approx(0.4, abs=0.03)
    assert alike[0, 2] == pytest.approx(0.16, abs=0.03)
    assert alike[0, 3] == pytest.approx(0.0, abs=0.03)
    again = smooth_model(0.4).unit_noise(box, 40)[..., 0].ravel()
    assert np.array_equal(noise_of[3], again)


def test_tiles_of_noise_meet_without_a_seam():
    stage = AddGrain(smooth_model())
    size = grain_noise.TILE_PX
    found = stage.model.unit_noise(Box(0, 0, 2 * size, 2 * size), 0)[..., 1]
    row, column = grain_noise.place_on_tile(0)
    for values, seam in ((found, size - row), (found.T, size - column)):
        steps = np.abs(np.diff(values, axis=0)).mean(axis=1)
        assert steps[seam - 1] == pytest.approx(steps.mean(), rel=0.15)


def test_each_frame_takes_the_noise_from_another_place():
    places = {grain_noise.place_on_tile(index) for index in range(-12, 1000)}
    assert len(places) > 1000
    assert np.ptp(list(places), axis=0).min() > 0.95 * grain_noise.TILE_PX


def test_regrain_kernel_equals_the_reference():
    rng = np.random.default_rng(0)
    alpha = rng.choice([0.0, 0.3, 1.0], (30, 40, 1))
    rgba = np.concatenate([alpha * rng.uniform(0, 1.3, (30, 40, 3)), alpha], 2).astype(np.float32)
    plate = rng.uniform(0, 1, (30, 40, 3)).astype(np.float32)
    unit = rng.standard_normal((30, 40, 3)).astype(np.float32)
    curve = np.linspace([0.01, 0.02, 0.03], [0.03, 0.02, 0.01], 256).astype(np.float32)
    fast = grain_noise.regrain(rgba, plate, unit, curve)
    assert fast == pytest.approx(grain_noise.regrain_reference(rgba, plate, unit, curve), abs=2e-4)
    assert np.array_equal(fast[alpha[..., 0] == 0], rgba[alpha[..., 0] == 0])


def test_grain_of_parts_that_lie_far_from_each_other_equals_the_reference():
    rng = np.random.default_rng(1)
    alpha = np.zeros((6, 90, 1))
    alpha[:, [0, 15, 16, 40, 41, 60, 89]] = 0.7  # gaps of 14 to 28 pixels, and the row's ends
    alpha[3] = 0.0
    rgba = np.concatenate([alpha * rng.uniform(0, 1, (6, 90, 3)), alpha], 2).astype(np.float32)
    plate, unit = rng.random((6, 90, 3), np.float32), rng.standard_normal((6, 90, 3))
    unit = unit.astype(np.float32)
    curve = np.linspace([0.01, 0.02, 0.03], [0.03, 0.02, 0.01], 256).astype(np.float32)
    fast = grain_noise.regrain(rgba, plate, unit, curve)
    assert fast == pytest.approx(grain_noise.regrain_reference(rgba, plate, unit, curve), abs=2e-4)
    drawn = alpha[..., 0] > 0.0
    assert (fast[drawn] != rgba[drawn]).any(axis=1).all()
    assert np.array_equal(fast[~drawn], rgba[~drawn])


def test_grain_of_a_part_of_a_shadow_leaves_the_rest():
    rng = np.random.default_rng(2)
    wide = np.zeros((9, 50, 4), np.float32)
    wide[..., 3] = 0.5
    plate = rng.random((5, 30, 3), np.float32)
    unit = rng.standard_normal((5, 30, 3)).astype(np.float32)
    deviation = np.tile(np.linspace(0.01, 0.03, 256, dtype=np.float32), (3, 1))
    inside, before = np.s_[2:7, 10:40], wide.copy()
    restore_grain(wide[inside], plate, unit, deviation)
    expected = restore_grain_reference(before[inside], plate, unit, deviation)
    assert wide[inside] == pytest.approx(expected, abs=1e-4)
    assert not np.array_equal(wide[inside], before[inside])
    wide[inside] = before[inside]
    assert np.array_equal(wide, before)


@pytest.mark.parametrize("seed", range(4))
def test_clean_plate_measures_as_free_of_grain(seed):
    for frames in (1, 4):
        assert not measure(pictures(scene(seed, slope=0.9 + 0.2 * seed), frames)).called_for


@pytest.mark.parametrize("levels", [1.5, 4.0])
@pytest.mark.parametrize(
    "kind",
    [{}, {"tint": 1.0}, {"spread_px": 0.7}, {"persistence": 0.5}, {"tint": 0.5, "spread_px": 1.0}],
    ids=str,
)
def test_measured_grain_strength_equals_the_added_one(levels, kind):
    grain = noise(1, 5, levels / 255, **kind)
    found = measure(pictures(scene(2), 5, grain))
    assert found.called_for
    rounding = 1 / 12  # of 8 bits, which the plate shows too
    assert found.value == pytest.approx(np.sqrt(levels**2 + rounding), rel=0.1)
    wanted = kind.get("persistence", 0.0)
    assert found.model.persistence == pytest.approx(wanted, abs=0.1)


def lit(code, gains, grain):
    """8-bit pictures whose light (frames, H or 1, W or 1) changes, with noise in code values."""
    light = grain_noise.to_linear(code)
    shots = [
        grain_noise.to_code(gain[..., None] * light) + more
        for gain, more in zip(gains, grain, strict=True)
    ]
    return [ArrayPicture(np.uint8(np.clip(np.round(255 * one), 0, 255)), "rgb") for one in shots]


FLICKER = 1 + 0.08 * np.sin([[[0.0]], [[1.3]], [[2.5]], [[3.8]], [[5.0]]])  # of a lamp
SETTLING = 1 + np.arange(5)[:, None, None] * 0.02  # of the exposure
ACROSS = np.linspace(0.0, 1.0, WIDTH)  # a lamp at one side


@pytest.mark.parametrize("levels", [0.0, 1.0, 4.0])
@pytest.mark.parametrize(
    "gains", [FLICKER, SETTLING, 1 + (FLICKER - 1) * ACROSS], ids=["lamp", "exposure", "one side"]
)
def test_change_of_light_does_not_measure_as_grain(gains, levels):
    code = grain_noise.to_code(scene(2))
    grain = noise(1, 5, levels / 255, tint=0.5)
    steady, changing = (measure(lit(code, by, grain)) for by in (np.ones_like(gains), gains))
    if levels:
        assert changing.value == pytest.approx(steady.value, rel=0.05)
        assert changing.model.persistence == pytest.approx(steady.model.persistence, abs=0.05)
    else:
        assert not changing.called_for


def test_grain_of_a_single_picture_is_measured_in_smooth_areas():
    grain = noise(1, 1, 4.0 / 255)
    found = measure(pictures(scene(2, slope=2.2, soft_px=6.0), 1, grain))
    assert found.called_for
    assert found.value == pytest.approx(4.0, rel=0.15)


def nearly_structureless():
    """A slope of light above a chequered strip, scene-linear."""
    y, x = np.mgrid[0:HEIGHT, 0:WIDTH]
    code = np.where(y < 200, 80 + 60 * x / WIDTH, 60 + 40 * ((x // 12 + y // 12) % 2))
    return grain_noise.to_linear(np.repeat(code[..., None] / 255, 3, axis=2).astype(np.float32))


@pytest.mark.parametrize("spread_px", [1.6, 2.0, 3.0])
def test_coarse_grain_is_measured_and_added_as_coarse_as_it_is(spread_px):
    plate = nearly_structureless()
    grain = noise(3, 5, 8.0 / 255, tint=1.0, spread_px=spread_px)
    found = measure(pictures(plate, 5, grain))
    assert found.called_for
    assert found.value == pytest.approx(8.0, rel=0.05)
    made = found.model.unit_noise(Box(0, 0, WIDTH, HEIGHT), 0)
    assert made.std() == pytest.approx(1.0, abs=0.05)
    for away in (1, 3, 6):
        alike = (np.mean(one[:, :-away] * one[:, away:]) / np.mean(one * one) for one in
                 (made, noise(9, 1, 1.0, tint=1.0, spread_px=spread_px)[0]))  # fmt: skip
        assert next(alike) == pytest.approx(next(alike), abs=0.06)


def test_texture_below_a_saturated_sky_does_not_measure_as_grain():
    # the sky is smooth, but without any red: its blocks tell nothing of that channel's noise
    codes = np.full((HEIGHT, WIDTH, 3), (0.0, 90.0, 116.0))
    contrast = np.linspace(12.0, 40.0, WIDTH)[:, None]
    codes[240:] = 110.0 + contrast * np.random.default_rng(4).normal(size=(HEIGHT - 240, WIDTH, 3))
    picture = ArrayPicture(np.round(codes.clip(0.0, 255.0)).astype(np.uint8), "rgb")
    assert not measure([picture]).called_for


def test_camera_motion_does_not_measure_as_grain():
    views = [np.roll(scene(3), 4 * at, axis=1) for at in range(4)]
    shot = [pictures(view, 1)[0] for view in views]
    assert not measure(shot).called_for


def spectrum(values):
    """Power by radial frequency, of many frames."""
    power = np.mean([np.abs(np.fft.fft2(v)) ** 2 for v in values], axis=0) / values[0].size
    radius = np.hypot(np.fft.fftfreq(power.shape[0])[:, None], np.fft.fftfreq(power.shape[1])[None])
    bins = np.digitize(radius, [0.0, 0.1, 0.2, 0.3, 0.4, 0.5])
    return np.array([power[bins == b].mean() for b in range(1, 6)])


@pytest.mark.parametrize("kind", [{}, {"spread_px": 0.8, "tint": 0.6}], ids=str)
def test_added_grain_has_the_plates_spectrum_and_level_dependence(kind):
    base = scene(4, slope=2.0)
    code = grain_noise.to_code(base)
    frames = 6
    signal = (0.5 + 1.2 * code)[None]  # more noise where it is bright
    grain = noise(5, frames, 3.0 / 255, **kind) * signal
    shot = pictures(base, frames, grain)
    stage = AddGrain(measure(shot).model)
    for level in (0.25, 0.6):
        light = float(grain_noise.to_linear(np.float32(level)))
        layer = BlurredLayer(
            box=FRAME, rgba=np.ones((HEIGHT, WIDTH, 4), np.float32) * np.float32([light] * 3 + [1])
        )
        shown = [
            grain_noise.to_code(stage(shot[0], layer, at).rgba[..., :3]) for at in range(frames)
        ]
        made = np.stack(shown) - level
        wanted = (3.0 / 255) * (0.5 + 1.2 * level)
        assert made.std() == pytest.approx(wanted, rel=0.1)
        plain = noise(9, frames, 1.0, **kind)
        ratio = spectrum(made[..., 1] / made.std()) / spectrum(plain[..., 1] / plain.std())
        strong = spectrum(plain[..., 1]) > 0.05 * spectrum(plain[..., 1]).max()
        assert ratio[strong] == pytest.approx(1, abs=0.1)
        between = np.corrcoef(made[..., 0].ravel(), made[..., 2].ravel())[0, 1]
        expected = np.corrcoef(plain[..., 0].ravel(), plain[..., 2].ravel())[0, 1]
        assert between == pytest.approx(expected, abs=0.05)


def test_added_grain_has_the_plates_correlation_over_time():
    shares = np.array(past_shares(0.6))
    assert (shares**2).sum() == pytest.approx(1)
    assert (shares[1:] * shares[:-1]).sum() == pytest.approx(0.6, abs=0.02)
    assert past_shares(0.0) == (1.0,)


def test_semitransparent_object_gets_less_grain_because_the_plate_shows_its_own():
    grain = noise(5, 1, 4.0 / 255)
    shot = pictures(np.full((HEIGHT, WIDTH, 3), 0.2, np.float32), 1, grain)
    stage = AddGrain(measure(shot).model)
    half = np.float32([0.1, 0.1, 0.1, 0.5])
    layer = BlurredLayer(box=FRAME, rgba=np.ones((HEIGHT, WIDTH, 4), np.float32) * half)
    grained = stage(shot[0], layer, 0).rgba
    composite = grained[..., :3] + 0.5 * shot[0].linear(FRAME)
    assert grain_noise.to_code(composite).std() == pytest.approx(4.0 / 255, rel=0.05)


def even_noise(size):
    """A plate's model whose deviation in light is a share of its root, as a sensor's."""
    levels = np.linspace(0.0, 1.0, 33, dtype=np.float32)
    light = grain_noise.to_linear(levels).astype(np.float64)
    in_code = size * np.sqrt(light) / np.gradient(light, levels)
    kernel = np.zeros((3, 7, 7), np.float32)
    kernel[:, 3, 3] = 1.0
    return grain_noise.GrainModel(
        levels=levels, deviation=np.repeat(in_code[:, None], 3, axis=1).astype(np.float32),
        mixing=np.eye(3, dtype=np.float32), kernels=kernel, persistence=0.0,
    )  # fmt: skip


def darkened(plate, left, model, index=0):
    """A plate in a shadow that leaves a share of its light in each channel, regrained."""
    loss = 1.0 - np.asarray(left, np.float32)
    mean = loss.mean(axis=-1, keepdims=True)
    rgba = np.concatenate([mean - loss, mean], axis=-1).astype(np.float32)
    layer = RestoreGrain(model, draw=2)(plate, BlurredLayer(box=FRAME, rgba=rgba), index)
    plate.composite_over(FRAME, layer.rgba, of_plate=True)
    return plate


@pytest.mark.parametrize("left", [(0.8, 0.8, 0.8), (0.3, 0.3, 0.3), (0.1, 0.2, 0.4)], ids=str)
def test_plate_in_shadow_is_as_noisy_as_the_plate_is_at_that_level(left):
    model = even_noise(0.03)
    light = np.full((HEIGHT, WIDTH, 3), 0.25)
    noisy = light + 0.03 * np.sqrt(light) * np.random.default_rng(0).standard_normal(light.shape)
    shown = darkened(
        ArrayPicture(noisy.astype(np.float32), "rgb", LINEAR), np.broadcast_to(left, light.shape),
        model,
    ).array  # fmt: skip
    wanted = 0.25 * np.array(left)
    assert shown.mean(axis=(0, 1)) == pytest.approx(wanted, rel=0.01)
    assert shown.std(axis=(0, 1)) == pytest.approx(0.03 * np.sqrt(wanted), rel=0.06)


def test_shadow_beside_the_frame_gets_no_noise():
    plate = ArrayPicture(np.full((HEIGHT, WIDTH, 3), 0.25, np.float32), "rgb", LINEAR)
    nothing = BlurredLayer.nothing()
    assert RestoreGrain(even_noise(0.03), draw=2)(plate, nothing, 0).box.empty


def test_faint_shadow_adds_no_noise_and_a_frames_noise_depends_on_its_index_alone():
    model, left = even_noise(0.03), np.ones((HEIGHT, WIDTH, 3))
    left[:, :100], left[:, 200:] = 0.96, 0.4
    linear = np.full((HEIGHT, WIDTH, 3), 0.3, np.float32)
    first, again, later = (
        darkened(ArrayPicture(linear.copy(), "rgb", LINEAR), left, model, at).array
        for at in (7, 7, 8)
    )
    assert np.ptp(first[:, :200].reshape(-1, 3)[:, 0]) == pytest.approx(0.012, abs=1e-6)
    assert np.array_equal(first, again) and not np.array_equal(first[:, 200:], later[:, 200:])


def test_layers_of_one_frame_get_independent_noise():
    box = Box(0, 0, 400, 400)
    noise_of = [smooth_model(0.3).unit_noise(box, 5, draw)[..., 0].ravel() for draw in range(3)]
    assert np.corrcoef(noise_of) == pytest.approx(np.eye(3), abs=0.03)


def test_grain_of_a_pixel_does_not_depend_on_the_box():
    shot = pictures(scene(1), 4, noise(1, 4, 3 / 255, spread_px=0.7))
    stage = AddGrain(measure(shot).model)

    def grained(box, index):
        rgba = np.ones((box.height, box.width, 4), np.float32) * np.float32(0.4)
        return stage(shot[0], BlurredLayer(box=box, rgba=rgba), index).rgba

    whole, part = grained(FRAME, 3), grained(Box(50, 60, 120, 100), 3)
    assert part == pytest.approx(whole[60:100, 50:120], abs=1e-6)
    assert np.abs(grained(FRAME, 4) - whole).max() > 0.01


@pytest.mark.slow
@pytest.mark.needs_gl
def test_command_adds_grain_only_on_a_noisy_plate(tmp_path):
    glb = shots.cube_glb(tmp_path / "cube.glb")
    fit = shots.fit_json(tmp_path / "fit.json")
    rng = np.random.default_rng(2)
    spreads = {}
    for name, levels in (("clean", 0.0), ("noisy", 5.0)):
        for at in range(4):
            grain = levels * rng.standard_normal(shots.grey().shape)
            shots.write_png(tmp_path / f"{name}_{at:04d}.png", np.uint8(shots.plate() + grain))
        out, timings = tmp_path / f"{name}_out_%04d.png", tmp_path / f"{name}.json"
        words = ["--fit", str(fit), "--timings", str(timings), "-q"]
        assert main([str(tmp_path / f"{name}_%04d.png"), str(glb), str(out), *words]) == 0
        rows = json.loads(timings.read_text())["frames"]
        assert ("grain" in rows[1]["nodes"]) is (name == "noisy")
        pair = [cv2.imread(str(out) % at).astype(np.float32) for at in (1, 2)]
        spreads[name] = np.std((pair[0] - pair[1])[INSIDE]) / np.sqrt(2)
    assert spreads["clean"] == 0.0
    assert spreads["noisy"] == pytest.approx(5.0, rel=0.15)


@pytest.mark.slow
def test_grain_of_a_large_picture_is_measured_in_its_centre():
    base = np.tile(scene(2), (4, 4, 1))
    rng = np.random.default_rng(0)
    shot = []
    for _ in range(3):
        code = grain_noise.to_code(base) + 3.0 / 255 * rng.standard_normal(base.shape)
        shot.append(ArrayPicture(np.uint8(np.clip(np.round(255 * code), 0, 255)), "rgb"))
    found = measure(shot)
    assert found.called_for
    assert found.value == pytest.approx(3.0, rel=0.05)
