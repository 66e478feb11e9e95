"""What several effects read off a shot's first pictures."""

import gc
import weakref

import numpy as np
from support.effects.synthetic_frames import pictures, scene

from nlens_video.effects.measurement import PLATE_EFFECTS, measure_plate
from nlens_video.effects.plate_pictures import PlatePictures
from nlens_video.video.pixels.picture import ArrayPicture


class CountedPicture(ArrayPicture):
    """A picture that counts how often it is decoded."""

    coded = light = 0

    def srgb(self):
        self.coded += 1
        return super().srgb()

    def linear(self, box):
        self.light += 1
        return super().linear(box)


def test_pictures_are_decoded_once_for_all_effects():
    shot = [CountedPicture(np.uint8(255 * one.srgb()), "rgb") for one in pictures(scene(2), 8)]
    found = measure_plate(set(PLATE_EFFECTS), shot)
    assert list(found) == list(PLATE_EFFECTS)
    assert [picture.coded for picture in shot] == [1] * 5 + [0] * 3
    assert [picture.light for picture in shot] == [1] + [0] * 7


def test_decoded_pictures_are_freed_with_what_holds_them():
    """The collector of cycles comes late: it counts objects, not their size."""
    shot = PlatePictures([ArrayPicture(np.zeros((64, 96, 3), np.uint8), "rgb")])
    left = [weakref.ref(one) for one in (shot.codes(), shot.light())]
    gc.disable()
    try:
        del shot
        assert [one() for one in left] == [None, None]
    finally:
        gc.enable()


def test_only_the_middle_of_a_large_picture_is_compared():
    rng = np.random.default_rng(0)
    large = ArrayPicture(rng.integers(0, 255, (900, 1400, 3), np.uint8), "rgb")
    (first,), same = PlatePictures([large]).still()
    assert first.shape == (720, 1280, 3) and same.shape == (720, 1280)
    assert np.array_equal(first, large.srgb()[90:-90, 60:-60])


def test_measured_pictures_are_a_sequence_of_pictures():
    shot = pictures(scene(2), 3)
    plate = PlatePictures(shot)
    assert PlatePictures.of(plate) is plate
    assert list(plate) == shot and plate[1:] == shot[1:] and len(plate) == 3
