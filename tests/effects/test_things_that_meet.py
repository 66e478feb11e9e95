"""Things that make one region: where each is, before they meet, while they do and afterwards."""

import cv2
import numpy as np
import pytest

from nlens_video.core.layers import Box
from nlens_video.effects.foreground.background import root
from nlens_video.effects.foreground.looks import Look
from nlens_video.effects.foreground.meeting import Member, place
from nlens_video.effects.foreground.things import find_things
from nlens_video.effects.foreground.tracks import Tracks

SHAPE = (120, 260)
FRAME = Box(0, 0, *SHAPE[::-1])
RED, GREEN = (0.5, 0.05, 0.05), (0.05, 0.4, 0.1)
NEAR_FOOT, FAR_FOOT, OBJECT = 0.4, 0.2, 0.3


def picture(*things):
    """Roots of light and mask of a frame with things (box, colour), the farthest first."""
    coarse = np.random.default_rng(0).uniform(0.1, 0.5, (12, 26, 3)).astype(np.float32)
    light = cv2.resize(coarse, SHAPE[::-1], interpolation=cv2.INTER_CUBIC).clip(0.05, 0.8)
    mask = np.zeros(SHAPE, np.bool_)
    for box, colour in things:
        at = box.intersection(FRAME).slices_in(FRAME)
        light[at], mask[at] = colour, True
    return root(light), mask


def near_box(left):
    return Box(left, 10, left + 34, 110)


def far_box(left):
    return Box(left, 30, left + 24, 85)


def followed(frames):
    """What is known of frames: (number, roots of light, mask) each."""
    tracks = Tracks()
    for index, roots, mask in frames:
        things = find_things(mask)
        feet = [NEAR_FOOT if one.foot[1] > 95 else FAR_FOOT for one in things]
        tracks.add(index, things, feet, OBJECT, (roots, mask))
    return tracks


def orders(things):
    """Middles of what is before the object, and of what is behind it."""
    middles = {0.0: [], 1.0: []}
    for one in things:
        middles[one.before].append(0.5 * (one.box.x0 + one.box.x1))
    return middles[1.0], middles[0.0]


@pytest.mark.slow
@pytest.mark.parametrize(("near_speed", "far_speed", "far_start"), [(5, 3, 60), (4, -3, 190)])
def test_of_two_who_pass_each_keeps_its_order_and_its_place(near_speed, far_speed, far_start):
    count = 45
    places = [(10 + near_speed * i, far_start + far_speed * i) for i in range(count)]
    frames = [
        (i, *picture((far_box(far), GREEN), (near_box(near), RED)))
        for i, (near, far) in enumerate(places)
    ]
    found = followed(frames).ordered()
    for index, (near, far) in enumerate(places[:-1]):
        before, behind = orders(found[index])
        assert before == pytest.approx([near + 17], abs=5), index
        hidden = near <= far <= near + 10
        if behind or not hidden:
            assert behind == pytest.approx([far + 12], abs=14 if hidden else 6), index


@pytest.mark.slow
def test_who_comes_in_before_another_and_leaves_them_later_is_found_on_the_frames_before():
    places = [(110 - 2 * i, 104 + i) for i in range(40)]  # one region on the first ten frames
    frames = [
        (i, *picture((far_box(far), GREEN), (near_box(near), RED)))
        for i, (near, far) in enumerate(places)
    ]
    assert len(find_things(frames[4][2])) == 1 and len(find_things(frames[25][2])) == 2
    found = followed(frames).ordered()
    for index in range(4, 39):
        near, far = places[index]
        before, behind = orders(found[index])
        assert before == pytest.approx([near + 17], abs=6), index
        assert behind == pytest.approx([far + 12], abs=7), index


def test_feet_that_are_parted_from_the_body_now_and_then_are_no_other_thing():
    frames = []
    for index in range(40):
        roots, mask = picture((near_box(10 + 4 * index), RED))
        if index % 7 == 6:  # the ground's colour hides the legs
            mask[50:103] = False
        frames.append((index, roots, mask))
    tracks = followed(frames)
    assert tracks.steadiness(FRAME) == 1.0
    for index, things in tracks.ordered().items():
        assert {one.before for one in things} == {1.0}
        assert len({one.region for one in things}) == (2 if index % 7 == 6 else 1)


def test_places_are_those_at_which_colours_and_outlines_explain_the_region():
    roots, mask = picture((far_box(100), GREEN), (near_box(85), RED))
    near, far = Look(), Look()
    near.add(*picture((near_box(20), RED)), near_box(20))
    far.add(*picture((far_box(200), GREEN)), far_box(200))
    members = [Member(near, near_box(79)), Member(far, far_box(106))]
    (first, second) = place(members, roots, mask, Box(85, 10, 124, 110))
    assert abs(first.box.x0 - 85) <= 1 and abs(second.box.x0 - 100) <= 1
    assert first.seen > 0.85 and second.seen < 0.4
    assert min(first.evidence, second.evidence) > 8.0


def test_one_who_is_not_there_gets_no_evidence():
    roots, mask = picture((near_box(85), RED))
    near, far = Look(), Look()
    near.add(*picture((near_box(20), RED)), near_box(20))
    far.add(*picture((far_box(200), GREEN)), far_box(200))
    members = [Member(near, near_box(85)), Member(far, far_box(90))]
    placed = place(members, roots, mask, near_box(85))
    assert placed[1].evidence < 2.0 < placed[0].evidence


def test_what_is_learnt_of_a_look_can_be_taken_back():
    roots, mask = picture((near_box(20), RED), (far_box(120), GREEN))
    once, twice = Look(), Look()
    once.add(roots, mask, near_box(20))
    twice.add(roots, mask, near_box(20))
    twice.add(roots, mask, far_box(120))
    twice.add(roots, mask, far_box(120), times=-1)
    assert np.array_equal(once.counts, twice.counts) and once.pictures == twice.pictures
    np.testing.assert_allclose(once.shape, twice.shape, atol=1e-6)


def test_limbs_that_swing_beside_the_body_count_as_motion():
    frames = []
    for index in range(30):
        body, swing = near_box(10 + 2 * index), 6 * (index % 2)
        legs = Box(body.x0 - swing, 70, body.x1 + swing, body.y1)
        frames.append((index, *picture((body, RED), (legs, RED))))
    things = [one for each in followed(frames).ordered().values() for one in each]
    assert {one.moved_px for one in things[1:]} == {8.0}  # 2 of the body, 6 of the legs
