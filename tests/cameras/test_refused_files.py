"""What is no camera is refused in one line: what came, what was expected, what to do."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from support.camera_files import RATE, SIZE, fspy, path_of, pose_of, write_colmap

from nlens_video.cameras.files import camera_bytes, read_camera
from nlens_video.core.errors import SceneError

FORMATS = (".json", ".chan", ".glb", ".usda")
REMEDY = re.compile(r"expected|again|truncated|give|name it")


def refusal(path):
    """The line that refuses a file; no reason of the system's own words is in it."""
    with pytest.raises(SceneError) as refused:
        read_camera(path, SIZE, RATE)
    line = str(refused.value)
    assert "\n" not in line
    assert "Errno" not in line
    assert "codec" not in line
    assert line.startswith(str(path))
    assert REMEDY.search(line), line
    return line


@pytest.mark.parametrize("suffix", [*FORMATS, ".gltf", ".usdz", ""])
def test_file_that_is_not_there_is_told_with_what_is_read(tmp_path, suffix):
    assert "there is no such file or folder; expected camera.json" in refusal(
        tmp_path / f"camera{suffix}"
    )


@pytest.mark.parametrize("suffix", FORMATS)
def test_empty_file_is_refused(tmp_path, suffix):
    path = tmp_path / f"camera{suffix}"
    path.touch()
    refusal(path)


@pytest.mark.parametrize("suffix", FORMATS)
def test_half_of_a_file_is_refused(tmp_path, suffix):
    path = tmp_path / f"camera{suffix}"
    whole = camera_bytes(path_of(), path)
    path.write_bytes(whole[: len(whole) // 2])
    refusal(path)


@pytest.mark.parametrize(
    ("name", "begin", "kind"),
    [
        ("in.mp4", b"\0\0\0\x20ftypisom", "a video"),
        ("in.mov", b"\0\0\0\x14ftypqt  ", "a video"),
        ("in.mkv", b"\x1a\x45\xdf\xa3", "a video"),
        ("in.avi", b"RIFF\x10\0\0\0AVI ", "a video"),
        ("in.png", b"\x89PNG\r\n", "a picture"),
        ("in.jpg", b"\xff\xd8\xff\xe0", "a picture"),
    ],
)
def test_plate_in_place_of_its_camera_is_told_as_one(tmp_path, name, begin, kind):
    path = tmp_path / name
    path.write_bytes(begin + bytes(range(256)))
    line = refusal(path)
    assert f"this is {kind}, no camera file" in line and "nlens-video solve IN" in line


@pytest.mark.parametrize(
    ("suffix", "other"),
    [(suffix, other) for suffix in FORMATS for other in FORMATS if suffix != other],
)
def test_file_of_another_kind_than_its_name_says_is_refused(tmp_path, suffix, other):
    path = tmp_path / f"camera{suffix}"
    path.write_bytes(camera_bytes(path_of(), Path(f"camera{other}")))
    refusal(path)


@pytest.mark.parametrize("suffix", FORMATS)
def test_file_of_noise_is_refused(tmp_path, suffix):
    path = tmp_path / f"camera{suffix}"
    path.write_bytes(np.random.default_rng(3).bytes(2000))
    refusal(path)


def test_binary_gltf_named_as_text_is_told_by_its_name(tmp_path):
    path = tmp_path / "camera.json"
    path.write_bytes(camera_bytes(path_of(), Path("camera.glb")))
    assert "a binary glTF file" in refusal(path)
    assert refusal(path).endswith("name it .glb")


def test_project_of_fspy_is_told_to_export_its_camera(tmp_path):
    path = tmp_path / "plate.fspy"
    path.write_bytes(b"fspy" + bytes(60))
    assert refusal(path).endswith("File, Export, Camera parameters as JSON")


@pytest.mark.parametrize("member", ["imageWidth", "horizontalFieldOfView", "viewTransform"])
def test_export_of_fspy_without_a_member_names_it(tmp_path, member):
    path = tmp_path / "plate.json"
    path.write_text(json.dumps({name: v for name, v in fspy(pose_of()).items() if name != member}))
    with pytest.raises(SceneError, match=f"export of fSpy without {member}"):
        read_camera(path, SIZE, RATE)


@pytest.mark.parametrize("rows", [0, 10**400])
def test_export_of_fspy_of_a_size_that_no_picture_has_is_refused(tmp_path, rows):
    path = tmp_path / "plate.json"
    path.write_text(json.dumps(fspy(pose_of()) | {"imageHeight": rows}))
    with pytest.raises(SceneError, match="export of fSpy whose matrix, field of view or size"):
        read_camera(path, SIZE, RATE)


def test_export_of_fspy_with_z_downwards_is_refused(tmp_path):
    path = tmp_path / "plate.json"
    path.write_text(json.dumps(fspy(pose_of(eye=(0.2, -1.6, 0.5)))))
    with pytest.raises(SceneError, match="below its ground z = 0; expected the z axis upwards"):
        read_camera(path, SIZE, RATE)


@pytest.fixture
def model(tmp_path):
    rng = np.random.default_rng(2)
    ground = np.column_stack([rng.uniform(-3, 3, 200), np.zeros(200), rng.uniform(-9, -1, 200)])
    poses = [pose_of(roll=0.0, eye=(0.1 * n, 1.6, 0.0)) for n in range(3)]
    return write_colmap(tmp_path / "sparse", poses, ground)


@pytest.mark.parametrize("name", ["cameras.txt", "images.txt", "points3D.txt"])
def test_model_of_colmap_without_a_file_names_it(model, name):
    (model / name).unlink()
    assert f"a folder without {name}; expected a COLMAP text model" in refusal(model)


@pytest.mark.parametrize("name", ["cameras.txt", "images.txt", "points3D.txt"])
@pytest.mark.parametrize("content", [b"", b"1 2", b"1 a b c\n", bytes(range(128, 256))])
def test_damaged_file_of_a_model_of_colmap_is_refused(model, name, content):
    (model / name).write_bytes(content)
    with pytest.raises(SceneError, match=name) as refused:
        read_camera(model, SIZE, RATE)
    assert "Errno" not in str(refused.value)
    assert "codec" not in str(refused.value)


def test_half_a_points_line_of_colmap_is_refused(model):
    text = (model / "points3D.txt").read_text()
    (model / "points3D.txt").write_text(text + "201 0.5")
    with pytest.raises(SceneError, match="'201 0.5' is no point"):
        read_camera(model, SIZE, RATE)


def test_one_file_of_a_model_of_colmap_asks_for_its_folder(model):
    assert refusal(model / "images.txt").endswith(f"expected its folder; give {model}")


def test_pictures_of_colmap_without_numbers_are_refused(model):
    text = (model / "images.txt").read_text()
    (model / "images.txt").write_text(re.sub(r"shot/frame_\d+", "plate", text))
    with pytest.raises(SceneError, match="named after frames, as frame_0001.png"):
        read_camera(model, SIZE, RATE)


@pytest.mark.parametrize(
    ("camera", "missed"),
    [
        ("RADIAL 960 512 700 480 256 -0.1 0.2", "4.1"),
        ("OPENCV 960 512 700 700 480 256 -0.1 0 0.03 0", "2.2"),  # p1
        ("OPENCV 960 512 700 700 480 256 -0.1 0 0 0.03", "3.6"),  # p2
        ("FULL_OPENCV 960 512 700 700 480 256 -0.1 0 0 0 0.2 0 0 0", "2.5"),  # k3
        ("FULL_OPENCV 960 512 700 700 480 256 0.5 0 0 0 0 0.5 0 0", "17.1"),  # k4
        ("RADIAL 960 512 1e-200 480 256 -0.1 0.2", "inf"),
    ],
)
def test_distortion_that_one_coefficient_does_not_hold_is_refused(model, camera, missed):
    (model / "cameras.txt").write_text(f"1 {camera}\n")
    with pytest.raises(SceneError, match=f"one k1 for all pictures misses by {missed} % of the"):
        read_camera(model, SIZE, RATE)


@pytest.mark.parametrize("name", ["p1", "p2", "k3", "k4", "k5", "k6"])
@pytest.mark.parametrize(("size", "held"), [(0.002, True), (0.5, False)])
def test_each_coefficient_of_colmap_is_held_against_the_frames_edge(model, name, size, held):
    others = {part: 0.0 for part in ("p1", "p2", "k3", "k4", "k5", "k6")}
    values = " ".join(map(str, (others | {name: size}).values()))
    (model / "cameras.txt").write_text(f"1 FULL_OPENCV 960 512 700 700 480 256 -0.1 0 {values}\n")
    if held:
        assert read_camera(model, SIZE, RATE).distortion_k1 == -0.1
    else:
        with pytest.raises(SceneError, match="one k1 for all pictures misses"):
            read_camera(model, SIZE, RATE)
