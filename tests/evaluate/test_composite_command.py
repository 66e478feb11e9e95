import importlib.util
import json
import math
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support.command import nlens, one_line
from support.truth_folder import write_rendered

from nlens_video.evaluate.composite import composite
from nlens_video.evaluate.composite.composite import NETWORK, QUADRATIC
from nlens_video.evaluate.composite.methods import (
    BLIND,
    DEFAULT,
    GAUSSIAN,
    NAIVE,
    TRUE_COC,
    TRUE_FIT,
    all_methods,
    load_subject,
)
from nlens_video.evaluate.metrics import over_scenes

ROWS = [NAIVE, BLIND, GAUSSIAN, "draft", DEFAULT, TRUE_FIT, TRUE_COC]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    home = tmp_path_factory.mktemp("truth")
    write_rendered(home / "one_a")
    write_rendered(home / "two_b", seed=1, sharp=False)
    return home


@pytest.fixture(scope="module")
def measured(folder, tmp_path_factory):
    """The command on two small plates, without the two presets that tell nothing new."""
    out = tmp_path_factory.mktemp("out") / "deep" / "figures"
    with pytest.MonkeyPatch.context() as patch:
        kept = [method for method in all_methods() if method.name in ROWS]
        patch.setattr(composite, "all_methods", lambda: kept)
        run = nlens("evaluate", "composite", folder, "--out", out, "--json")
    assert run.returncode == 0, run.stderr
    return SimpleNamespace(figures=json.loads(run.stdout), out=out)


def rows(measured):
    return {row["name"]: row for row in measured.figures["composite"]["summary"]}


def test_every_layered_preset_baseline_and_bound_is_a_method():
    names = [method.name for method in all_methods()]
    assert names[:3] == [NAIVE, BLIND, GAUSSIAN] and names[-2:] == [TRUE_FIT, TRUE_COC]
    assert names[3:-2] == ["draft", "realtime", "standard", "paper"]


@pytest.mark.slow
def test_every_method_is_evaluated_on_every_plate(measured):
    assert measured.figures["plates"] == ["one_a", "two_b"]
    assert list(rows(measured)) == ROWS
    assert len(measured.figures["composite"]["plates"]) == 2 * len(ROWS)
    assert all(row["psnr_db_count"] == 2 for row in rows(measured).values() if row["psnr_db"])


@pytest.mark.slow
def test_number_of_plates_or_scenes_stands_beside_each_mean(measured):
    summary = measured.figures["composite_plate_coc"]["summary"]
    counts = {row["name"]: row["rmse_px_count"] for row in summary}
    assert counts == {NETWORK: 2, QUADRATIC: 1}  # a plate has no sharp picture
    lines = (measured.out / "composite.md").read_text().splitlines()
    paper = [line.split("|") for line in lines if line.startswith(("| Ranftl", "| Ruan", "| Ours"))]
    assert [int(cells[-2]) for cells in paper] == [1, 2, 2, 2]
    over = lines[lines.index("## Over scenes") + 2 :][: 2 + len(ROWS)]
    assert [line.split("|")[-2].strip() for line in over[:1] + over[2:4]] == ["scenes", "2", "2"]


@pytest.mark.slow
def test_our_method_beats_the_baselines_and_is_bounded_by_the_true_lens(measured):
    found = rows(measured)
    psnr = {name: found[name]["psnr_db"] or math.inf for name in ROWS}  # exact: no dB
    assert psnr[NAIVE] < psnr[DEFAULT] < psnr[TRUE_FIT]
    assert psnr[BLIND] < psnr[DEFAULT]
    assert psnr[GAUSSIAN] < psnr[TRUE_COC]


@pytest.mark.slow
def test_object_coc_error_is_that_of_the_injected_lens_error(measured):
    found = {name: row["object_rms_px"] for name, row in rows(measured).items()}
    assert found[TRUE_COC] == found[GAUSSIAN] == 0.0
    assert 0 < found[TRUE_FIT] < 0.05 < found[DEFAULT] == found["draft"] < found[NAIVE]


@pytest.mark.slow
def test_composite_evaluation_writes_tables_and_a_picture(measured):
    assert sorted(path.name for path in measured.out.iterdir()) == [
        "composite.csv", "composite.md", "composite.png", "composite_plate_coc.csv",
    ]  # fmt: skip
    text = (measured.out / "composite.md").read_text()
    assert "| Blind Aug. w/ DoF" in text and "27.88" in text and " ± " in text and "nan" not in text
    lines = (measured.out / "composite.csv").read_text().splitlines()
    assert lines[0] == (
        "row,plate,psnr_db,ssim,band_psnr_db,band_ssim,object_rms_px,time_s"
    ) and len(lines) == 1 + 2 * len(ROWS)
    picture = cv2.imread(str(measured.out / "composite.png"))
    assert picture is not None and picture.shape[0] > 300 and picture.std() > 5


def test_evaluated_band_surrounds_the_outline_and_is_as_wide_as_the_blur(folder):
    subject = load_subject(folder / "one_a")
    mask = cv2.imread(str(folder / "one_a/object_rgba.png"), -1)[..., 3]
    reach = int(np.abs(subject.coc_px).max() / 2) + 3
    square = np.ones((2 * reach + 1,) * 2, np.uint8)
    near = cv2.dilate(mask, square) > cv2.erode(mask, square)
    outline = cv2.dilate(mask, np.ones((3, 3), np.uint8)) > mask
    assert subject.band[outline].all() and not subject.band[~near].any()
    least = np.abs(subject.known.object_coc_px[mask > 0]).min()
    assert subject.band.sum() > least * outline.sum() / 2


def test_difference_within_the_band_affects_only_the_bands_figures(folder):
    subject = load_subject(folder / "one_a")
    harmed = subject.case.truth.copy()
    harmed[subject.band] ^= 16
    inside = subject.score(harmed)
    assert inside["band_psnr_db"] == pytest.approx(20 * math.log10(255 / 16), abs=1e-6)
    assert inside["band_psnr_db"] < inside["psnr_db"] and inside["band_ssim"] < inside["ssim"] < 1
    exact = subject.score(subject.case.truth)
    assert exact["band_ssim"] == 1 and exact["band_psnr_db"] == math.inf


def test_confidence_interval_over_scenes_agrees_with_a_hand_calculation():
    found = over_scenes([("a", 1.0), ("a", 3.0), ("b", 4.0), ("c", 6.0), ("c", math.nan)])
    assert (found.mean, found.scenes) == (4.0, 3)  # of the scenes' means 2, 4, 6
    assert found.half == pytest.approx(4.3027 * 2 / math.sqrt(3), abs=1e-4)
    alone = over_scenes([("a", 1.0), ("a", 2.0)])
    assert alone.mean == 1.5 and math.isnan(alone.half) and alone.text(1) == "1.5"
    assert over_scenes([]).text(1) == "–"


@given(st.lists(st.floats(20, 40), min_size=3, max_size=9), st.integers(1, 4))
def test_repeated_scenes_do_not_narrow_the_confidence_interval(figures, times):
    once = [(str(at), figure) for at, figure in enumerate(figures)]
    found, again = over_scenes(once), over_scenes(once * times)
    assert again.mean == pytest.approx(found.mean) and again.half == pytest.approx(found.half)


@pytest.mark.slow
@pytest.mark.needs_truth
def test_figures_agree_with_an_independent_scorer_of_finished_pictures(shared, tmp_path):
    spec = importlib.util.spec_from_file_location("score", shared / "tools" / "score.py")
    score = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(score)
    plate = shared / "data" / "cycles" / "dev" / "indoor_front"
    out, fit = tmp_path / "out.png", tmp_path / "fit.json"
    run = nlens(
        plate / "bg.png", plate / "object.glb", out, "--layers", plate / "object.exr",
        "--save-fit", fit, "--effects", "defocus", "-q",
    )  # fmt: skip
    assert run.returncode == 0, run.stderr
    theirs = score.score(plate, out, fit)
    methods = {method.name: method for method in all_methods()}
    subject = load_subject(plate)
    ours, naive = (methods[name].measure(subject) for name in (DEFAULT, NAIVE))
    assert (ours["psnr_db"], ours["ssim"]) == pytest.approx(theirs["ours"], abs=1e-6)
    assert ours["object_rms_px"] == pytest.approx(theirs["coc_rms"], abs=1e-3)
    # the scorer pastes the 8-bit picture in display code, we lay the layer over in linear light
    assert naive["psnr_db"] == pytest.approx(theirs["naive"][0], abs=0.2)


@pytest.mark.parametrize("name", ["object.exr", "gt_noshadow.png", "object_depth.npz"])
def test_plate_with_a_missing_file_is_refused_in_one_line(tmp_path, name):
    (write_rendered(tmp_path / "one_a") / name).unlink()
    assert name in one_line(nlens("evaluate", "composite", tmp_path), 3)


def test_folder_without_plates_is_refused_in_one_line(tmp_path):
    assert "object_coc.npy" in one_line(nlens("evaluate", "composite", tmp_path), 3)


def test_output_folder_that_is_a_file_is_refused_in_one_line(folder, tmp_path):
    (tmp_path / "taken").write_text("")
    run = nlens("evaluate", "composite", folder, "--out", tmp_path / "taken")
    assert "is no folder" in one_line(run, 6)
