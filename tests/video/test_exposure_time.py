"""The exposure time that recordings state decides how long the shutter is open."""

import PIL.Image
import pytest
from PIL.TiffImagePlugin import IFDRational
from support import shots

from nlens_video.graph.effect_plan import LensRequest
from nlens_video.options.parser import parse
from nlens_video.options.to_settings import settings
from nlens_video.run.render import plan
from nlens_video.video.exposure_time import exposure_time_s
from nlens_video.video.input.source import open_source

EXIF, EXPOSURE_TIME = 34665, 33434


@pytest.mark.parametrize(
    ("tags", "seconds"),
    [
        ({"ExifIFD/ExposureTime": "1:250"}, 0.004),
        ({"ExposureTime": "0.008"}, 0.008),
        ({"com.example.exposure-time": "1/50 s"}, 0.02),
        ({"expTime": "0"}, None),
        ({"ExposureTime": "long"}, None),
        ({"title": "1/50"}, None),
    ],
)
def test_exposure_time_is_read_from_tags(tags, seconds):
    assert exposure_time_s(tags) == (None if seconds is None else pytest.approx(seconds))


def test_stated_exposure_is_the_shutter_unless_one_is_given_or_it_is_longer_than_a_frame():
    assert LensRequest(frame_s=1 / 25, exposure_s=1 / 250).shutter.angle_deg == pytest.approx(36.0)
    assert LensRequest(frame_s=1 / 25, exposure_s=0.5).shutter.source == "assumed"
    given = LensRequest(frame_s=1 / 25, exposure_s=1 / 250, shutter_deg=90.0).shutter
    assert given.given and given.angle_deg == 90.0


def test_exposure_time_of_a_sequence_of_photographs_is_used(tmp_path):
    exif = PIL.Image.Exif()
    exif.get_ifd(EXIF)[EXPOSURE_TIME] = IFDRational(1, 200)
    for index in range(3):
        PIL.Image.fromarray(shots.plate()).save(tmp_path / f"in_{index:02d}.jpg", exif=exif)
    with open_source(str(tmp_path / "in_%02d.jpg")) as source:
        assert exposure_time_s(source.info.camera_tags) == pytest.approx(0.005)
    glb = shots.cube_glb(tmp_path / "anim.glb", end=(0.5, 0.0, -1.6))
    words = [str(tmp_path / "in_%02d.jpg"), str(glb), str(tmp_path / "out_%02d.png")]
    assert any(
        "(45 degrees or 0.005 s, from metadata)" in line
        for line in plan(settings(parse([*words, "--input-rate", "25"])))
    )
