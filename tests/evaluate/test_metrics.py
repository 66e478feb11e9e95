import math

import numpy as np
import pytest

from nlens_video.evaluate.metrics import binned_errors, coc_figures, rms_within
from nlens_video.evaluate.report import Column, Entry, Table

COC = np.array([[1, 2], [5, 8]], np.float32)
TRUTH = np.array([[0, 4], [4, 10]], np.float32)


def test_coc_errors_of_four_pixels_agree_with_a_hand_calculation():
    found = coc_figures(COC, TRUTH, np.array([[1, 3], [2, 4]], np.float32))
    assert found["rmse_px"] == pytest.approx(math.sqrt((1 + 4 + 1 + 4) / 4))
    assert found["confident_rmse_px"] == pytest.approx(1.0)  # the pixels with sigma 1 and 2
    assert found["bias_px"] == pytest.approx((1 - 2 + 1 - 2) / 4)
    # of 2/4, 1/4 and 2/10; the sharp pixel is out
    assert found["relative_percent"] == pytest.approx(25)


@pytest.mark.parametrize("unknown", [math.nan, math.inf])
def test_pixel_whose_truth_is_unknown_is_in_no_figure(unknown):
    coc = np.append(COC, [[7, 100]], axis=0)
    truth = np.append(TRUTH, [[unknown, unknown]], axis=0)
    sigma = np.array([[1, 3], [2, 4], [0, 0]], np.float32)
    assert coc_figures(coc, truth, sigma) == coc_figures(COC, TRUTH, sigma[:2])
    everywhere = np.ones_like(truth, bool)
    assert rms_within(coc, truth, everywhere) == rms_within(COC, TRUTH, everywhere[:2])


def test_method_without_uncertainty_has_no_confident_half():
    assert math.isnan(coc_figures(COC, TRUTH)["confident_rmse_px"])


def test_sharp_plate_has_no_relative_error():
    assert math.isnan(coc_figures(COC, np.ones_like(TRUTH))["relative_percent"])


def test_object_coc_error_counts_opaque_pixels_and_signs():
    predicted = np.array([[3.0, -4.0, 99.0]], np.float32)
    truth = np.array([[3.0, 4.0, 0.0]], np.float32)
    solid = np.array([[True, True, False]])
    assert rms_within(predicted, truth, solid) == pytest.approx(math.sqrt(64 / 2))
    assert math.isnan(rms_within(predicted, truth, np.zeros_like(solid)))


def test_errors_are_binned_by_their_key():
    error = np.array([1, -3, 2, 50], np.float32)
    found = binned_errors(error, np.array([0.5, 0.7, 2.5, 99], np.float32), np.arange(4.0))
    assert found.count.tolist() == [2, 1]  # nothing between 1 and 2, one beyond all edges
    assert found.at_px == pytest.approx([0.6, 2.5])
    assert found.mean_abs_px == pytest.approx([2, 2])
    assert found.bias_px == pytest.approx([-1, 2])
    assert found.quartiles_px[0] == pytest.approx([-2, -1, 0])


@pytest.fixture
def table():
    columns = (
        Column("rms_px", "rms"),
        Column("rms_px", "worst", 1, "worst"),
        Column("rms_px", "fits", 0, "count"),
        Column("ms", "time", 0, "median"),
    )
    entries = [
        Entry("ours", "a", {"rms_px": 1.0, "ms": 10.0}),
        Entry("theirs", "a", {"rms_px": math.nan, "ms": 5.0}),
        Entry("ours", "b", {"rms_px": 2.0, "ms": 30.0}),
        Entry("theirs", "b", {"rms_px": math.nan, "ms": 6.0}),
    ]
    return Table("t", "Title", columns, "rms_px", ("A note.",), entries)


def test_summary_holds_mean_worst_count_and_median_over_plates(table):
    assert table.summary() == [
        {"name": "ours", "rms_px": 1.5, "rms_px_worst": 2.0, "rms_px_count": 2.0, "ms": 20.0},
        {"name": "theirs", "rms_px": None, "rms_px_worst": None, "rms_px_count": 0.0, "ms": 5.5},
    ]


def test_markdown_table_shows_every_plate_and_a_dash_for_undefined_values(table):
    lines = table.markdown().splitlines()
    assert lines[0] == "## Title" and lines[-1] == "A note."
    cells = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]
    assert ["", "rms", "worst", "fits", "time"] in cells
    assert ["ours", "1.50", "2.0", "2", "20"] in cells
    assert ["theirs", "–", "–", "0", "6"] in cells
    assert ["", "a", "b"] in cells and ["ours", "1.00", "2.00"] in cells


def test_csv_has_a_line_per_method_and_plate(table):
    assert table.csv().splitlines() == [
        "row,plate,rms_px,ms",
        "ours,a,1.0000,10.0000",
        "theirs,a,,5.0000",
        "ours,b,2.0000,30.0000",
        "theirs,b,,6.0000",
    ]
