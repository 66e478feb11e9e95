"""Cameras of plates whose pixels are not square: files of all formats, and what they are of."""

import json
import math

import numpy as np
import pytest
from msgspec.structs import replace
from support.camera_files import RATE, fspy, pose_of, write_colmap
from support.glb_builder import GlbBuilder

from nlens_video.cameras.files import camera_bytes, read_camera
from nlens_video.cameras.solved import CameraKey, SolvedCamera
from nlens_video.core.errors import SceneError
from nlens_video.scene.camera import Camera

STORED, ASPECT, SHOWN = (480, 512), 2.0, (960, 512)  # a plate as it is stored, and displayed
FORMATS = ("camera.json", "camera.glb", "camera.usda", "camera.chan")


def shown(**fields):
    """The camera of the displayed plate."""
    key = CameraKey(
        index=0, pts_s=0.0, world_to_camera=np.linalg.inv(pose_of()), fov_x_deg=50.0
    )  # fmt: skip
    return SolvedCamera(width=SHOWN[0], height=SHOWN[1], keys=(key,), **fields)


def read(tmp_path, name, camera, size=STORED, aspect=ASPECT):
    path = tmp_path / name
    path.write_bytes(camera_bytes(camera, path))
    return read_camera(path, size, RATE, pixel_aspect=aspect)


def assert_sees_as(camera: Camera, other: Camera):
    """Whether a camera sees what another does, at its own size."""
    resized = other.resized(camera.width, camera.height)
    for name in ("fx", "fy", "cx", "cy"):
        assert getattr(camera, name) == pytest.approx(getattr(resized, name), rel=1e-6), name


def test_solved_camera_has_the_focal_lengths_of_a_virtual_one():
    solved = replace(shown(), width=STORED[0], pixel_aspect=ASPECT).at(0.0)
    tan = math.tan(math.radians(25.0)) * SHOWN[1] / SHOWN[0]
    virtual = Camera.from_yfov(np.eye(4), 2.0 * math.atan(tan), *STORED, ASPECT)
    assert_sees_as(solved, virtual)


@pytest.mark.parametrize("name", FORMATS)
def test_camera_of_the_displayed_plate_is_that_of_the_stored_one(tmp_path, name):
    camera = read(tmp_path, name, shown())
    assert (camera.width, camera.height, camera.pixel_aspect) == (*STORED, ASPECT)
    assert_sees_as(camera.at(0.0), shown().at(0.0))


@pytest.mark.parametrize("name", FORMATS)
@pytest.mark.parametrize(("size", "aspect"), [(STORED, ASPECT), (SHOWN, 1.0)])
def test_camera_of_a_stored_plate_comes_back(tmp_path, name, size, aspect):
    stored = shown().resized(*STORED, ASPECT)
    camera = read(tmp_path, name, stored, size, aspect)
    assert (camera.width, camera.height, camera.pixel_aspect) == (*size, aspect)
    assert_sees_as(camera.at(0.0), shown().at(0.0))


@pytest.mark.parametrize("name", ["camera.json", "camera.usda"])
def test_principal_point_goes_with_the_pixels(tmp_path, name):
    off = shown(principal_px=(500.0, 230.0))
    for camera in (off, off.resized(*STORED, ASPECT)):
        assert read(tmp_path, name, camera).principal_px == pytest.approx((250.0, 230.0))


def test_camera_json_of_the_plates_own_size_has_the_plates_pixels(tmp_path):
    values = json.loads(shown().to_json()) | {"width": STORED[0]}
    path = tmp_path / "camera.json"
    path.write_text(json.dumps(values))
    camera = read_camera(path, STORED, RATE, pixel_aspect=ASPECT)
    assert camera.keys[0].fov_x_deg == 50.0
    assert_sees_as(camera.at(0.0), shown().at(0.0))


def test_camera_json_of_a_plate_without_a_known_pixel_aspect_keeps_its_own(tmp_path):
    stored = shown().resized(*STORED, ASPECT)
    assert read(tmp_path, "camera.json", stored, aspect=None).to_json() == stored.to_json()


@pytest.mark.parametrize("value", [0.0, -1.0, "2", None])
def test_pixel_aspect_of_camera_json_that_is_no_number_above_0_is_refused(tmp_path, value):
    values = json.loads(shown().to_json()) | {"pixel_aspect": value}
    path = tmp_path / "camera.json"
    path.write_text(json.dumps(values))
    with pytest.raises(SceneError, match='"pixel_aspect"'):
        read_camera(path, SHOWN, RATE)


def test_camera_of_another_displayed_shape_is_refused(tmp_path):
    path = tmp_path / "camera.json"
    path.write_text(shown().to_json())
    with pytest.raises(SceneError, match=r"960x512, the plate has 480x512 with pixels of 1\.5:1"):
        read_camera(path, STORED, RATE, pixel_aspect=1.5)


@pytest.mark.parametrize(("made_for", "refused"), [(16 / 9, False), (4 / 3, True)])
def test_camera_of_a_glb_is_compared_with_the_displayed_plate(tmp_path, made_for, refused):
    builder = GlbBuilder()
    builder.node(camera=builder.camera(0.5, aspect=made_for))
    path = builder.write(tmp_path / "camera.glb")
    if refused:
        with pytest.raises(SceneError, match=r"1\.333:1, the plate is displayed as 1\.778:1"):
            read_camera(path, (1440, 1080), RATE, pixel_aspect=4 / 3)
        return
    camera = read_camera(path, (1440, 1080), RATE, pixel_aspect=4 / 3).at(0.0)
    assert_sees_as(camera, Camera.from_yfov(np.eye(4), 0.5, 1440, 1080, 4 / 3))


def test_export_of_fspy_is_of_the_displayed_picture(tmp_path):
    path = tmp_path / "plate.json"
    path.write_text(json.dumps(fspy(pose_of())))
    camera = read_camera(path, STORED, RATE, pixel_aspect=ASPECT)
    assert camera.at(0.0).fy == pytest.approx(ASPECT * camera.at(0.0).fx)
    path.write_text(json.dumps(fspy(pose_of()) | {"imageWidth": STORED[0]}))
    with pytest.raises(SceneError, match="open the plate's picture in fSpy as it is .* 960x512"):
        read_camera(path, STORED, RATE, pixel_aspect=ASPECT)


def colmap(folder, camera):
    """A model of COLMAP with a line of `cameras.txt`, from its model on."""
    poses = [pose_of(eye=(0.1 * n, 1.6, 0.5)) for n in range(4)]
    rng = np.random.default_rng(3)
    ground = np.stack([rng.uniform(-3, 3, 300), np.zeros(300), rng.uniform(-8, -2, 300)], axis=1)
    written = write_colmap(folder / "sparse", poses, ground)
    (written / "cameras.txt").write_text(f"1 {camera}\n")
    return written


@pytest.mark.parametrize(
    ("camera", "size", "aspect"),
    [
        ("PINHOLE 480 512 514.5 1029 240 256", STORED, ASPECT),
        ("OPENCV 480 512 514.5 1032 240 256 0 0 0 0", STORED, ASPECT),
        ("PINHOLE 960 512 1029 1029 480 256", STORED, ASPECT),
        ("SIMPLE_PINHOLE 960 512 1029 480 256", STORED, ASPECT),
        ("PINHOLE 960 512 1029 1029 480 256", SHOWN, 1.0),
    ],
)
def test_two_focal_lengths_of_colmap_are_those_of_the_plates_pixels(
    tmp_path, camera, size, aspect
):  # fmt: skip
    found = read_camera(colmap(tmp_path, camera), size, RATE, pixel_aspect=aspect)
    assert (found.width, found.height, found.pixel_aspect) == (*size, aspect)
    yfov = 2.0 * math.atan(256.0 / 1029.0)
    assert_sees_as(found.at(0.0), Camera.from_yfov(np.eye(4), yfov, *SHOWN))


@pytest.mark.parametrize(
    ("camera", "size", "aspect"),
    [
        ("PINHOLE 960 512 1029 1040 480 256", SHOWN, 1.0),
        ("SIMPLE_PINHOLE 480 512 1029 240 256", STORED, ASPECT),
        ("FULL_OPENCV 960 512 1029 2058 480 256 0 0 0 0 0 0 0 0", STORED, ASPECT),
    ],
)
def test_focal_lengths_of_colmap_for_other_pixels_than_the_plates_are_refused(
    tmp_path, camera, size, aspect
):  # fmt: skip
    folder = colmap(tmp_path, camera)
    with pytest.raises(SceneError, match="times as wide as high.*SIMPLE_RADIAL"):
        read_camera(folder, size, RATE, pixel_aspect=aspect)
