import json
import math
import os
import subprocess
import sys

import cv2
import numpy as np
import pytest
from support.folders import SAMPLES

from nlens_video.scene.surround import sphere


@pytest.fixture(autouse=True)
def _samples_on_the_path(monkeypatch):
    monkeypatch.syspath_prepend(str(SAMPLES))


@pytest.fixture
def plates(tmp_path):
    """Two synthetic plates as samples/truth writes them: bright and dark, CoC signed."""
    from truth.develop import write_exr

    rng = np.random.default_rng(0)
    for name, level, coc in (("1_mid", 0.8, -7.0), ("2_back", 0.02, 12.0)):
        folder = tmp_path / "plates" / name
        folder.mkdir(parents=True)
        light = np.float16(level * rng.random((512, 640, 1)) * np.ones(3))
        write_exr(
            folder / "bg.exr", {c: np.ascontiguousarray(light[..., i]) for i, c in enumerate("RGB")}
        )
        np.save(folder / "bg_coc.npy", np.full((512, 640), coc, np.float16))
    return tmp_path / "plates"


def test_thin_lens_coc_agrees_with_a_hand_calculation():
    from truth.plan import Lens

    # A = 50 / 2 = 25 mm; 25 * 50 / (2000 - 50) = 0.641 mm on the sensor; * 960 / 36 = 17.09 px
    lens = Lens(focal_mm=50.0, f_number=2.0, focus_m=2.0)
    assert lens.coc_at_infinity_px == pytest.approx(17.094, abs=1e-3)
    assert lens.coc_px(1.0) == pytest.approx(17.094, abs=1e-3)  # nearer: positive
    assert lens.coc_px(2.0) == pytest.approx(0.0, abs=1e-12)
    assert lens.coc_px(4.0) == pytest.approx(-8.547, abs=1e-3)
    # Cycles' aperture must be wider by zf / (zf - f): its sensor stays at f
    assert lens.blender_f_number == pytest.approx(1.95)


def test_sky_has_the_coc_of_infinity_scaled_with_the_picture():
    from truth.develop import NO_OBJECT_M, coc_map
    from truth.plan import Lens

    lens = Lens(focal_mm=50.0, f_number=2.0, focus_m=2.0)
    found = coc_map(lens, np.float32([[NO_OBJECT_M, 1.0]]), 480)
    assert found.dtype == np.float16
    np.testing.assert_allclose(found, [[-8.547, 8.547]], atol=5e-3)


@pytest.mark.parametrize("seed", range(20))
def test_random_lenses_keep_the_grounds_coc_within_the_limit(seed):
    from truth import subject
    from truth.plan import FOCUSES, MAX_COC_PX, draw_lens, draw_view

    view = draw_view(seed)
    near, middle, far = depths = subject.depths(view, subject.mesh(view))
    lenses = {focus: draw_lens(view, focus, depths) for focus in FOCUSES}
    assert lenses["front"].focus_m < near < lenses["mid"].focus_m < far < lenses["back"].focus_m
    for lens in lenses.values():
        assert np.abs(lens.coc_px([view.nearest_m, view.farthest_m])).max() <= MAX_COC_PX


CAMERAS = pytest.mark.parametrize("camera", ["usual", "wild", "built", "hard", "backed"])


@CAMERAS
@pytest.mark.parametrize("seed", range(4))
def test_camera_matrices_and_view_project_to_the_same_pixel(seed, camera):
    from truth.plan import HEIGHT, WIDTH, draw_view, matrices

    view = draw_view(seed, camera)
    x, y = view.place
    known = matrices(view)
    camera = np.array(known["view_matrix_gltf"]) @ [x, 0.3, -y, 1.0]
    same = np.array(known["view_matrix_blender"]) @ [x, y, 0.3, 1.0]
    np.testing.assert_allclose(camera, same)
    clip = np.array(known["projection_matrix_opengl"]) @ camera
    column, row = 0.5 * WIDTH * (1 + clip[0] / clip[3]), 0.5 * HEIGHT * (1 - clip[1] / clip[3])
    expected = view.project(np.array([[x, y, 0.3]]))[0]
    np.testing.assert_allclose([column, row, clip[3]], expected)


@CAMERAS
def test_ground_point_has_the_requested_column_and_depth(camera):
    from truth.plan import draw_view

    view = draw_view(3, camera)
    x, y = view.on_ground(200.0, 2.0, level=-0.5)
    column, _, depth = view.project(np.array([[x, y, -0.5]]))[0]
    assert (column, depth) == (pytest.approx(200.0), pytest.approx(2.0))


def test_usual_cameras_have_no_roll_and_no_bare_scene():
    from truth.plan import draw_view

    assert {(v.roll_deg, v.bare) for v in map(draw_view, range(30))} == {(0.0, False)}


def test_wild_cameras_cover_their_range_and_every_third_scene_is_bare():
    from truth.plan import draw_view

    views = [draw_view(seed, "wild") for seed in range(300)]
    for values, low, high in (
        ([v.focal_mm for v in views], 24, 85),
        ([v.pitch_deg for v in views], 3, 50),
        ([v.roll_deg for v in views], -4, 4),
    ):
        reach = high - low
        assert low <= min(values) < low + 0.05 * reach and high - 0.05 * reach < max(values) <= high
    assert [v.bare for v in views[:6]] == [True, False, False, True, False, False]


def test_world_leans_right_in_the_picture_where_roll_is_positive():
    from dataclasses import replace

    from truth.plan import draw_view, matrices

    known = matrices(replace(draw_view(1, "wild"), pitch_deg=0.0, roll_deg=3.0))
    up = np.array(known["view_matrix_gltf"])[:3, 1]
    assert np.degrees(np.arctan2(up[0], up[1])) == pytest.approx(3.0)


def test_no_ground_in_view_of_a_rolled_camera_comes_nearer_than_its_nearest():
    from truth.plan import HEIGHT, NEAREST, WIDTH, draw_view

    view = draw_view(8002, "wild")
    depths = np.linspace(view.nearest_m / NEAREST, 3.0, 2000)
    columns = (0.0, WIDTH)
    ground = np.array([(*view.on_ground(c, d), 0.0) for c in columns for d in depths])
    seen = view.project(ground)
    lowest = seen[seen[:, 1] <= HEIGHT, 2].min()
    assert lowest == pytest.approx(view.nearest_m / NEAREST, rel=2e-3)


@pytest.mark.parametrize("seed", range(8))
def test_random_object_faces_outwards_and_stands_on_the_ground_in_view(seed):
    from truth import subject
    from truth.plan import WIDTH, draw_view

    view = draw_view(seed)
    body = subject.mesh(view)
    corner = body.positions[body.triangles] - body.positions.mean(0)
    assert np.einsum("ij,ij->", corner[:, 0], np.cross(corner[:, 1], corner[:, 2])) > 0
    assert body.positions[:, 2].min() == pytest.approx(0.0, abs=1e-9)
    columns = view.project(body.positions)[:, 0]
    assert columns.min() > 0 and columns.max() < WIDTH
    np.testing.assert_array_equal(subject.paint(view), subject.paint(view))


@CAMERAS
def test_written_object_is_loaded_with_its_camera(tmp_path, camera):
    from truth import subject
    from truth.develop import write_glb
    from truth.plan import HEIGHT, WIDTH, draw_view

    from nlens_video.scene.scene import Scene

    view = draw_view(5, camera)
    body = subject.mesh(view)
    sun = {"direction_gltf": [0.0, -1.0, 0.0], "color": [1, 1, 1], "irradiance_w_m2": 2.0}
    write_glb(view, body, sun, tmp_path)
    scene = Scene.load(tmp_path / "object.glb")
    seen = scene.camera(0.0, WIDTH, HEIGHT)
    points = np.c_[scene.pose(0.0).vertices(), np.ones(3 * len(body.triangles))]
    x, y, z, _ = np.linalg.inv(seen.world_from_camera) @ points.T
    found = np.stack([seen.cx - seen.fx * x / z, seen.cy + seen.fy * y / z, -z], axis=1)
    expected = view.project(body.positions[body.triangles.ravel()])
    np.testing.assert_allclose(found, expected, atol=1e-3)


@pytest.mark.parametrize("diameter", [6.0, 17.0])
def test_disc_diameter_is_computed_from_its_variance(diameter):
    from truth.develop import variance_px2

    axis = np.arange(-200, 201) / 8.0
    disc = np.float64(np.hypot(axis[:, None], axis) <= diameter / 2)
    assert 4.0 * np.sqrt(variance_px2(disc)) / 8.0 == pytest.approx(diameter, rel=0.01)


def test_reservoir_of_rendered_plates_holds_the_unsigned_coc_of_every_plate(plates, tmp_path):
    from models.coc.data import Reservoir
    from models.coc.rendered import fill, plate_folders

    store = Reservoir(tmp_path / "store", capacity=4)
    fill(store, plate_folders(plates), 4, seed=1)
    found = sorted(float(label.mean()) for label in store.labels)
    np.testing.assert_allclose(found, [7.0, 7.0, 12.0, 12.0], atol=0.01)
    assert (np.asarray(store.pictures).std((1, 2, 3)) > 0).all()


def test_second_run_replaces_the_oldest_crops(plates, tmp_path):
    from models.coc.data import Reservoir
    from models.coc.rendered import fill, plate_folders

    store = Reservoir(tmp_path / "store", capacity=2)
    fill(store, plate_folders(plates), 2, seed=1)
    before = np.array(store.pictures)
    fill(store, plate_folders(plates), 2, seed=1)
    assert store.drawn == 4
    assert (before != store.pictures).mean() > 0.1


def test_unfinished_plates_are_skipped_and_small_ones_refused(plates):
    from models.coc.rendered import Plate, plate_folders

    (plates / "2_back").rename(plates / "2_back.new")
    (only,) = plate_folders(plates)
    np.save(only / "bg_coc.npy", np.zeros((100, 640), np.float16))
    with pytest.raises(ValueError, match="expected the same size, 512 px or more"):
        Plate.load(only)


@pytest.mark.slow
@pytest.mark.needs_blender
def test_map_of_a_sunny_scene_holds_its_sun_once(tmp_path):
    command = [sys.executable, "-m", "truth.make", "--seed", "8105", "--focus", "mid", "--shadow"]
    command += ["--percent", "5", "--samples", "2", "--out", str(tmp_path)]
    path = os.pathsep.join([str(SAMPLES), str(SAMPLES.parent)])
    subprocess.run(command, check=True, env={**os.environ, "PYTHONPATH": path})
    folder = tmp_path / "8105_mid"
    known = json.loads((folder / "params.json").read_text())
    radiance = cv2.imread(str(folder / "env.hdr"), cv2.IMREAD_UNCHANGED)[..., ::-1]
    directions, solid = sphere(radiance.shape[1])
    toward = -np.array(known["sun"]["direction_gltf"])
    around = directions @ toward > math.cos(math.radians(8.0))
    ring = ~around & (directions @ toward > math.cos(math.radians(16.0)))
    beside = np.median(radiance[ring], axis=0)
    found = ((radiance[around] - beside) * solid[around][:, None]).sum(axis=0)
    sun = known["film_exposure"] * known["sun"]["irradiance_w_m2"] * np.array(known["sun"]["color"])
    assert found == pytest.approx(sun, rel=0.15)
