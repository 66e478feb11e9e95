import pytest

from models.coc.evaluate import evaluate_plates, onnx_estimate
from nlens_video.networks.model_store import find_model


@pytest.mark.needs_truth
def test_network_error_on_rendered_plates_is_within_the_model_card(shared):
    rows = evaluate_plates(onnx_estimate(find_model("coc").path), shared / "data/cycles/dev")
    mean = rows[-1]
    assert len(rows) == 10  # nine stills and their mean
    assert mean.rmse_px < 2.0
    assert mean.confident_rmse_px < 1.5
    assert abs(mean.confident_bias_px) < 0.3
    assert 0.6 < mean.honesty < 1.4
