"""`evaluate occlusion` on a short clip of a walker, and what it says of files that are none."""

import json

import numpy as np
import pytest
from support.folders import SAMPLES

from nlens_video.cli.main import main
from nlens_video.core.errors import InputError
from nlens_video.evaluate.composite.occlusion import load_orders


@pytest.mark.slow
def test_a_walker_is_found_before_the_object_and_left_out_costs_decibels(
    tmp_path, monkeypatch, capsys
):
    monkeypatch.syspath_prepend(str(SAMPLES))
    from truth.walkers import Clip, write_clip

    write_clip(tmp_path / "clips" / "walk", Clip(0, 24))
    assert main(["evaluate", "occlusion", str(tmp_path / "clips"), "--json", "-q"]) == 0
    told = json.loads(capsys.readouterr().out)
    rows = {row["name"]: row for row in told["occlusion"]["summary"]}
    assert rows["found"]["order_percent"] == 100.0
    assert rows["found"]["matte_percent"] < 4.0
    assert rows["found"]["before_db"] > rows["nothing in front"]["before_db"] + 6.0
    assert rows["true matte"]["matte_percent"] < 0.1
    assert rows["true matte"]["before_db"] > 40.0  # the plate's own grain counts as no error
    # second difference in time, against 13 % and more of a matte that is missing
    assert rows["found"]["flicker_percent"] < 10.0 < rows["nothing in front"]["flicker_percent"]


def test_a_clip_is_the_same_for_the_same_seed(monkeypatch):
    monkeypatch.syspath_prepend(str(SAMPLES))
    from truth.figures import Look, draw_figure, draw_object

    looks = [Look.drawn(np.random.default_rng(3)) for _ in range(2)]
    figures = [draw_figure(look, 1.3, 1.0) for look in looks]
    assert np.array_equal(*figures) and figures[0][..., 3].max() == 1.0
    assert draw_object(np.random.default_rng(1))[..., 3].mean() > 0.3


@pytest.mark.parametrize("text", ["{}", '{"frames": [{"walkers": [{"before": true}]}]}', "nothing"])
def test_a_description_without_walkers_is_refused(tmp_path, text):
    (tmp_path / "params.json").write_text(text)
    with pytest.raises(InputError, match="cannot be read as a clip's description"):
        load_orders(tmp_path)
