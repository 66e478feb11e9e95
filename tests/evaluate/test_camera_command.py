"""`evaluate camera` on plates that the test makes."""

import json
from types import SimpleNamespace

import cv2
import pytest
from support.command import nlens, one_line
from support.known_cameras import write_pan, write_still

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def measured(tmp_path_factory):
    home = tmp_path_factory.mktemp("known")
    write_still(home / "stills" / "one")
    write_pan(home / "clips" / "pan")
    out = tmp_path_factory.mktemp("out") / "figures"
    run = nlens("evaluate", "camera", home, "--out", out, "--json")
    assert run.returncode == 0, run.stderr
    return SimpleNamespace(figures=json.loads(run.stdout), out=out, home=home)


def row(measured, table, name):
    (found,) = [r for r in measured.figures[table]["summary"] if r["name"] == name]
    return found


def test_stills_and_clips_are_both_measured(measured):
    assert measured.figures["plates"] == ["clips/pan", "stills/one"]
    assert measured.figures["not_solved"] == []


def test_ground_is_followed_through_a_pan(measured):
    pan = row(measured, "clips", "pan")
    assert pan["ground_px"] < 0.7 and abs(pan["fov_percent_worst"]) < 3.0
    assert pan["solved"] == 100.0 and pan["cpu_s"] > 0.0


def test_still_is_compared_with_its_camera(measured):
    one = row(measured, "stills", "stills/one")
    assert one["pitch_true"] < 0.0 and one["fov_true"] == pytest.approx(66.0, abs=0.1)
    assert one["pitch_stated"] > 0.0
    (noise,) = measured.figures["errors"]["plates"][:1]
    assert noise["plate"] == "stills/one" and noise["all"] == pytest.approx(abs(one["pitch_error"]))


def test_each_cue_is_solved_by_alone(measured):
    rows = {r["name"]: r for r in measured.figures["cues"]["plates"]}
    assert list(rows) == ["lines", "blur", "network", "lines and blur", "all three"]
    every = row(measured, "stills", "stills/one")
    assert rows["all three"]["all"] == pytest.approx(abs(every["pitch_error"]))
    # The plate is a sharp photograph: its blur tells hardly anything of the ground.
    assert len({rows[cue]["all"] for cue in ("lines", "blur", "network")}) == 3


def test_object_is_measured_by_both_cameras(measured):
    rows = {r["name"]: r for r in measured.figures["objects"]["summary"]}
    assert set(rows) == {"by the solved camera", "by the true camera"}
    assert rows["by the true camera"]["object_px"] < 3.0


def test_tables_and_plots_are_written(measured):
    assert sorted(path.name for path in measured.out.iterdir()) == [
        "areas.csv", "camera.md", "clips.csv", "cues.csv", "errors.csv", "errors.png",
        "objects.csv", "stated.png", "stills.csv",
    ]  # fmt: skip
    for name in ("errors.png", "stated.png"):
        plot = cv2.imread(str(measured.out / name))
        assert plot is not None and plot.shape[0] > 300 and plot.std() > 5
    text = (measured.out / "camera.md").read_text()
    assert "# Cameras of 1 still plates and 1 clips" in text and "nan" not in text


def test_plate_that_cannot_be_solved_is_named_and_counts_as_not_solved(tmp_path):
    (write_pan(tmp_path / "broken") / "bg.mp4").write_bytes(b"no clip")
    run = nlens("evaluate", "camera", tmp_path, "--out", tmp_path / "out")
    assert run.returncode == 0, run.stderr
    assert "Not solved: broken: " in run.stdout
    heading, line = (tmp_path / "out" / "clips.csv").read_text().splitlines()
    assert dict(zip(heading.split(","), line.split(","), strict=True))["solved"] == "0.0000"
    assert not (tmp_path / "out" / "errors.png").exists()


def test_folder_without_known_cameras_is_refused_in_one_line(tmp_path):
    assert "view_matrix_gltf" in one_line(nlens("evaluate", "camera", tmp_path), 3)
