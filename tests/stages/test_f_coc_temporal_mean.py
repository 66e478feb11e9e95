"""Temporal mean of plate frames: static areas are averaged, moving ones are kept."""

import cv2
import numpy as np
import pytest

from nlens_video.run.frame_range import LOOKAHEAD_FRAMES, look_ahead
from nlens_video.stages.f_coc import still_run, temporal_mean

HEIGHT, WIDTH = 120, 160


@pytest.fixture
def rng():
    return np.random.default_rng(4)


@pytest.fixture
def scene(rng):
    coarse = rng.uniform(0.2, 0.8, (HEIGHT // 4, WIDTH // 4, 3))
    return coarse.repeat(4, 0).repeat(4, 1).astype(np.float32)


def noisy(rng, picture, deviation=0.02):
    grain = rng.normal(0, deviation, picture.shape)
    return (picture + grain).astype(np.float32)


def test_mean_of_eight_static_frames_has_a_third_of_the_noise(rng, scene):
    frames = [noisy(rng, scene) for _ in range(8)]
    mean, used = temporal_mean(frames[0], frames[1:])
    assert used == 8
    assert np.std(mean - scene) < 0.4 * np.std(frames[0] - scene)


def test_frames_after_a_camera_movement_are_not_read(rng, scene):
    moved = np.roll(scene, 2, axis=1)

    def following():
        yield noisy(rng, scene)
        yield noisy(rng, moved)
        pytest.fail("read on after the camera had moved")

    first = noisy(rng, scene)
    mean, used = temporal_mean(first, following())
    assert used == 2
    assert np.std(mean - scene) < np.std(first - scene)


def test_moving_areas_keep_the_samples_of_the_first_frame(rng, scene):
    first = noisy(rng, scene, 0.012)
    later = []
    for shift in range(1, 6):
        picture = noisy(rng, scene, 0.012)
        picture[40:52, 20 + 10 * shift : 32 + 10 * shift] = 1.0
        later.append(picture)
    mean, used = temporal_mean(first, later)
    assert used == 6
    # at every pixel at most the frames without the bright patch are averaged
    assert np.abs(mean - scene).max() < 0.07


def test_plate_without_noise_uses_one_frame(rng, scene):
    def following():
        yield noisy(rng, scene, 0.001)
        pytest.fail("read on though there is no noise to be averaged")

    first = noisy(rng, scene, 0.001)
    mean, used = temporal_mean(first, following())
    assert used == 1
    assert np.array_equal(mean, first)


def test_global_change_of_light_is_not_motion(rng, scene):
    frames = [noisy(rng, scene + 0.01 * step, 0.01) for step in range(4)]
    mean, used = temporal_mean(frames[0], frames[1:])
    assert used == 4
    assert np.std(mean - mean.mean() - (scene - scene.mean())) < 0.7 * 0.01


def coarsely_grained(rng, across):
    """A slope of light above a chequered strip, from `across` pixels aside, with coarse noise."""
    y, x = np.mgrid[0:320, 0:480]
    x = x + across
    chequered = 80.0 + 40.0 * np.clip(3.0 * np.sin(x / 4) * np.sin(y / 4), -1.0, 1.0)
    code = np.where(y < 240, 80.0 + 60.0 * x / 480, chequered)
    grain = cv2.GaussianBlur(rng.standard_normal((*code.shape, 3)), (0, 0), 2.0)
    return ((code[..., None] + 8.0 * grain / grain.std()) / 255.0).astype(np.float32)


@pytest.mark.parametrize(("across", "still"), [(0.0, 4), (0.5, 1), (1.0, 1), (4.0, 1), (200.0, 1)])
def test_camera_stands_still_under_coarse_grain_only_if_nothing_shifts(rng, across, still):
    first = coarsely_grained(rng, 0.0)
    kept, same = still_run([first, *(coarsely_grained(rng, across) for _ in range(3))])
    assert len(kept) == still and same.mean() > 0.98


def test_flat_or_tiny_plate_is_accepted():
    flat = np.full((HEIGHT, WIDTH, 3), 0.5, np.float32)
    mean, _ = temporal_mean(flat, [flat.copy()] * 3)
    assert np.array_equal(mean, flat)
    tiny = np.zeros((2, 3, 3), np.float32)
    assert temporal_mean(tiny, [tiny])[1] == 1


def frame(index):
    from fractions import Fraction

    from nlens_video.video.info import SourceFrame
    from nlens_video.video.pixels.picture import ArrayPicture

    picture = ArrayPicture(np.zeros((2, 2, 3), np.uint8))
    return SourceFrame(
        index=index, pts=index, time_base=Fraction(1, 25), time_s=index / 25, duration=1,
        picture=picture,
    )  # fmt: skip


def test_lookahead_keeps_order_and_stops_when_no_longer_needed():
    read = []

    def items():
        for index in range(20):
            read.append(index)
            yield frame(index)
            yield f"packet {index}"

    seen, ahead = [], {}
    for item, following in look_ahead(items(), lambda: 2 not in ahead):
        if isinstance(item, str):
            seen.append(item)
            assert following == ()
            continue
        seen.append(item.index)
        ahead[item.index] = len(following)
        if item.index == 2:
            assert len(read) == 3 + LOOKAHEAD_FRAMES
    assert seen == [thing for i in range(20) for thing in (i, f"packet {i}")]
    assert ahead[0] == ahead[2] == LOOKAHEAD_FRAMES
    assert ahead[12] == 0


def test_lookahead_at_the_end_of_a_clip_holds_the_remaining_frames():
    frames = (frame(i) for i in range(3))
    lengths = [len(following) for _, following in look_ahead(frames, lambda: True)]
    assert lengths == [2, 1, 0]
