"""Plates of known scale: markers and persons, in `solve` and in runs without a camera file."""

import json
import re

import av
import cv2
import numpy as np
import pytest
from support import marker_plates as plates
from support import shots
from support.clips import REPEATABLE
from support.command import nlens, one_line
from support.folders import ROOT

from nlens_video.solve.markers import MarkerFinder

pytestmark = [pytest.mark.needs_gl, pytest.mark.slow]
FOV, HEIGHT, SIDE = 50.0, 1.5, 0.2
LAID = [(-0.7, -2.8), (0.6, -2.7), (-0.4, -3.6), (0.8, -4.0)]
MARKERS = [plates.placed(number, SIDE, *place) for number, place in enumerate(LAID)]
CAMERA = plates.pose(-24.0, 1.0, HEIGHT)


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("scale")
    seen = plates.plate(MARKERS, CAMERA, FOV)
    cv2.imwrite(str(folder / "still.png"), seen)
    with av.open(str(folder / "still.mp4"), "w") as container:
        options = {"crf": "20", **REPEATABLE["libx264"]}
        stream = container.add_stream("libx264", rate=25, options=options)
        stream.width, stream.height, stream.pix_fmt = 960, 512, "yuv420p"
        for seed in range(4):
            noise = np.random.default_rng(seed).normal(0.0, 2.0, seen.shape)
            grey = np.clip(seen + noise, 0, 255).astype(np.uint8)
            picture = np.repeat(grey[..., None], 3, axis=2)
            container.mux(stream.encode(av.VideoFrame.from_ndarray(picture, "rgb24")))
        container.mux(stream.encode())
    shots.cube_glb(folder / "bare.glb", camera=False, sun=False)
    shots.fit_json(folder / "fit.json", 960, 512)
    return folder


def solved(files, plate, tmp_path, *words):
    run = nlens("solve", files / plate, tmp_path / "camera.json", "--no-progress", *words)
    assert run.returncode == 0, run.stderr
    return json.loads((tmp_path / "camera.json").read_text()), run


def eye_height(camera):
    return float(np.linalg.inv(np.array(camera["frames"][0]["world_to_camera"]))[1, 3])


@pytest.mark.parametrize("plate", ["still.png", "still.mp4"])
def test_markers_of_a_file_give_pose_and_scale(files, tmp_path, plate):
    camera, run = solved(files, plate, tmp_path, "--marker", "20cm")
    pose = np.linalg.inv(np.array(camera["frames"][0]["world_to_camera"]))
    tilt = np.degrees(np.arccos(min(1.0, pose[1, :3] @ CAMERA[1, :3])))
    assert tilt < 0.3
    assert pose[1, 3] == pytest.approx(HEIGHT, rel=0.01)
    assert camera["frames"][0]["fov_x_deg"] == pytest.approx(FOV, rel=0.02)
    assert camera["scale"] == "metres" and camera["horizon"] == "measured"
    assert "4 markers (DICT_5X5)" in run.stderr


def person_box(x, z, tall):
    """The box of an upright person by the camera of the plates, 0.5 m wide."""
    focal = 0.5 * 960 / np.tan(np.radians(FOV) / 2)
    ends = np.array([[x - 0.25, 0.0, z], [x + 0.25, tall, z]]) - CAMERA[:3, 3]
    seen = ends @ CAMERA[:3, :3]
    columns = 0.5 - focal * seen[:, 0] / seen[:, 2] / 960
    rows = 0.5 + focal * seen[:, 1] / seen[:, 2] / 512
    return f"{columns[0]:.4f},{rows[1]:.4f},{columns[1]:.4f},{rows[0]:.4f}"


def test_person_gives_the_scale(files, tmp_path):
    # The markers give the attitude here, as a plate's lines would.
    metric, _ = solved(files, "still.png", tmp_path, "--marker", "0.2m")
    arbitrary, _ = solved(files, "still.png", tmp_path)
    words = ("--person-height", "1.75", "--person", person_box(0.1, -4.5, 1.75))
    camera, run = solved(files, "still.png", tmp_path, *words)
    assert camera["scale"] == "metres" and "a person of 1.75 m" in run.stderr
    assert arbitrary["scale"] == "arbitrary"
    pitches = [np.array(one["frames"][0]["world_to_camera"])[2, 1] for one in (metric, camera)]
    assert pitches[1] == pytest.approx(pitches[0], abs=0.2)
    assert eye_height(camera) == pytest.approx(HEIGHT, rel=0.25)


def test_run_without_a_camera_uses_the_markers(files, tmp_path):
    words = ("--marker", "0.2m", "--fit", files / "fit.json", "--preset", "draft", "--no-progress")
    run = nlens(files / "still.png", files / "bare.glb", tmp_path / "out.png", *words)
    assert run.returncode == 0, run.stderr
    assert "pitch -24" in run.stderr and "(measured)" in run.stderr
    assert (tmp_path / "out.png").is_file()


def rows_changed(plate, result):
    """Rows that differ."""
    before, after = (cv2.imread(str(path)).astype(int) for path in (plate, result))
    return np.flatnonzero((abs(before - after).max(axis=2) > 25).any(axis=1))


def test_height_in_metres_is_as_tall_as_a_person_of_that_height(files, tmp_path):
    at = (0.5, 0.75)
    words = (
        "--marker", "0.2m", "--at", "0.5,0.75", "--height", "40cm", "--fit", files / "fit.json",
        "--preset", "draft", "--effects", "none", "--no-progress",
    )  # fmt: skip
    run = nlens(files / "still.png", files / "bare.glb", tmp_path / "out.png", *words)
    assert run.returncode == 0, run.stderr
    assert "placed by --at 0.5,0.75 --height 0.4m" in run.stderr
    focal = 0.5 * 960 / np.tan(np.radians(FOV) / 2)
    ray = CAMERA[:3, :3] @ [0.0, -(at[1] * 512 - 256) / focal, -1.0]
    foot = CAMERA[:3, 3] - HEIGHT / ray[1] * ray
    rows = rows_changed(files / "still.png", tmp_path / "out.png")
    # The highest row is that of a far upper corner, up to half the cube's diagonal behind.
    middle, corner = (
        (foot + [0.0, 0.4, -0.283 * far] - CAMERA[:3, 3]) @ CAMERA[:3, :3] for far in (0, 1)
    )
    highest, lowest = (256 - focal * top[1] / -top[2] for top in (corner, middle))
    assert highest - 3 < rows[0] < lowest


@pytest.mark.parametrize(
    ("words", "code", "line"),
    [
        (["--person-height", "1.75"], 2, "give both --person-height"),
        (["--person", "0.4,0.2,0.5,0.9"], 2, "give both --person-height"),
        (["--person-height", "1.75", "--person", "0.4,-0.9,0.5,-0.5"], 3, "horizon"),
        (["--person-height", "1.75", "--person", "0.5,0.5"], 3, "no upright person is found"),
        (["--person-height", "1", "--person", "0.4,0.2,0.5,0.9", "--marker", "1m"], 2, "both"),
        (["--marker", "2ft"], 2, "is not a length"),
    ],
)
def test_scale_that_makes_no_sense_is_refused(files, tmp_path, words, code, line):
    run = nlens("solve", files / "still.png", tmp_path / "camera.json", *words)
    one_line(run, code)
    assert line in run.stderr


def test_scale_beside_a_camera_file_is_refused(files, tmp_path):
    solved(files, "still.png", tmp_path)
    words = ("--camera-from", tmp_path / "camera.json", "--marker", "0.2m")
    run = nlens(files / "still.png", files / "bare.glb", tmp_path / "out.png", *words)
    one_line(run, 2)
    assert "nlens-video solve" in run.stderr


def test_sheet_of_the_page_shows_a_marker(tmp_path, monkeypatch):
    page = (ROOT / "docs" / "camera.md").read_text(encoding="utf-8")
    code = re.search(r"^```python\n(import cv2.*?)^```", page, re.M | re.S)
    monkeypatch.chdir(tmp_path)
    exec(code[1])
    sheet = cv2.imread("marker.png", cv2.IMREAD_GRAYSCALE)
    finder = MarkerFinder()
    finder.add(cv2.resize(sheet, None, fx=0.2, fy=0.2, interpolation=cv2.INTER_AREA))
    ((sighting,), family) = finder.sightings()
    assert sighting.ids.tolist() == [0]
    assert "4x4" in family.lower()
    sides = np.linalg.norm(np.diff(sighting.corners[0], axis=0), axis=1)
    assert sides == pytest.approx(240.0, abs=0.5)
