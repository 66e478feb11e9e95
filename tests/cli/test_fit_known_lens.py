"""`--lens` on the command line: the fit of a plate that tells little or nothing."""

import json

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


def test_lens_that_is_none_ends_with_one_line(tmp_path, capsys):
    assert fitted(tmp_path, shots.grey(), "--lens", "50mm f2.8")[0] == 2
    (line,) = capsys.readouterr().err.strip().splitlines()[-1:]
    assert "'f2.8' is no part of a lens" in line
