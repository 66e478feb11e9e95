"""Raw pictures that say nothing of their colours."""

import zlib

import cv2
import numpy as np
import pytest
from support.clips import noise_frame, write_clip

from nlens_video.core.errors import InputError
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


@pytest.mark.parametrize(("mark", "name"), [(1, "printing density"), (3, "logarithmic"), (2, "")])
def test_logarithmic_dpx_is_refused_by_name(tmp_path, mark, name):
    path = write_clip(tmp_path / "in.dpx", [noise_frame(32, 24, "rgb24")], codec="dpx")
    data = bytearray(path.read_bytes())
    data[801] = mark
    path.write_bytes(data)
    if name:
        with pytest.raises(InputError, match=f"transfer {name}, which is not supported"):
            open_source(str(path))
    with open_source(str(path), input_transfer="iec61966-2-1") as source:
        assert source.info.tags.transfer == "iec61966-2-1"


@pytest.mark.parametrize(("gamma", "noted"), [(55556, True), (45455, False)])
def test_gamma_of_a_png_that_is_not_followed_is_noted(tmp_path, gamma, noted):
    cv2.imwrite(str(tmp_path / "in.png"), np.full((24, 32, 3), 90, np.uint8))
    data = (tmp_path / "in.png").read_bytes()
    chunk = b"gAMA" + gamma.to_bytes(4, "big")
    made = len(chunk[4:]).to_bytes(4, "big") + chunk + zlib.crc32(chunk).to_bytes(4, "big")
    (tmp_path / "in.png").write_bytes(data[:33] + made + data[33:])
    with open_source(str(tmp_path / "in.png")) as source:
        assert any("gamma of 1.8" in note for note in source.info.notes) == noted
