"""`evaluate scene`: the drawn object and its shadow, on a plate made by the test."""

import json

import cv2
import numpy as np
import pytest
from support.truth_folder import camera, cube_depth, write_rendered

from nlens_video.cli.main import main
from nlens_video.core.layers import Box, DepthMap
from nlens_video.effects.shadow.apply import ApplyShadow
from nlens_video.effects.shadow.cast import CastShadow
from nlens_video.effects.shadow.cast_on_things import CastOnThings
from nlens_video.effects.shadow.casters import CasterCache, Casters, Moment
from nlens_video.evaluate.bench.case import plate_case
from nlens_video.evaluate.composite.light_cases import LIGHTS, light_cases
from nlens_video.evaluate.plates import load_plate
from nlens_video.kernels.scatter.scatter import blur_reach, scatter
from nlens_video.scene.scene import Scene
from nlens_video.scene.scene_light import SceneLight
from nlens_video.stages.l_reblur import ReblurLayer
from nlens_video.video.exr import read_exr, write_layers
from nlens_video.video.pixels.picture import ArrayPicture


@pytest.fixture
def plate(tmp_path):
    """A plate whose truth has the shadow that its GLB's light casts, in other light."""
    folder = write_rendered(tmp_path / "cube_mid")
    view = camera()
    disparity = view.plane_disparity(0.0)
    real = np.where(disparity > 0.0, 1.0 / np.maximum(disparity, 1e-6), 1e4).astype(np.float32)
    write_layers(folder / "bg_depth.exr", {"Z": real})
    known = load_plate(folder)
    scene = Scene.load(folder / "object.glb")
    posed = scene.pose(0.0)
    light = SceneLight(scene.light_count).on_ground(posed.lights)
    fit = plate_case(known).fit
    moment = Moment(Casters.of(posed, CasterCache()), known.camera)
    shadow = CastShadow()([moment], light, 0.0, fit)
    codes = cv2.imread(str(folder / "gt_noshadow.png"))
    frame = Box(0, 0, codes.shape[1], codes.shape[0])
    ApplyShadow(ReblurLayer(scatter=scatter, reach=blur_reach))(ArrayPicture(codes), shadow, frame)
    assert cv2.imwrite(str(folder / "gt.png"), codes)
    return folder


def measured(capsys, *words):
    assert main(["evaluate", "scene", *map(str, words), "--json"]) == 0
    return json.loads(capsys.readouterr().out)


def test_shadow_is_evaluated_where_the_ground_truth_has_one(plate, capsys):
    told = measured(capsys, plate.parent, "--out", plate.parent / "tables")
    rows = {row["name"]: row for row in told["shadow"]["summary"]}
    lights, guessed = rows["with its lights"], rows["GLB without lights"]
    assert rows["no shadow"]["gain_db"] == 0.0
    assert lights["gain_db"] > 3.0 and guessed["gain_db"] > 0.0
    assert lights["gain_db_least"] == lights["gain_db"]
    assert lights["left"] < 1.5
    assert "with its map" not in rows
    names = {path.name for path in (plate.parent / "tables").iterdir()}
    assert names == {"scene.md", "drawn.csv", "light.csv", "shadow.csv", "things.csv"}


def test_shadow_on_a_step_is_evaluated_with_the_plates_depth(plate, capsys):
    # Left of the cube, where its shadow falls, the ground is 20 cm lower.
    _, columns = np.nonzero(cube_depth(camera()) < 1e9)
    lower = camera().plane_disparity(-0.2)[:, : columns.min() - 10]
    real = read_exr(plate / "bg_depth.exr").channels["Z"].copy()
    real[:, : lower.shape[1]] = np.where(lower > 0.0, 1.0 / np.maximum(lower, 1e-6), 1e4)
    write_layers(plate / "bg_depth.exr", {"Z": real})
    known, posed = load_plate(plate), Scene.load(plate / "object.glb").pose(0.0)
    (_, light), fit = light_cases(known)[LIGHTS], plate_case(known).fit
    moments = [Moment(Casters.of(posed, CasterCache()), known.camera)]
    plane = CastShadow(strength=0.9)(moments, light, 0.0, fit)
    shadow = CastOnThings(strength=0.9)(plane, moments, light, 0.0, fit, DepthMap(real))
    codes = cv2.imread(str(plate / "gt_noshadow.png"))
    frame = Box(0, 0, codes.shape[1], codes.shape[0])
    ApplyShadow(ReblurLayer(scatter=scatter, reach=blur_reach))(ArrayPicture(codes), shadow, frame)
    assert cv2.imwrite(str(plate / "gt.png"), codes)
    told = measured(capsys, plate)
    gains = {row["name"]: row["gain_db"] for row in told["things"]["summary"]}
    by_depth, on_plane = (
        gains[f"with its lights, {how}"] for how in ("by the depth", "on the plane")
    )
    assert gains["no shadow"] == 0.0 and by_depth > 3.0 and by_depth > on_plane + 2.0


def test_map_of_the_surroundings_is_a_case_where_it_is_there(plate, capsys):
    assert cv2.imwrite(str(plate / "env.hdr"), np.full((16, 32, 3), 0.5, np.float32))
    told = measured(capsys, plate)
    for table in ("light", "shadow"):
        assert "with its map" in {row["name"] for row in told[table]["summary"]}


def test_light_is_compared_with_the_layer_in_stops(plate, capsys):
    def bias():
        rows = measured(capsys, plate)["light"]["summary"]
        return next(row["bias_ev"] for row in rows if row["name"] == "GLB without lights")

    before, channels = bias(), read_exr(plate / "object.exr").channels
    doubled = {name: values * (2.0 if name in "RGB" else 1.0) for name, values in channels.items()}
    write_layers(plate / "object.exr", doubled)
    assert bias() == pytest.approx(before - 1.0, abs=0.01)


def test_rasterised_cube_has_the_mask_and_depth_of_the_slab_method(plate, capsys):
    (row,) = measured(capsys, plate)["drawn"]["summary"]
    assert row["iou"] > 0.98 and row["depth_error"] < 0.05
    depth = cube_depth(camera())
    np.savez_compressed(plate / "object_depth.npz", depth=(1.01 * depth).astype(np.float32))
    (row,) = measured(capsys, plate)["drawn"]["summary"]
    assert row["depth_error"] == pytest.approx(1.0, abs=0.05)


def test_plates_without_a_ground_truth_shadow_are_reported(plate, capsys):
    (plate / "gt.png").unlink()
    assert main(["evaluate", "scene", str(plate)]) == 0
    assert "nothing is said of shadows" in capsys.readouterr().out


def test_unreadable_ground_truth_picture_is_refused_in_one_line(plate, capsys):
    (plate / "gt.png").write_bytes(b"no picture")
    assert main(["evaluate", "scene", str(plate)]) == 3
    assert capsys.readouterr().err.count("\n") == 1
