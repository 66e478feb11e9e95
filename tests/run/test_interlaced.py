"""A plate of fields is told wherever a plate is described, not composited silently."""

import json
from fractions import Fraction

import av
import numpy as np
import pytest
from support import clips, shots
from support.command import nlens

TOLD = "the plate is interlaced"


@pytest.fixture(scope="module")
def words(tmp_path_factory):
    """The words of a quick run on a clip whose frames consist of two fields each."""
    folder = tmp_path_factory.mktemp("fields")
    frame = av.VideoFrame.from_ndarray(shots.plate(), "rgb24").reformat(format="yuv420p")
    frames = [av.VideoFrame.from_ndarray(frame.to_ndarray(), "yuv420p") for _ in range(3)]
    fields = {"flags": "+ildct+ilme", "b": "4M"}
    plate = clips.write_clip(
        folder / "in.mkv", frames, codec="mpeg2video", options=fields, time_base=Fraction(1, 25),
        pts=range(3),
    )  # fmt: skip
    glb, fit = shots.cube_glb(folder / "anim.glb"), shots.fit_json(folder / "fit.json")
    return [plate, glb, folder / "out.mkv", "--preset", "draft", "--fit", fit, "--no-progress"]


def test_summary_notes_an_interlaced_plate(words, tmp_path):
    run = nlens(*words, "--report", tmp_path)
    assert run.returncode == 0, run.stderr
    (note,) = [line for line in run.stderr.splitlines() if TOLD in line]
    assert note.startswith("note   ") and "bwdif" in note
    assert (tmp_path / "index.html").read_text().count(TOLD.capitalize()) == 1


def test_plan_says_interlaced_in_the_line_of_the_plate(words):
    run = nlens(*words, "--plan", "--json")
    plate, *lines = json.loads(run.stdout)["plan"]
    assert "yuv420p interlaced, 25.000 fps" in plate
    assert any(line.startswith(f"note: {TOLD}") for line in lines)


def test_progressive_plate_is_not_called_interlaced(words, tmp_path):
    frames = [av.VideoFrame.from_ndarray(np.zeros((270, 480, 3), np.uint8), "rgb24")]
    clips.write_clip(tmp_path / "in.mp4", [frames[0].reformat(format="yuv420p")], codec="libx264")
    run = nlens(tmp_path / "in.mp4", *words[1:], "--plan")
    assert "interlaced" not in run.stdout
