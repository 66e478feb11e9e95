"""A person is found around a point."""

import cv2
import numpy as np
import pytest

from nlens_video.core.errors import InputError
from nlens_video.solve.person_box import find_person

pytestmark = pytest.mark.slow
SIZE = 640, 360


def street(figures):
    """A plate of mottled ground and wall (H, W) with figures (middle, head row, feet row)."""
    rng = np.random.default_rng(3)
    noise = rng.normal(0.0, 1.0, (SIZE[1] // 4, SIZE[0] // 4)).astype(np.float32)
    plate = 140.0 + 8.0 * cv2.resize(noise, SIZE, interpolation=cv2.INTER_CUBIC)
    plate[: SIZE[1] // 3] += 30.0
    for middle, head, feet in figures:
        tall = feet - head

        def at(x, y, middle=middle, head=head, tall=tall):
            return round(middle + x * tall), round(head + y * tall)

        wide = round(0.06 * tall)
        for side in (-1, 1):
            cv2.line(plate, at(0.05 * side, 0.5), at(0.09 * side, 0.97), 40.0, wide, cv2.LINE_AA)
            cv2.line(plate, at(0.09 * side, 0.2), at(0.14 * side, 0.5), 60.0, wide, cv2.LINE_AA)
        body = np.array([at(-0.1, 0.17), at(0.1, 0.17), at(0.08, 0.53), at(-0.08, 0.53)])
        cv2.fillConvexPoly(plate, body, 70.0, cv2.LINE_AA)
        cv2.ellipse(plate, at(0.0, 0.07), (round(0.05 * tall), round(0.07 * tall)), 0, 0, 360, 90.0,
                    -1, cv2.LINE_AA)  # fmt: skip
    return np.clip(cv2.GaussianBlur(plate, (0, 0), 0.8), 0, 255).astype(np.uint8)


@pytest.mark.parametrize("figure", [(200, 60, 260), (420, 120, 340), (600, 150, 300)])
def test_head_and_feet_are_found_to_a_tenth_of_the_height(figure):
    middle, head, feet = figure
    plate = street([figure])
    box = find_person(plate, (middle / SIZE[0], 0.5 * (head + feet) / SIZE[1]))
    tall = feet - head
    assert box[1] * SIZE[1] == pytest.approx(head, abs=0.1 * tall)
    assert box[3] * SIZE[1] == pytest.approx(feet, abs=0.1 * tall)
    assert box[0] * SIZE[0] < middle < box[2] * SIZE[0] + 1


def test_of_two_people_the_one_under_the_point_is_taken():
    plate = street([(180, 60, 260), (460, 150, 300)])
    box = find_person(plate, (460 / SIZE[0], 220 / SIZE[1]))
    assert (box[3] - box[1]) * SIZE[1] == pytest.approx(150, abs=20)


def test_a_point_on_nobody_is_refused_with_what_to_give():
    with pytest.raises(InputError, match="no upright person is found around 0.8,0.5"):
        find_person(street([(180, 60, 260)]), (0.8, 0.5))
