"""A plate that was shifted, blurred, sharpened or recoloured as a whole is reported as that."""

import cv2
import numpy as np
import pytest
from support import takes

from nlens_video.check.command import compare
from nlens_video.core.settings import SourceSettings

BT601 = np.array([[0.299, 0.587, 0.114], [-0.1687, -0.3313, 0.5], [0.5, -0.4187, -0.0813]])
BT709 = np.array([[0.2126, 0.7152, 0.0722], [-0.1146, -0.3854, 0.5], [0.5, -0.4542, -0.0458]])


def blurred(picture, sigma):
    return cv2.GaussianBlur(picture, (0, 0), sigma)


def sharp():
    """A plate of sharp texture and strong colours."""
    noise = np.random.default_rng(3).random((48, 80, 3), np.float32)
    return 0.2 + 0.6 * cv2.resize(noise, (takes.WIDTH, takes.HEIGHT))


def said(folder, edit):
    source = takes.encode(folder / "in.mp4", [sharp()] * 6, audio=False)
    pictures = [edit(takes.with_object(one, n)) for n, one in enumerate(takes.decode(source))]
    result = takes.encode(folder / "out.mp4", pictures, crf=23, audio=False)
    found = compare(str(result), SourceSettings(spec=str(source))).verdict.of("plate")
    return [one.text for one in found if one.text.startswith("frames 0 to 5: the whole plate")]


@pytest.mark.parametrize(
    ("edit", "words"),
    [
        (lambda one: np.roll(one, 1, axis=1), "px beside its place"),
        (lambda one: blurred(one, 1.0), "detail: it is blurred"),
        (lambda one: blurred(one, 2.0), "detail: it is blurred"),
        (lambda one: 2.0 * one - blurred(one, 1.5), "detail: it is blurred or sharpened"),
        (lambda one: np.clip(one @ (np.linalg.inv(BT709) @ BT601).T, 0, 1), "has other"),
    ],
    ids=["shifted", "blurred", "blurred more", "sharpened", "another matrix"],
)
def test_plate_that_is_changed_as_a_whole_is_reported(tmp_path, edit, words):
    (text,) = said(tmp_path, edit)
    assert words in text


def test_plate_that_was_only_encoded_is_not_reported(tmp_path):
    assert said(tmp_path, lambda one: one) == []
