"""A card passes an object: background, detections, tracks and matte against the ground truth."""

import cv2
import numpy as np
import pytest

from nlens_video.core.color import ColorTags
from nlens_video.core.layers import Box
from nlens_video.effects.foreground.appearance import segment
from nlens_video.effects.foreground.background import exposure_gain, sqrt_light
from nlens_video.effects.foreground.detection import Detection, detect, foreground_mask
from nlens_video.effects.foreground.frame_sampler import FrameSampler, upper_median
from nlens_video.effects.foreground.matte import soft_matte
from nlens_video.effects.foreground.survey import BackgroundSurvey
from nlens_video.effects.foreground.tracker import Tracker
from nlens_video.effects.occlusion import moving_mattes
from nlens_video.effects.occlusion_cues import MovingMatte
from nlens_video.stages.composite import behind
from nlens_video.video.pixels.picture import ArrayPicture

SHAPE = (120, 200)
LINEAR = ColorTags(matrix="gbr", transfer="linear", primaries="bt709", full_range=True)
RED = np.array([0.5, 0.05, 0.05], np.float32)


def scene(seed=0):
    """Light of a textured wall (h, w, 3)."""
    rng = np.random.default_rng(seed)
    coarse = rng.uniform(0.1, 0.5, (12, 20, 3)).astype(np.float32)
    return cv2.resize(coarse, SHAPE[::-1], interpolation=cv2.INTER_CUBIC).clip(0.05, 0.8)


def shot(index, light, *, drift=0.0, noise=0.5 / 255):
    """Roots of light of a frame, over which a red card of 30 px passes."""
    rng = np.random.default_rng(index)
    seen = light.copy()
    seen[20:100, 6 * index : 6 * index + 30] = RED
    seen *= 1.0 + drift * index
    return (sqrt_light(seen) + rng.normal(0, noise, seen.shape)).astype(np.float32)


@pytest.mark.parametrize("drift", [0.0, 0.02])
def test_the_median_is_the_background_though_a_card_passes_and_the_exposure_drifts(drift):
    light = scene()
    kept = FrameSampler(max_frames=15)
    first = shot(0, light)
    for index in range(28):
        roots = shot(index, light, drift=drift)
        kept.add(roots / exposure_gain(roots, first))
    found, noise = kept.median()
    off = np.abs(found - sqrt_light(light)).max(axis=2)
    assert np.percentile(off, 98) < 2 / 255
    assert noise.max() < 0.2 and noise.min() >= 0.5 / 255
    assert kept.agreement(found, noise).mean() > 0.75


@pytest.mark.parametrize("count", [1, 2, 3, 4, 5, 20, 21])
def test_the_upper_median_is_that_of_partition(count):
    pictures = np.random.default_rng(count).integers(0, 65536, (count, 7, 5, 3), np.uint16)
    expected = np.partition(pictures, count // 2, axis=0)[count // 2]
    assert np.array_equal(upper_median(list(pictures)), expected)


def test_a_sampler_keeps_evenly_spaced_frames_and_no_more_than_allowed():
    kept = FrameSampler(max_frames=4)
    for index in range(100):
        kept.add(np.full((1, 1, 3), 0.01 * index, np.float32))
        assert len(kept._frames) <= 4
    steps = np.diff([codes[0, 0, 0] for codes in kept._frames])
    assert len(set(np.round(steps / 16383.0, 2))) == 1


def test_a_survey_tells_where_a_card_passes_and_where_nothing_moves():
    survey = BackgroundSurvey(SHAPE[::-1])
    for index in range(28):
        survey.add(shot(index, scene()))
    found = survey.model()
    assert found.has_motion(Box(80, 40, 110, 80)) and not found.has_motion(Box(0, 104, 200, 120))
    assert found.certainty(Box(80, 40, 110, 80)) == 1.0
    assert survey.is_static(found)


@pytest.mark.parametrize("at", [0, 1, 13, 27])
@pytest.mark.parametrize("gain", [0.0, 0.05, 4.0], ids=["black", "faded", "flash"])
def test_a_survey_is_told_nothing_by_a_black_frame_or_one_lit_by_a_flash(gain, at):
    surveys = with_it, without = BackgroundSurvey(SHAPE[::-1]), BackgroundSurvey(SHAPE[::-1])
    rng = np.random.default_rng(9)
    for index in range(28):
        roots = shot(index, scene())
        if index == at and (gain > 0.0 or at > 0):
            lit = gain * rng.uniform(0.6, 1.6, (*SHAPE, 1)) if gain > 1.0 else gain
            with_it.add(np.minimum(np.sqrt(lit) * roots, 1.0).astype(np.float32))
        for one in surveys:
            one.add(roots)
    found, wanted = (one.model() for one in surveys)
    assert with_it.is_static(found)
    assert np.array_equal(found.roots, wanted.roots)
    assert np.array_equal(found.travelled, wanted.travelled)


def view_of(kind, index, light):
    """A frame of 40 (h, w, 3), of light that is wider than it."""
    rng = np.random.default_rng(index)
    left = {"pan": 2 * index, "late pan": 8 * max(0, index - 30), "shake": rng.integers(0, 5)}
    seen = np.roll(light, -left.get(kind, 20), axis=1)[:, 20 : 20 + SHAPE[1]].copy()
    if kind == "passer-by":
        seen[10:, 6 * index - 30 : 6 * index + 10] = RED
    return sqrt_light(seen)


@pytest.mark.parametrize(
    ("kind", "static"),
    [("passer-by", True), ("pan", False), ("late pan", False), ("shake", False)],
)
def test_camera_is_static_though_somebody_passes_through_the_whole_picture(kind, static):
    rng = np.random.default_rng(1)
    light = rng.uniform(0.05, 0.8, (40, 100, 3)).astype(np.float32)
    light = cv2.resize(light, (300, SHAPE[0]), interpolation=cv2.INTER_CUBIC).clip(0.02, 0.9)
    survey = BackgroundSurvey(SHAPE[::-1])
    for index in range(40):
        survey.add(view_of(kind, index, light))
    model = survey.model()
    assert survey.is_static(model) == static
    assert not static or model.changed.mean() > 0.75


@pytest.mark.parametrize(("side", "far"), [(6, 0), (8, 4)])
def test_the_edge_of_a_lamp_that_sways_goes_nowhere_and_a_small_target_does(side, far):
    light = scene()
    light = cv2.resize(light, (384, 205), interpolation=cv2.INTER_LINEAR)
    survey = BackgroundSurvey((384, 205))
    for index in range(30):
        seen = light.copy()
        left = 100 + far * (index - 14) if index in (12, 13) else 0
        if left:
            seen[60 : 60 + side - 1, left : left + side - 1] = RED
        survey.add(sqrt_light(seen))
    model = survey.model()
    assert model is not None
    assert survey.has_change(Box(80, 50, 140, 80))
    assert model.has_motion(Box(80, 50, 140, 80)) == (far > 0)


def test_a_shadow_is_background_and_what_casts_it_is_foreground():
    light = scene()
    seen = light.copy()
    seen[30:80, 40:60] = RED
    seen[80:90, 40:120] *= 0.55
    noise = np.full(SHAPE, 1 / 255, np.float32)
    mask = foreground_mask(sqrt_light(seen), sqrt_light(light), noise)
    assert mask[34:78, 42:58].all() and mask[83:, 64:].mean() < 0.02
    (found,) = detect(mask)
    assert found.foot[1] == pytest.approx(80, abs=4)


@pytest.mark.parametrize(
    ("left", "thing"),
    [((0.46, 0.55, 0.64), False), ((0.64, 0.55, 0.46), True), ((0.1, 0.2, 0.5), True)],
    ids=["lit by the sky", "redder than the ground", "blue trousers"],
)
def test_a_shadow_may_be_bluer_than_the_ground_and_not_redder(left, thing):
    light = scene()
    seen = light.copy()
    seen[40:80, 40:120] *= np.array(left, np.float32)
    mask = foreground_mask(sqrt_light(seen), sqrt_light(light), np.full(SHAPE, 1 / 255, np.float32))
    share = mask[44:76, 44:116].mean()
    assert share > 0.9 if thing else share < 0.02


def test_somebody_whose_legs_look_like_the_ground_now_and_then_goes_steadily():
    rng = np.random.default_rng(3)
    lost, jumping = Tracker(), Tracker()
    for index in range(40):
        left, legs = 20 + 3 * index, int(rng.integers(0, 31))
        lost.add(index, [detection(Box(left, 20, left + 30, 110 - legs))], [0.3], 0.25)
        lifted = Box(left, 20 - legs, left + 30, 110 - legs)
        jumping.add(index, [detection(lifted)], [0.3], 0.25)
    whole = Box(0, 0, *SHAPE[::-1])
    assert lost.steadiness(whole) == 1.0
    assert jumping.steadiness(whole) < 0.6


def passing(foot_of, contact=0.25):
    """Depth order of a target of 20 px that passes, by the disparity of its foot on each frame."""
    tracker = Tracker()
    for index in range(40):
        box = Box(20 + 3 * index, 20, 40 + 3 * index, 100)
        mask = np.zeros((120, 200), np.bool_)
        mask[box.slices_in(Box(0, 0, 200, 120))] = True
        tracker.add(index, detect(mask), [foot_of(index)], contact)
    return [states[0].in_front for _, states in sorted(tracker.states().items())]


def test_a_target_is_in_front_of_the_object_where_its_foot_is_nearer():
    assert set(passing(lambda index: 0.3)) == {1.0}
    assert set(passing(lambda index: 0.2)) == {0.0}


def test_the_order_changes_once_where_a_target_walks_past_and_jitter_changes_nothing():
    rng = np.random.default_rng(3)
    orders = passing(lambda index: 0.2 + 0.1 * index / 39 + rng.normal(0, 0.003))
    assert (np.diff(orders) >= 0).all() and orders[0] == 0.0 and orders[-1] == 1.0
    assert set(passing(lambda index: 0.25 + rng.normal(0, 0.004))) in ({0.0}, {1.0})
    lost = passing(lambda index: 0.3 if index % 7 else 0.1)  # now and then its foot is not seen
    assert set(lost) == {1.0}


def test_what_stirs_in_place_is_no_target_and_what_changes_its_shape_is_not_steady():
    rng = np.random.default_rng(5)
    stirring, changing = Tracker(), Tracker()
    for index in range(40):
        sway = int(rng.integers(0, 8))
        stirring.add(index, [detection(Box(60 + sway, 20, 100 + sway, 90))], [0.3], 0.25)
        bottom = int(rng.integers(40, 110))
        changing.add(
            index, [detection(Box(20 + 3 * index, 20, 60 + 3 * index, bottom))], [0.3], 0.25
        )
    whole = Box(0, 0, *SHAPE[::-1])
    assert not stirring.states()
    assert changing.steadiness(whole) < 0.6
    steady = Tracker()
    for index in range(40):
        steady.add(index, [detection(Box(20 + 3 * index, 20, 50 + 3 * index, 90))], [0.3], 0.25)
    assert steady.steadiness(whole) == 1.0 and steady.states()


def detection(box):
    return Detection(box, (0.5 * (box.x0 + box.x1), box.y1), box)


def test_shoes_belong_to_the_body_above_them_where_the_legs_have_the_ground_s_colour():
    mask = np.zeros((180, 320), np.bool_)
    mask[40:90, 100:130] = True
    mask[118:126, 100:110] = mask[120:127, 122:131] = True  # shoes
    mask[60:150, 200:250] = True  # somebody nearer, whose head is beside
    mask[160:170, 20:60] = True  # something on the ground, under nobody
    (body, other, flat) = sorted(detect(mask), key=lambda one: one.box.y0)
    assert (body.box.x0, body.box.y0, body.box.y1) == (100, 40, 127)
    assert body.foot[1] == 126.0
    assert other.box.y0 == 60 and flat.box.y0 == 160


def test_heads_of_those_who_stand_nearer_are_no_feet():
    mask = np.zeros((180, 320), np.bool_)
    mask[40:80, 100:120] = True
    mask[84:176, 98:140] = True
    assert len(detect(mask)) == 2


def test_two_merged_targets_keep_their_orders():
    tracker = Tracker()
    for index in range(50):
        near = Box(4 * index, 20, 4 * index + 24, 115)
        far = Box(190 - 4 * index, 20, 208 - 4 * index, 80)
        mask = np.zeros((120, 210), np.bool_)
        for box in (near, far):
            mask[box.intersection(Box(0, 0, 210, 120)).slices_in(Box(0, 0, 210, 120))] = True
        detections = detect(mask)
        feet = [0.4 if one.foot[1] > 100 else 0.2 for one in detections]
        tracker.add(index, detections, feet, 0.3)
    for states in tracker.states().values():
        for one in states:
            assert one.in_front == float(one.box.y1 > 100), one


def pair(index):
    """Roots of light of a frame on which a red card and a green one pass; the red one is nearer."""
    light = scene()
    near, far = (
        Box(4 * index, 10, 4 * index + 30, 115),
        Box(170 - 4 * index, 30, 200 - 4 * index, 90),
    )
    frame = Box(0, 0, *SHAPE[::-1])
    mask = np.zeros(SHAPE, np.bool_)
    for box, colour in ((far, (0.05, 0.4, 0.1)), (near, (0.5, 0.05, 0.05))):
        at = box.intersection(frame).slices_in(frame)
        light[at], mask[at] = colour, True
    return sqrt_light(light), mask, near.intersection(frame), far.intersection(frame)


def tracked(count=36):
    tracker = Tracker()
    for index in range(count):
        roots, mask, *_ = pair(index)
        detections = detect(mask)
        feet = [0.4 if one.foot[1] > 100 else 0.2 for one in detections]
        tracker.add(index, detections, feet, 0.3, (roots, mask))
    return tracker.states()


def test_two_merged_targets_are_segmented_by_their_colours_where_their_boxes_overlap():
    states_of = tracked()
    met = [index for index, states in states_of.items() if len(states) == 2 and len(
        {one.blob_box for one in states}) == 1]  # fmt: skip
    assert len(met) > 5
    frame = Box(0, 0, *SHAPE[::-1])
    for index in met:
        roots, mask, near, far = pair(index)
        targets = sorted(states_of[index], key=lambda one: one.disparity)
        blob_box = targets[0].blob_box
        shares = segment(
            [one.appearance for one in targets], [one.box for one in targets],
            roots[blob_box.slices_in(frame)], blob_box,
        )  # fmt: skip
        of_near = np.zeros(SHAPE, np.float32)
        of_near[blob_box.slices_in(frame)] = shares[1]
        true = np.zeros(SHAPE, np.bool_)
        true[near.slices_in(frame)] = True
        assert ((of_near > 0.5) == true)[mask].mean() > 0.95, index


def test_targets_that_split_again_are_told_by_their_colours():
    last = tracked(48)
    for index in (0, 3, 44, 46):
        _, _, near, _ = pair(index)
        for one in last[index]:
            assert one.in_front == float(one.box.intersection(near) == near), (index, one.box)


@pytest.mark.parametrize("blur", [1.0, 3.0])
def test_the_matte_of_a_blurred_card_is_its_coverage_and_nothing_of_the_background_stays(blur):
    light = scene()
    true = np.zeros(SHAPE, np.float32)
    true[20:100, 60:120] = 1.0
    true = cv2.GaussianBlur(true, (0, 0), blur)
    plate = (true[..., None] * RED + (1 - true[..., None]) * light).astype(np.float32)
    noise = np.full(SHAPE, 1 / 255, np.float32)
    share = soft_matte(plate, light, noise, true > 0.3, 3 * blur, 1.0)
    assert np.abs(share - true).mean() < 0.01
    assert np.percentile(np.abs(share - true), 99) < 0.2
    picture = ArrayPicture(plate, "rgb", LINEAR)
    whole = Box(0, 0, *SHAPE[::-1])
    moving = MovingMatte(box=whole, coverage=share, before=np.ones_like(share), background=light)
    matte = moving_mattes(picture, moving).before_object
    green = np.tile(np.array([0.1, 0.6, 0.1, 1.0], np.float32), (*SHAPE, 1))
    layer = behind(green, plate, matte.coverage, matte.light)
    seen = layer[..., :3] + (1 - layer[..., 3:]) * plate
    expected = true[..., None] * RED + (1 - true[..., None]) * green[..., :3]
    assert np.abs(seen - expected).mean() < 0.01


def test_what_stays_behind_hides_the_ground_alone():
    whole = Box(0, 0, *SHAPE[::-1])
    ones = np.ones(SHAPE, np.float32)
    moving = MovingMatte(box=whole, coverage=ones, before=0 * ones, background=scene())
    found = moving_mattes(ArrayPicture(scene(1)), moving)
    assert not found.before_object.coverage.any() and not found.before_object.light.any()
    assert (found.before_ground.coverage == 1.0).all()


def test_the_border_of_the_frame_is_no_foot_that_jumps_but_jumping_to_it_is():
    shown = np.ones((120, 200), np.bool_)
    shown[100:] = False  # the frame's lower border
    whole, coming, jumping = Box(0, 0, 200, 120), Tracker(), Tracker()
    for index in range(30):
        left = 20 + 3 * index
        border = 100 - index % 2 * 8  # as in the reference view of a hand-held camera
        frame = shown.copy()
        frame[border:] = False
        for tracker, bottom in ((coming, border), (jumping, 100 if index % 3 else 60)):
            mask = np.zeros((120, 200), np.bool_)
            mask[20:bottom, left : left + 40] = True
            detections = detect(mask, frame if tracker is coming else shown)
            assert detections[0].truncated == (bottom >= 92)
            tracker.add(index, detections, [0.3], 0.25)
    assert coming.steadiness(whole) == 1.0
    assert {states[0].in_front for states in coming.states().values()} == {1.0}
    assert jumping.steadiness(whole) < 0.6


def test_a_speck_on_the_ground_far_below_is_no_foot_of_the_body_above_it():
    mask = np.zeros((180, 320), np.bool_)
    mask[20:90, 100:130] = True
    mask[140:144, 110:114] = True
    (body,) = detect(mask)
    assert body.box == Box(100, 20, 130, 90) and not body.truncated
