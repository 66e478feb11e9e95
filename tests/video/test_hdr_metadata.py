"""HDR metadata of a plate: carried over by the encoders that can be told, else noted."""

import struct

import pytest
from av.sidedata.sidedata import Type
from support.clips import copy, noise_frame, write_clip

from nlens_video.video.hdr_metadata import HdrMetadata, hdr_metadata
from nlens_video.video.input.source import open_source
from nlens_video.video.output.hdr_parameters import with_hdr

DISPLAY = "master-display=G(13250,34500)B(7500,3000)R(34000,16000)WP(15635,16450)L(10000000,50)"
LIGHT = "max-cll=1000,400"
LOST = "HDR mastering metadata is not carried over"


def clip(folder, *parameters, name="in.mkv"):
    """A clip of HEVC with parameters of x265."""
    return write_clip(
        folder / name, [noise_frame(64, 48, "yuv420p10le", seed) for seed in range(4)],
        codec="libx265", options={"x265-params": ":".join(("log-level=error", *parameters))},
    )  # fmt: skip


def hdr(path):
    with open_source(str(path)) as source:
        return source.info.hdr


def about(numbers):
    return pytest.approx([float(one) for one in numbers], rel=0.3, abs=2e-5)


@pytest.mark.parametrize("told", [(DISPLAY, LIGHT), (DISPLAY,), (LIGHT,)])
@pytest.mark.parametrize("name", ["out.mp4", "out.mkv"])
def test_hevc_keeps_mastering_display_and_light_levels_to_the_bit(tmp_path, name, told):
    plate = clip(tmp_path, *told)
    notes = copy(plate, tmp_path / name)
    was = hdr(plate)
    assert (was.mastering is not None, was.light) == (
        DISPLAY in told, (1000, 400) if LIGHT in told else None,
    )  # fmt: skip
    assert hdr(tmp_path / name) == was
    assert LOST not in notes


@pytest.mark.parametrize("codec", ["libx264", "libsvtav1"])
def test_other_encoders_keep_mastering_display_and_light_levels(tmp_path, codec):
    plate, out = clip(tmp_path, DISPLAY, LIGHT), tmp_path / "out.mkv"
    notes = copy(plate, out, codec=codec)
    was, has = hdr(plate), hdr(out)
    assert has.light == was.light == (1000, 400)
    for side in ("red", "green", "blue", "white"):
        assert getattr(has.mastering, side) == about(getattr(was.mastering, side))
    # AV1 has steps of 1/16384 cd/m² for the least luminance
    assert float(has.mastering.luminance[0]) == pytest.approx(0.005, abs=1 / 16384)
    assert has.mastering.luminance[1] == 1000
    assert LOST not in notes


@pytest.mark.parametrize("name", ["out.webm", "out.nut", "out_%04d.jpg"])
@pytest.mark.parametrize("mastered", [False, True])
def test_loss_of_mastering_metadata_is_noted(tmp_path, name, mastered):
    plate = clip(tmp_path, *((DISPLAY, LIGHT) if mastered else ()))
    notes = copy(plate, tmp_path / name, codec="ffv1" if name.endswith("nut") else None)
    assert (LOST in notes) == mastered


@pytest.mark.parametrize("name", ["out_%d.png", "out.apng"])
def test_png_keeps_mastering_display_and_light_levels(tmp_path, name):
    plate = clip(tmp_path, DISPLAY, LIGHT)
    assert LOST not in copy(plate, tmp_path / name)
    made = (tmp_path / name.replace("%d", "0")).read_bytes()
    assert b"mDCV" in made and b"cLLI" in made


def side_data(**data):
    return {Type[name]: value for name, value in data.items()}


def test_mastering_display_without_its_luminance_is_lost_and_noted():
    half = side_data(MASTERING_DISPLAY_METADATA=struct.pack("=22i", *[1] * 20, 1, 0))
    assert hdr_metadata(half) == HdrMetadata(partial=True)
    assert with_hdr({}, "libx265", hdr_metadata(half)) == ({}, (LOST,))


def test_dynamic_metadata_is_lost_and_noted_by_name():
    found = hdr_metadata(side_data(DYNAMIC_HDR_PLUS=b"", DOVI_METADATA=b"", DOVI_RPU_BUFFER=b""))
    _, notes = with_hdr({}, "libx265", found)
    assert notes == (
        "Dolby Vision metadata is not carried over", "HDR10+ metadata is not carried over",
    )  # fmt: skip
