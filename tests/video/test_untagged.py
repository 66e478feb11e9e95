"""Raw pictures that say nothing of their colours."""

import cv2
import numpy as np
import pytest
from support.clips import noise_frame, write_clip

from nlens_video.video.input.source import open_source


def clip(folder, pixel_format, codec="rawvideo", name="in.nut", **tags):
    frames = [noise_frame(32, 24, pixel_format, seed) for seed in range(2)]
    for frame in frames:
        for tag, value in tags.items():
            setattr(frame, tag, value)
    return write_clip(folder / name, frames, codec=codec)


def notes(path, **hints):
    with open_source(str(path), **hints) as source:
        return [note for note in source.info.notes if "no colour tags" in note]


def test_deep_raw_pictures_without_tags_are_noted_with_what_to_do(tmp_path):
    path = clip(tmp_path, "yuv420p10le")
    (note,) = notes(path)
    assert "BT.709" in note and "--input-transfer" in note
    assert notes(path, input_transfer="smpte2084") == []


@pytest.mark.parametrize(
    ("pixel_format", "codec", "name"),
    [("yuv420p", "rawvideo", "in.nut"), ("rgb48le", "rawvideo", "in.nut"),
     ("yuv420p10le", "ffv1", "in.mkv")],
)  # fmt: skip
def test_pictures_that_are_most_likely_what_they_are_taken_for_are_not_noted(
    tmp_path, pixel_format, codec, name
):
    assert notes(clip(tmp_path, pixel_format, codec, name)) == []


@pytest.mark.parametrize("kind", ["uint8", "uint16"])
@pytest.mark.parametrize("ending", ["tif", "png"])
def test_grey_picture_without_a_tag_is_srgb(tmp_path, ending, kind):
    """FFmpeg calls every grey TIFF one of gamma 2.2."""
    cv2.imwrite(str(tmp_path / f"in.{ending}"), np.full((48, 64), 90, kind))
    with open_source(str(tmp_path / f"in.{ending}")) as source:
        assert source.info.tags.transfer == "iec61966-2-1"
