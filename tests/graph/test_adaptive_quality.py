"""`--adaptive-quality` on real runs: level changes are invisible and happen only when needed."""

import json

import numpy as np
import pytest
from support import shots

from nlens_video.check.command import compare
from nlens_video.cli.main import main
from nlens_video.core.settings import SourceSettings
from nlens_video.graph import adaptive_quality

pytestmark = pytest.mark.needs_gl


@pytest.fixture(scope="module")
def shot(tmp_path_factory):
    folder = tmp_path_factory.mktemp("held")
    plate = shots.write_video(folder / "in.mp4", frames=44)
    glb = shots.cube_glb(
        folder / "anim.glb", start=(0.0, 0.0, -2.4), end=(0.2, 0.0, -2.8), seconds=2.0, size=0.4
    )
    return plate, glb, shots.fit_json(folder / "fit.json")


def render(shot, out, *words):
    plate, glb, fit = shot
    return main([*map(str, (plate, glb, out, "--fit", fit, "-q", *words))])


@pytest.fixture(scope="module")
def adaptive_run(shot, tmp_path_factory):
    """A run whose budget no rung meets."""
    folder = tmp_path_factory.mktemp("out")
    words = ("--hold-budget", "--budget-ms", "0.01", "--timings", folder / "t.json")
    assert render(shot, folder / "out.mp4", *words) == 0
    return folder / "out.mp4", json.loads((folder / "t.json").read_text())


@pytest.mark.slow
def test_timings_name_the_quality_level_of_each_frame(adaptive_run):
    levels = [row["rung"] for row in adaptive_run[1]["frames"]]
    assert list(dict.fromkeys(levels)) == ["standard", "realtime", "draft"]
    assert levels == sorted(levels, key=["standard", "realtime", "draft"].index)


@pytest.mark.slow
def test_change_of_quality_level_is_invisible_to_the_quality_check(adaptive_run, shot):
    verdict = compare(str(adaptive_run[0]), SourceSettings(spec=str(shot[0]))).verdict
    assert [one.text for one in verdict.findings if one.kind in ("pop", "flicker", "plate")] == []


@pytest.mark.slow
def test_change_of_quality_level_without_a_crossfade_would_be_a_jump(shot, tmp_path, monkeypatch):
    monkeypatch.setattr(adaptive_quality, "CROSSFADE_FRAMES", 0)
    assert render(shot, tmp_path / "o.mp4", "--hold-budget", "--budget-ms", "0.01") == 0
    verdict = compare(str(tmp_path / "o.mp4"), SourceSettings(spec=str(shot[0]))).verdict
    assert any(one.kind == "pop" and "stays so" in one.text for one in verdict.findings)


@pytest.mark.slow
def test_plate_outside_the_objects_reach_is_unchanged_by_level_changes(shot, tmp_path):
    words = ("--hold-budget", "--budget-ms", "0.01", "--codec", "ffv1")
    assert render(shot, tmp_path / "out.mkv", *words) == 0
    before, after = shots.read_planes(shot[0]), shots.read_planes(tmp_path / "out.mkv")
    for (_, plate), (_, result) in zip(before, after, strict=True):
        assert np.array_equal(plate[0][:60, :60], result[0][:60, :60])


@pytest.mark.slow
def test_met_time_budget_changes_no_bit(shot, tmp_path):
    lossless = ("--codec", "ffv1", "--range", "0:10")
    assert render(shot, tmp_path / "plain.mkv", *lossless) == 0
    words = (*lossless, "--hold-budget", "--budget-ms", "1e6")
    assert render(shot, tmp_path / "held.mkv", *words) == 0
    shots.assert_same_frames(tmp_path / "plain.mkv", tmp_path / "held.mkv")


@pytest.mark.slow
def test_run_summary_states_the_quality_level_changes(shot, tmp_path, capsys):
    plate, glb, fit = shot
    words = (plate, glb, tmp_path / "o.mp4", "--fit", fit, "--json", "--range", "0:30",
             "--hold-budget", "--budget-ms", "0.01")  # fmt: skip
    assert main([*map(str, words)]) == 0
    notes = json.loads(capsys.readouterr().out)["notes"]
    (note,) = (one for one in notes if "budget" in one)
    assert "8 standard" in note or "standard" in note and "to realtime" in note


@pytest.mark.parametrize("preset", ["draft", "paper"])
def test_preset_without_lower_quality_levels_is_refused(shot, tmp_path, preset, capsys):
    assert render(shot, tmp_path / "o.mp4", "--hold-budget", "--preset", preset) == 2
    assert "choose one of them" in capsys.readouterr().err
