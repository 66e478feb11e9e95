"""Targets in a merged blob: where each is, before they merge, while they do and afterwards."""

import cv2
import numpy as np
import pytest

from nlens_video.core.layers import Box
from nlens_video.effects.foreground.appearance import AppearanceModel
from nlens_video.effects.foreground.background import sqrt_light
from nlens_video.effects.foreground.detection import detect
from nlens_video.effects.foreground.mutual_occlusion import MergedTarget, _Moved, localize
from nlens_video.effects.foreground.tracker import Tracker

SHAPE = (120, 260)
FRAME = Box(0, 0, *SHAPE[::-1])
RED, GREEN = (0.5, 0.05, 0.05), (0.05, 0.4, 0.1)
NEAR_FOOT, FAR_FOOT, OBJECT = 0.4, 0.2, 0.3


def image(*targets):
    """Roots of light and mask of a frame with targets (box, colour), the farthest first."""
    coarse = np.random.default_rng(0).uniform(0.1, 0.5, (12, 26, 3)).astype(np.float32)
    light = cv2.resize(coarse, SHAPE[::-1], interpolation=cv2.INTER_CUBIC).clip(0.05, 0.8)
    mask = np.zeros(SHAPE, np.bool_)
    for box, colour in targets:
        at = box.intersection(FRAME).slices_in(FRAME)
        light[at], mask[at] = colour, True
    return sqrt_light(light), mask


def near_box(left):
    return Box(left, 10, left + 34, 110)


def far_box(left):
    return Box(left, 30, left + 24, 85)


def tracked(frames):
    """Tracker of frames: (number, roots of light, mask) each."""
    tracker = Tracker()
    for index, roots, mask in frames:
        detections = detect(mask)
        feet = [NEAR_FOOT if one.foot[1] > 95 else FAR_FOOT for one in detections]
        tracker.add(index, detections, feet, OBJECT, (roots, mask))
    return tracker


def steadiness(tracker, region, remaining):
    """That of a tracker, from all frames of all tracks."""
    judged = [
        one for one in tracker._tracks
        if len(one.frames) >= 8 and one.travels
        and any(not box.intersection(region).empty for box in one.boxes)
    ]  # fmt: skip
    areas = [float(np.median([box.width * box.height for box in one.boxes])) for one in judged]
    frames = sum(area * len(one.frames) for area, one in zip(areas, judged, strict=True))
    jumps = sum(area * one.jump_count for area, one in zip(areas, judged, strict=True))
    return 1.0 - jumps / ((1.0 + remaining) * frames) if frames else 1.0


def test_steadiness_after_each_frame_is_that_of_the_whole_history_through_merging_and_splitting():
    region, tracker, seen = Box(90, 0, 170, 120), Tracker(), set()
    for index in range(70):
        up = 10 if index % 9 == 8 else 0  # it jumps
        targets = [
            (far_box(104 + index).translated(0, -up), GREEN),
            (near_box(110 - 2 * index), RED),
        ]
        if index >= 45:  # somebody else follows
            targets.append((near_box(6 * index - 270), RED))
        roots, mask = image(*targets)
        feet = [NEAR_FOOT if one.foot[1] > 95 else FAR_FOOT for one in detect(mask)]
        tracker.add(index, detect(mask), feet, OBJECT, (roots, mask))
        for remaining in (0.0, 1.5):
            got = tracker.steadiness(region, remaining)
            assert got == steadiness(tracker, region, remaining)
            seen.add(got)
    assert len(seen) > 10 and min(seen) < 1.0


def centres(states):
    """Centres of the targets in front of the object, and of those behind it."""
    columns = {0.0: [], 1.0: []}
    for one in states:
        columns[one.in_front].append(0.5 * (one.box.x0 + one.box.x1))
    return columns[1.0], columns[0.0]


@pytest.mark.slow
@pytest.mark.parametrize(("near_speed", "far_speed", "far_start"), [(5, 3, 60), (4, -3, 190)])
def test_of_two_targets_that_cross_each_keeps_its_order_and_its_place(
    near_speed, far_speed, far_start
):
    count = 45
    places = [(10 + near_speed * i, far_start + far_speed * i) for i in range(count)]
    frames = [
        (i, *image((far_box(far), GREEN), (near_box(near), RED)))
        for i, (near, far) in enumerate(places)
    ]
    found = tracked(frames).states()
    for index, (near, far) in enumerate(places[:-1]):
        in_front, behind = centres(found[index])
        assert in_front == pytest.approx([near + 17], abs=5), index
        hidden = near <= far <= near + 10
        if behind or not hidden:
            assert behind == pytest.approx([far + 12], abs=14 if hidden else 6), index


@pytest.mark.slow
def test_a_target_that_splits_off_is_backtracked_to_the_frames_before():
    places = [(110 - 2 * i, 104 + i) for i in range(40)]  # merged on the first ten frames
    frames = [
        (i, *image((far_box(far), GREEN), (near_box(near), RED)))
        for i, (near, far) in enumerate(places)
    ]
    assert len(detect(frames[4][2])) == 1 and len(detect(frames[25][2])) == 2
    found = tracked(frames).states()
    for index in range(4, 39):
        near, far = places[index]
        in_front, behind = centres(found[index])
        assert in_front == pytest.approx([near + 17], abs=6), index
        assert behind == pytest.approx([far + 12], abs=7), index


def test_feet_that_are_separate_from_the_body_now_and_then_are_its_fragments():
    frames = []
    for index in range(40):
        roots, mask = image((near_box(10 + 4 * index), RED))
        if index % 7 == 6:  # the ground's colour hides the legs
            mask[50:103] = False
        frames.append((index, roots, mask))
    tracker = tracked(frames)
    assert tracker.steadiness(FRAME) == 1.0
    for index, states in tracker.states().items():
        assert {one.in_front for one in states} == {1.0}
        assert len({one.blob_box for one in states}) == (2 if index % 7 == 6 else 1)


def test_targets_are_localized_where_colours_and_silhouettes_explain_the_blob():
    roots, mask = image((far_box(100), GREEN), (near_box(85), RED))
    near, far = AppearanceModel(), AppearanceModel()
    near.update(*image((near_box(20), RED)), near_box(20))
    far.update(*image((far_box(200), GREEN)), far_box(200))
    targets = [MergedTarget(near, near_box(79)), MergedTarget(far, far_box(106))]
    (first, second) = localize(targets, roots, mask, Box(85, 10, 124, 110))
    assert abs(first.box.x0 - 85) <= 1 and abs(second.box.x0 - 100) <= 1
    assert first.visibility > 0.85 and second.visibility < 0.4
    assert min(first.evidence, second.evidence) > 8.0


def test_each_shift_of_a_target_that_is_searched_is_its_coverage_there():
    model = AppearanceModel()
    model.update(*image((near_box(20), RED)), near_box(20))
    target, window = MergedTarget(model, near_box(79)), Box(40, 3, 141, 117)
    moved = _Moved.of(target, window)
    for shift in range(-moved.reach, moved.reach + 1):
        expected = model.coverage(near_box(79 + shift), window)
        np.testing.assert_allclose(moved.by(shift), expected, atol=1e-6)


def test_a_target_that_is_not_there_gets_no_evidence():
    roots, mask = image((near_box(85), RED))
    near, far = AppearanceModel(), AppearanceModel()
    near.update(*image((near_box(20), RED)), near_box(20))
    far.update(*image((far_box(200), GREEN)), far_box(200))
    targets = [MergedTarget(near, near_box(85)), MergedTarget(far, far_box(90))]
    found = localize(targets, roots, mask, near_box(85))
    assert found[1].evidence < 2.0 < found[0].evidence


def test_what_an_appearance_model_learnt_can_be_removed():
    roots, mask = image((near_box(20), RED), (far_box(120), GREEN))
    once, twice = AppearanceModel(), AppearanceModel()
    once.update(roots, mask, near_box(20))
    twice.update(roots, mask, near_box(20))
    twice.update(roots, mask, far_box(120))
    twice.update(roots, mask, far_box(120), weight=-1)
    assert np.array_equal(once.histogram, twice.histogram) and once.samples == twice.samples
    np.testing.assert_allclose(once.silhouette, twice.silhouette, atol=1e-6)


def test_limbs_that_swing_beside_the_body_count_as_motion():
    frames = []
    for index in range(30):
        body, swing = near_box(10 + 2 * index), 6 * (index % 2)
        legs = Box(body.x0 - swing, 70, body.x1 + swing, body.y1)
        frames.append((index, *image((body, RED), (legs, RED))))
    states = [one for each in tracked(frames).states().values() for one in each]
    assert {one.displacement_px for one in states[1:]} == {8.0}  # 2 of the body, 6 of the legs
