import json
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from support.command import nlens, one_line
from support.truth_folder import write_plate

SHARP = "Blind Augmentation on the sharp picture"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    home = tmp_path_factory.mktemp("truth")
    write_plate(home / "one_a")
    write_plate(home / "two_b", seed=1, sharp=False)
    (home / "clip").mkdir()
    np.save(home / "clip/bg_coc.npy", np.zeros((4, 4)))
    (home / "unrelated").mkdir()
    return home


@pytest.fixture(scope="module")
def measured(folder, tmp_path_factory):
    out = tmp_path_factory.mktemp("out") / "deep" / "figures"
    run = nlens("evaluate", "coc", folder, "--out", out, "--json")
    assert run.returncode == 0, run.stderr
    return SimpleNamespace(figures=json.loads(run.stdout), out=out)


def summary(measured, table):
    return {row["name"]: row for row in measured.figures[table]["summary"]}


@pytest.mark.slow
def test_every_still_plate_is_evaluated_and_others_are_named(measured):
    assert measured.figures["plates"] == ["one_a", "two_b"]
    assert measured.figures["passed_over"] == ["clip"]


@pytest.mark.slow
def test_network_beats_every_baseline_without_ground_truth(measured):
    rows = summary(measured, "methods")
    ours = rows["ours (network)"]
    assert ours["rmse_px"] < rows["best constant"]["rmse_px"]
    for propagated in ("re-blur ratio", "matting"):
        assert ours["rmse_px"] < rows[f"Zhuo & Sim 2011, {propagated}"]["rmse_px"]
    assert ours["confident_rmse_px"] < ours["rmse_px"]
    assert rows["best constant"]["confident_rmse_px"] is None
    assert rows["best constant"]["bias_px"] == pytest.approx(0, abs=1e-3)


@pytest.mark.slow
def test_method_is_skipped_on_a_plate_that_lacks_its_inputs(measured):
    for name in (SHARP, f"{SHARP}, best factor"):
        one, two = [row for row in measured.figures["methods"]["plates"] if row["name"] == name]
        assert one["plate"] == "one_a" and one["rmse_px"] > 0
        assert two == {"name": name, "plate": "two_b"}  # it has no sharp picture


@pytest.mark.slow
def test_number_of_plates_stands_beside_the_means_of_each_method(measured):
    for name, row in summary(measured, "methods").items():
        assert row["rmse_px_count"] == (1 if name.startswith(SHARP) else 2)
    text = (measured.out / "coc.md").read_text()
    table = text.partition("CoC of the whole plate (stage F)")[2].split("\n\n")[1].splitlines()
    plates = {line.split("|")[1].strip(): line.split("|")[-2].strip() for line in table}
    assert plates[""] == "plates"
    assert (plates["ours (network)"], plates[SHARP]) == ("2", "1")


@pytest.mark.slow
def test_best_factor_never_increases_the_error(measured):
    rows = summary(measured, "methods")
    assert rows[f"{SHARP}, best factor"]["rmse_px"] <= rows[SHARP]["rmse_px"]


@pytest.mark.slow
def test_every_ablation_and_condition_is_evaluated_on_every_plate(measured):
    assert list(summary(measured, "ablations")) == [
        "shipped", "readings alone", "no lens network", "no confidence",
        "no V-fit (the paper's line)", "footprint only",
        "no confidence, Zhuo & Sim 2011, re-blur ratio", "no confidence, Zhuo & Sim 2011, matting",
    ]  # fmt: skip
    assert list(summary(measured, "conditions")) == [
        "as rendered", "H.264, crf 28", "noise of 2%", "480 px wide", "640 px wide",
        "1920 px wide", "3840 px wide",
        "field of view -15 %", "field of view +15 %",
    ]  # fmt: skip
    for table in ("ablations", "conditions"):
        assert len(measured.figures[table]["plates"]) == 2 * len(summary(measured, table))


@pytest.mark.slow
def test_estimated_fit_recovers_the_lens_of_the_plates(measured):
    assert summary(measured, "ablations")["shipped"]["object_rms_px"] < 1.5
    shipped = summary(measured, "conditions")["as rendered"]["object_rms_px"]
    assert shipped == summary(measured, "ablations")["shipped"]["object_rms_px"]


@pytest.mark.slow
def test_stated_errors_of_a_clear_plate_hold_and_no_sign_is_wrong(measured):
    stated = summary(measured, "stated")["as rendered"]
    assert 0.0 < stated["stated_px"] < 3.0
    for name in ("object", "slope", "intercept"):
        assert stated[f"{name}_within_two_percent"] == 100.0
    assert stated["wrong_percent"] == stated["refused_percent"] == 0.0


@pytest.mark.slow
def test_errors_at_twice_the_width_are_in_the_plates_pixels(measured):
    rows = summary(measured, "conditions")
    assert rows["1920 px wide"]["rmse_px"] < 2 * rows["as rendered"]["rmse_px"]


@pytest.mark.slow
def test_tables_and_plots_are_written(measured):
    assert sorted(path.name for path in measured.out.iterdir()) == [
        "ablations.csv", "coc.md", "conditions.csv", "error_by_coc.png", "methods.csv",
        "reliability.png", "stated.csv",
    ]  # fmt: skip
    for name in ("reliability.png", "error_by_coc.png"):
        plot = cv2.imread(str(measured.out / name))
        assert plot is not None and plot.shape[0] > 300 and plot.std() > 5
    text = (measured.out / "coc.md").read_text()
    assert "ours (network)" in text and "nan" not in text
    lines = (measured.out / "conditions.csv").read_text().splitlines()
    assert lines[0].startswith("row,plate,") and len(lines) == 1 + 2 * 9


@pytest.mark.slow
def test_single_plate_folder_is_evaluated_and_printed_to_standard_output(folder):
    run = nlens("evaluate", "coc", folder / "one_a")
    assert run.returncode == 0, run.stderr
    assert "# CoC of 1 plate" in run.stdout and "| shipped" in run.stdout and run.stderr == ""


@pytest.mark.slow
def test_pixels_whose_true_coc_is_unknown_are_left_out_of_every_figure(tmp_path):
    for name, unknown in (("whole_a", None), ("nan_a", np.nan), ("inf_a", np.inf)):
        path = write_plate(tmp_path / name)
        coc, own = np.load(path / "bg_coc.npy"), np.load(path / "object_coc.npy")
        if unknown is not None:
            coc[:60], own[:, :150] = unknown, unknown
            np.save(path / "bg_coc.npy", coc)
            np.save(path / "object_coc.npy", own)
    run = nlens("evaluate", "coc", tmp_path, "--json", "--out", tmp_path / "out")
    assert run.returncode == 0 and run.stderr == "", run.stderr
    figures = json.loads(run.stdout)
    for table in ("methods", "ablations", "conditions"):
        rows = {}
        for row in figures[table]["plates"]:
            kept = {key: value for key, value in row.items() if key not in ("time_ms", "plate")}
            rows.setdefault(row["plate"], []).append(kept)
        assert rows["nan_a"] == rows["inf_a"]
        if table != "methods":
            for whole, part in zip(rows["whole_a"], rows["nan_a"], strict=True):
                assert part["object_rms_px"] == pytest.approx(whole["object_rms_px"], abs=0.1)
    best = [row for row in figures["methods"]["plates"] if row["name"] == "best constant"]
    known = np.abs(np.load(tmp_path / "nan_a" / "bg_coc.npy")[60:].astype(np.float32))
    assert best[[row["plate"] for row in best].index("nan_a")]["rmse_px"] == pytest.approx(
        known.std(), abs=1e-3
    )


@pytest.mark.parametrize(
    ("name", "said"),
    [("bg_coc.npy", "holds no number"), ("object_coc.npy", "whose depth and CoC are known")],
)
def test_truth_without_a_number_is_refused_in_one_line(tmp_path, name, said):
    np.save(damaged(tmp_path, name), np.full((180, 320), np.nan, np.float32))
    assert said in one_line(nlens("evaluate", "coc", tmp_path), 3)


def damaged(folder, name):
    """A folder with one plate of which one file will be harmed."""
    return write_plate(folder / "bad_one") / name


def test_missing_folder_is_refused_in_one_line(tmp_path):
    assert "no such folder" in one_line(nlens("evaluate", "coc", tmp_path / "gone"), 3)


def test_folder_without_plates_is_refused_in_one_line(tmp_path):
    assert "object_coc.npy" in one_line(nlens("evaluate", "coc", tmp_path), 3)


@pytest.mark.parametrize("name", ["bg.png", "object_depth.npz", "params.json", "object.glb"])
def test_missing_ground_truth_file_is_named(tmp_path, name):
    damaged(tmp_path, name).unlink()
    assert name in one_line(nlens("evaluate", "coc", tmp_path), 3)


@pytest.mark.parametrize(
    ("name", "code"),
    [("bg.png", 3), ("bg_coc.npy", 3), ("object_depth.npz", 3), ("object_rgba.png", 3),
     ("params.json", 3), ("object.glb", 4)],
)  # fmt: skip
def test_unreadable_ground_truth_file_is_named(tmp_path, name, code):
    damaged(tmp_path, name).write_bytes(b"\x93NUMPY but not really")
    assert name in one_line(nlens("evaluate", "coc", tmp_path), code)


def test_ground_truth_map_of_another_size_is_named(tmp_path):
    np.save(damaged(tmp_path, "bg_coc.npy"), np.zeros((8, 8), np.float16))
    assert "bg_coc.npy: shape (8, 8)" in one_line(nlens("evaluate", "coc", tmp_path), 3)


def test_object_out_of_view_is_refused_in_one_line(tmp_path):
    path = damaged(tmp_path, "object_rgba.png")
    assert cv2.imwrite(str(path), np.zeros((180, 320, 4), np.uint8))
    assert "covers no pixel" in one_line(nlens("evaluate", "coc", tmp_path), 3)


def test_output_folder_that_is_a_file_is_refused_in_one_line(folder, tmp_path):
    (tmp_path / "taken").write_text("")
    run = nlens("evaluate", "coc", folder, "--out", tmp_path / "taken")
    assert "is no folder" in one_line(run, 6)


@pytest.mark.parametrize("words", [(), ("coc",), ("everything", "there")])
def test_invalid_arguments_are_refused_in_one_line(words):
    one_line(nlens("evaluate", *words), 2)
