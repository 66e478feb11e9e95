"""`--lens` on the command line: the fit of a plate that tells little or nothing."""

import json
import re

import numpy as np
import pytest
from support import shots

from nlens_video.cli.main import main
from nlens_video.core.lens_fit import LensFit


def fitted(tmp_path, rgb, *options):
    plate = shots.write_png(tmp_path / "in.png", rgb)
    glb, kept = shots.cube_glb(tmp_path / "cube.glb"), tmp_path / "fit.json"
    code = main(["fit", str(plate), str(glb), str(kept), *options])
    return code, LensFit.load(kept) if code == 0 else None


def words_of_the_lens(f_number_factor=1.0):
    """The lens of `shots.plate`: its slope is focal length [px] times aperture [m]."""
    focal_px = 0.5 * shots.HEIGHT / np.tan(0.5 * shots.YFOV)
    aperture_mm = 1000 * shots.SLOPE / focal_px
    number = 50.0 / aperture_mm * f_number_factor
    return f"50mm f/{number:.6f} focus {-shots.SLOPE / shots.INTERCEPT:.6f}m"


@pytest.mark.slow
def test_plate_without_any_detail_takes_the_known_lens(tmp_path, capsys):
    assert fitted(tmp_path, shots.grey())[0] == 5
    capsys.readouterr()
    code, fit = fitted(tmp_path, shots.grey(), "--lens", words_of_the_lens())
    assert code == 0
    assert fit.slope == pytest.approx(shots.SLOPE, rel=0.05)
    assert fit.intercept == pytest.approx(shots.INTERCEPT, rel=0.05)
    said = "".join(capsys.readouterr())
    assert "the plate tells nothing of its lens; it is that of --lens" in said
    assert "CoC of the object" in said


@pytest.mark.slow
def test_known_lens_makes_a_fit_more_certain(tmp_path):
    _, alone = fitted(tmp_path, shots.plate())
    code, known = fitted(tmp_path, shots.plate(), "--lens", words_of_the_lens())
    assert code == 0
    there = np.linspace(0.3, 0.8, 4)
    assert (known.coc_stderr_px(there) < alone.coc_stderr_px(there)).all()
    assert known.coc_stderr_px(there).mean() < 0.6 * alone.coc_stderr_px(there).mean()
    truth = shots.SLOPE * there + shots.INTERCEPT
    assert np.abs(known.coc_px(there) - truth).max() < 0.5
    assert (
        "with what is known of the lens"
        in json.loads((tmp_path / "fit.json").read_text())["method"]
    )


@pytest.mark.slow
@pytest.mark.parametrize("lens", ["50mm f/{} focus 40m", "50mm f/{}", "focus inf"])
def test_lens_that_the_plate_contradicts_is_kept_and_the_note_says_what_the_plate_tells(
    tmp_path, capsys, lens
):
    number = words_of_the_lens(8.0).split()[1].removeprefix("f/")
    code, fit = fitted(tmp_path, shots.plate(), "--lens", lens.format(number))
    said = "".join(capsys.readouterr())
    assert code == 0
    assert "tells nothing" not in fit.method
    assert fit.intercept == 0.0 or fit.slope == pytest.approx(shots.SLOPE / 8.0, rel=0.1)
    off, told = re.search(r"--lens lies (\S+) standard .* \(slope (\S+) .* is kept", said).groups()
    assert float(off) > 3.0
    assert float(told) == pytest.approx(shots.SLOPE, rel=0.2)


@pytest.mark.slow
def test_lens_that_goes_with_the_plate_has_no_note(tmp_path, capsys):
    assert fitted(tmp_path, shots.plate(), "--lens", words_of_the_lens())[0] == 0
    assert "standard errors from" not in "".join(capsys.readouterr())


@pytest.mark.slow
def test_ground_of_fine_grain_is_said_to_leave_the_lens_open(tmp_path, capsys):
    rng = np.random.default_rng(0)
    grain = 128.0 + 25.0 * rng.standard_normal((shots.HEIGHT, shots.WIDTH, 1))
    sand = np.repeat(np.clip(grain, 0, 255), 3, axis=2).astype(np.uint8)
    code, fit = fitted(tmp_path, sand)
    said = capsys.readouterr()
    assert code == 0 and fit.sign == "ambiguous" and not fit.depends_on_depth
    assert "the ground reads about alike at all depths" in said.out + said.err
    assert fit.object_disparity > 0.0
    read_px = fit.slope * fit.object_disparity + fit.intercept
    assert fit.coc_stderr_px(fit.object_disparity) > abs(read_px) > 0.0


@pytest.mark.slow
def test_preference_chooses_the_lens_that_the_file_holds_as_the_other(tmp_path):
    rgb = shots.plate(slope=0.0, intercept=-5.0)
    lenses = {p: fitted(tmp_path, rgb, "--prefer", p)[1] for p in ("near", "far")}
    near, far = (lens.slope * lens.object_disparity + lens.intercept for lens in lenses.values())
    assert near < 0.0 < far
    assert {lens.sign for lens in lenses.values()} == {"assumed"}
    assert lenses["near"].other == pytest.approx((lenses["far"].slope, lenses["far"].intercept))


def test_lens_that_is_none_ends_with_one_line(tmp_path, capsys):
    assert fitted(tmp_path, shots.grey(), "--lens", "50mm f2.8")[0] == 2
    (line,) = capsys.readouterr().err.strip().splitlines()[-1:]
    assert "'f2.8' is no part of a lens" in line


@pytest.mark.needs_gl
def test_what_tells_of_the_lens_beside_a_given_fit_is_noted_as_unused(tmp_path, capsys):
    plate = shots.write_png(tmp_path / "in.png")
    glb, fit = shots.cube_glb(tmp_path / "cube.glb"), shots.fit_json(tmp_path / "fit.json")
    words = [str(plate), str(glb), str(tmp_path / "out.png"), "--fit", str(fit), "-y"]
    assert main([*words, "--effects", "none"]) == 0
    assert "--fit gives the lens" not in "".join(capsys.readouterr())
    more = ["--lens", "50mm", "--prefer", "near", "--fit-region", "0,0.5,1,1"]
    assert main([*words, "--effects", "none", *more]) == 0
    said = "".join(capsys.readouterr())
    for option in ("--lens", "--prefer", "--fit-region"):
        assert f"{option}: --fit gives the lens, so it changes nothing" in said
