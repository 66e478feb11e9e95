import numpy as np
import pytest

from models.coc.evaluate import figures


def test_coc_training_metrics_agree_with_a_hand_calculation():
    truth = np.float32([4, 4, 10, 10])
    coc = np.float32([5, 3, 10, 14])  # errors +1, -1, 0, +4; the last is the least confident
    sigma = np.float32([1, 1, 2, 6])
    row = figures("case", coc, sigma, truth)
    assert row.rmse_px == pytest.approx(np.sqrt((1 + 1 + 0 + 16) / 4))
    assert row.confident_rmse_px == pytest.approx(1.0)  # the two of sigma 1
    assert row.confident_bias_px == pytest.approx(0.0)
    assert row.relative == pytest.approx(0.25)  # median of 0.25, 0.25, 0, 0.4
    assert row.honesty == pytest.approx(1.5 / 2.5)
    assert row.confident_honesty == pytest.approx(1.0)


def test_a_picture_in_focus_has_no_relative_error():
    flat = np.full((4, 4), 1.0, np.float32)
    assert figures("focus", flat, flat, np.zeros_like(flat)).relative == 0.0
