import json
import math
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from support.command import nlens, one_line
from support.truth_folder import HEIGHT, INTERCEPT, SLOPE, WIDTH, write_rendered

from nlens_video.core.layers import Box
from nlens_video.evaluate.bench import bench
from nlens_video.evaluate.bench.case import built_case, plate_case
from nlens_video.evaluate.bench.measure import Effort, figures
from nlens_video.evaluate.bench.methods import all_rungs
from nlens_video.evaluate.bench.scenes import write_scenes
from nlens_video.evaluate.plates import load_plate
from nlens_video.evaluate.plots import Point, pareto

TINY = Effort(size=(240, 128), views=64, frames=3, seconds=0.1)
RUN = ("naive", "realtime", "lens, 8 views")


@pytest.fixture(scope="module")
def measured(tmp_path_factory):
    """The command with three rungs and two scenes, on small frames."""
    home = tmp_path_factory.mktemp("bench")
    write_rendered(home / "plates" / "one_a")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(bench, "QUICK", TINY)
        patch.setattr(
            bench, "all_rungs", lambda: [rung for rung in all_rungs() if rung.name in RUN]
        )
        patch.setattr(bench, "write_scenes", lambda to, size: write_scenes(to, size)[:2])
        run = nlens("bench", home / "plates", "--quick", "--out", home / "deep" / "out", "--json")
    assert run.returncode == 0, run.stderr
    return SimpleNamespace(figures=json.loads(run.stdout), out=home / "deep" / "out")


def rows(measured, table):
    return {row["name"]: row for row in measured.figures[table]["summary"]}


@pytest.mark.slow
@pytest.mark.needs_gl
def test_accuracy_rises_with_the_quality_level(measured):
    found = [rows(measured, "bench")[name]["psnr_db"] for name in RUN]
    assert found == sorted(found) and found[0] < 25 and found[-1] > 35
    likeness = [rows(measured, "bench")[name]["ssim"] for name in RUN]
    assert likeness == sorted(likeness) and likeness[-1] > 0.98


@pytest.mark.slow
@pytest.mark.needs_gl
def test_bench_reports_time_memory_and_startup_of_each_method(measured):
    for row in rows(measured, "bench").values():
        assert 0 < row["median_ms"] and 0 < row["p95_ms_worst"]
        assert row["startup_s"] > 0.1 and 50 < row["peak_mib_worst"] < 4000
    times = [rows(measured, "bench")[name]["median_ms"] for name in RUN]
    assert times[0] < times[2]


@pytest.mark.slow
@pytest.mark.needs_gl
def test_prerendered_layers_are_benchmarked_with_their_true_coc(measured):
    found = rows(measured, "bench_plates")
    assert list(found) == ["naive", "realtime"]  # a layer cannot be seen from elsewhere
    assert found["naive"]["psnr_db"] < 35
    psnr_db = found["realtime"]["psnr_db"]
    assert psnr_db is None or psnr_db > 50  # None: to the bit


@pytest.mark.slow
@pytest.mark.needs_gl
def test_bench_files_hold_figures_and_machine_but_no_host_name(measured):
    import platform

    names = ["bench.csv", "bench.md", "bench.png", "bench_plates.csv"]
    assert sorted(path.name for path in measured.out.iterdir()) == names
    text = (measured.out / "bench.md").read_text()
    assert "- processor: " in text and "- cores: " in text and "nan" not in text
    assert "| lens, 8 views" in text and "near over far" in text
    lines = (measured.out / "bench.csv").read_text().splitlines()
    told = [line for line in lines if line.startswith("#")]
    assert any(line.startswith("# cores: ") for line in told)
    table = [line for line in lines if not line.startswith("#")]
    assert table[0].startswith("row,plate,psnr_db,ssim,median_ms,p95_ms") and len(table) == 1 + 6
    assert len(platform.node()) < 4 or platform.node() not in text + "".join(lines)
    picture = cv2.imread(str(measured.out / "bench.png"))
    assert picture is not None and picture.shape[0] > 300 and picture.std() > 5


@pytest.mark.slow
@pytest.mark.needs_gl
def test_ground_truth_differs_from_the_plate_only_within_the_objects_reach(tmp_path):
    scene = write_scenes(tmp_path, TINY.size)[0]
    case = built_case(scene, TINY.size, views=16)
    assert case.region == Box(95, 14, 145, 114)  # of 380 to 580 and 56 to 456, at a quarter
    changed = (case.truth != case.plate).any(axis=2)
    assert changed[20:108, 100:140].mean() > 0.95
    assert not changed[:, :85].any() and not changed[:, 155:].any()
    naive = case.score(case.plate)
    assert naive["psnr_db"] < 25 and case.score(case.truth)["psnr_db"] == math.inf


def test_every_preset_and_every_baseline_is_benchmarked():
    names = [rung.name for rung in all_rungs()]
    assert names[:5] == ["naive", "one Gaussian", "layered Gaussian", "draft", "realtime"]
    assert {"standard", "lens, 8 views", "lens, 32 views", "reference"} <= set(names)
    sampled = [rung.name for rung in all_rungs() if rung.needs_views]
    assert sampled == ["lens, 8 views", "lens, 32 views", "reference"]


def test_bench_uses_the_lens_of_the_plates_ground_truth(tmp_path):
    case = plate_case(load_plate(write_rendered(tmp_path / "one_a")))
    assert (case.fit.slope, case.fit.intercept) == pytest.approx((SLOPE, INTERCEPT), abs=0.05)


def test_bench_figures_agree_with_a_hand_calculation(tmp_path):
    case = plate_case(load_plate(write_rendered(tmp_path / "one_a")))
    times = tuple(float(ms) for ms in range(1, 22))
    found = figures(case, case.plate, times)
    assert (found["median_ms"], found["p95_ms"]) == (11.0, 20.0)
    rows, columns = np.nonzero(cv2.imread(str(tmp_path / "one_a/object_rgba.png"), -1)[..., 3])
    box = np.s_[rows.min() : rows.max() + 1, columns.min() : columns.max() + 1]
    mean = np.mean((case.plate[box].astype(float) - case.truth[box]) ** 2)
    assert found["psnr_db"] == pytest.approx(10 * math.log10(255**2 / mean))


def test_pareto_front_holds_methods_that_none_beats_in_time_and_accuracy():
    slow, quick, bad = (
        Point("slow", 9.0, 50.0, ours=True), Point("quick", 1.0, 40.0, ours=True),
        Point("bad", 5.0, 39.0, ours=False),
    )  # fmt: skip
    assert pareto([slow, bad, quick]) == [quick, slow]


def test_missing_folder_is_refused_in_one_line(tmp_path):
    assert "no such folder" in one_line(nlens("bench", tmp_path / "gone"), 3)


@pytest.mark.parametrize("name", ["object.exr", "gt_noshadow.png", "object_coc.npy"])
def test_plate_with_a_missing_file_is_refused_in_one_line(tmp_path, name):
    (write_rendered(tmp_path / "one_a") / name).unlink()
    assert name in one_line(nlens("bench", tmp_path), 3)


def test_ground_truth_of_another_size_is_refused_in_one_line(tmp_path):
    path = write_rendered(tmp_path / "one_a") / "gt_noshadow.png"
    assert cv2.imwrite(str(path), np.zeros((9, 9, 3), np.uint8))
    assert "gt_noshadow.png" in one_line(nlens("bench", tmp_path), 3)


def test_impossible_ground_truth_coc_is_refused_in_one_line(tmp_path):
    path = write_rendered(tmp_path / "one_a") / "object_coc.npy"
    np.save(path, np.random.default_rng(0).normal(0, 5, (HEIGHT, WIDTH)).astype(np.float16))
    assert "object_coc.npy" in one_line(nlens("bench", tmp_path), 3)


def test_output_folder_that_is_a_file_is_refused_in_one_line(tmp_path):
    (tmp_path / "taken").write_text("")
    assert "is no folder" in one_line(nlens("bench", "--out", tmp_path / "taken"), 6)


def test_invalid_arguments_are_refused_in_one_line():
    one_line(nlens("bench", "a", "b"), 2)
