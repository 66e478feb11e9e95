"""Aperture and focus that recordings state: read, combined with the plate, or left out."""

import json
import math

import PIL.Image
import pytest
from PIL.TiffImagePlugin import IFDRational
from support import shots

from nlens_video.cli.main import main
from nlens_video.core.known_lens import UNKNOWN_LENS, KnownLens
from nlens_video.core.lens_fit import LensFit
from nlens_video.video.input.source import open_source
from nlens_video.video.lens_tags import tagged_lens

EXIF, F_NUMBER, FOCAL_LENGTH, SUBJECT_DISTANCE, LENS_MODEL = 34665, 33437, 37386, 37382, 42036
FOCUS_M = -shots.SLOPE / shots.INTERCEPT
APERTURE_MM = 1000 * shots.SLOPE * math.tan(0.5 * shots.YFOV) / (0.5 * shots.HEIGHT)


@pytest.mark.parametrize(
    ("tags", "lens"),
    [
        ({"ExifIFD/FNumber": "28:10", "ExifIFD/FocalLength": "50:1"}, (50.0, 2.8, None)),
        ({"ExifIFD/ApertureValue": "3:1", "FocalLength": "35"}, (35.0, 2.0**1.5, None)),
        ({"ExifIFD/LensModel": "iPhone 13 back camera 5.7mm f/1.6"}, (5.7, 1.6, None)),
        ({"com.apple.quicktime.camera.lens_model": "iPhone 15 Pro back camera 6.765mm f/1.78"},
         (6.765, 1.78, None)),
        ({"ExifIFD/SubjectDistance": "24:10"}, (None, None, 2.4)),
        ({"ExifIFD/SubjectDistance": "4294967295:1"}, (None, None, math.inf)),
        ({"ExifIFD/SubjectDistance": "     -1:1      "}, (None, None, math.inf)),
        ({"SubjectDistance": "160 cm"}, (None, None, 1.6)),
        ({"FNumber": "f/2.0", "FocalLength": "50 mm"}, (50.0, 2.0, None)),
        ({"FNumber": "4", "LensModel": "RF 50 mm f/1.8"}, (50.0, 4.0, None)),
    ],
)  # fmt: skip
def test_lens_is_read_from_tags(tags, lens):
    found = tagged_lens(tags)
    assert (found.focal_mm, found.f_number, found.focus_m) == pytest.approx(lens)


@pytest.mark.parametrize(
    "tags",
    [
        {}, {"ExifIFD/FNumber": "0:1", "ExifIFD/FocalLength": "0:1"},  # an adapted lens
        {"ExifIFD/SubjectDistance": "0:10"}, {"LensModel": "EF70-200mm f/2.8L IS USM"},
        {"ExifIFD/FNumber": "wide open"}, {"title": "50mm f/2.8"},
    ],
)  # fmt: skip
def test_tags_without_a_lens_tell_none(tags):
    assert tagged_lens(tags) == UNKNOWN_LENS


def test_a_lens_that_is_given_goes_before_the_one_of_the_tags():
    tagged = tagged_lens({"FNumber": "4", "FocalLength": "50", "SubjectDistance": "3"})
    told = KnownLens(focal_mm=50.0, f_number=2.8).completed_by(tagged)
    assert (told.f_number, told.focus_m) == (2.8, 3.0)
    assert told.aperture_error < tagged.aperture_error and told.focus_error == tagged.focus_error


@pytest.mark.parametrize("told", [KnownLens(f_number=2.8), KnownLens(focal_mm=50.0)], ids=str)
def test_a_part_that_is_given_is_completed_by_the_tags(told):
    tagged = tagged_lens({"FNumber": "2.8", "FocalLength": "50"})
    whole = told.completed_by(tagged)
    assert (whole.focal_mm, whole.f_number) == (50.0, 2.8)
    assert whole.aperture_error == tagged.aperture_error


def fitted(tmp_path, rgb, f_number, focus_m=FOCUS_M):
    exif = PIL.Image.Exif()
    tags = exif.get_ifd(EXIF)
    tags[FOCAL_LENGTH] = IFDRational(50)
    tags[F_NUMBER] = IFDRational(round(1000 * f_number), 1000)
    tags[SUBJECT_DISTANCE] = IFDRational(round(1000 * focus_m), 1000)
    plate, kept = tmp_path / "in.jpg", tmp_path / "fit.json"
    PIL.Image.fromarray(rgb).save(plate, exif=exif, quality=97)
    with open_source(str(plate)) as source:
        assert tagged_lens(source.info.camera_tags).focus_m == pytest.approx(focus_m, rel=1e-3)
    code = main(["fit", str(plate), str(shots.cube_glb(tmp_path / "cube.glb")), str(kept)])
    return code, LensFit.load(kept) if code == 0 else None


@pytest.mark.slow
def test_photograph_whose_ground_tells_nothing_takes_the_lens_of_its_metadata(tmp_path, capsys):
    code, fit = fitted(tmp_path, shots.grey(), 50.0 / APERTURE_MM)
    assert code == 0
    assert fit.slope == pytest.approx(shots.SLOPE, rel=0.05)
    assert fit.intercept == pytest.approx(shots.INTERCEPT, rel=0.05)
    said = "".join(capsys.readouterr())
    assert "the plate tells nothing of its lens; it is that of the metadata" in said
    assert "CoC of the object" in said


@pytest.mark.slow
def test_lens_of_the_metadata_is_combined_with_the_plate(tmp_path):
    code, fit = fitted(tmp_path, shots.plate(), 50.0 / APERTURE_MM)
    assert code == 0
    assert (
        "with the lens of the metadata" in json.loads((tmp_path / "fit.json").read_text())["method"]
    )
    assert fit.slope == pytest.approx(shots.SLOPE, rel=0.05)


@pytest.mark.slow
def test_lens_of_the_metadata_that_contradicts_the_plate_is_left_out_and_said(tmp_path, capsys):
    code, fit = fitted(tmp_path, shots.plate(), 8 * 50.0 / APERTURE_MM, 40.0)
    assert code == 0
    assert fit.slope == pytest.approx(shots.SLOPE, rel=0.1)
    assert "metadata's lens does not go with the plate's blur" in "".join(capsys.readouterr())
