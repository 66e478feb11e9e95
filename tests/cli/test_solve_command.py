"""`solve`, and runs whose GLB has no camera: the plate's own is found and used."""

import json
import re

import av
import numpy as np
import PIL.Image
import pygltflib
import pytest
from support import shots
from support.camera_paths import SIZE, focal_of, rotation
from support.command import nlens, one_line
from support.grounds import FOV_DEG, write_clip, write_plate

pytestmark = [pytest.mark.needs_gl, pytest.mark.slow]
WIDTH, HEIGHT = SIZE


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("solve")
    pan = [(rotation(np.radians(5 - n), np.radians(-20), 0.0), (0, 1.5, 0)) for n in range(12)]
    walk = [
        (rotation(np.radians(4 - 0.7 * n), np.radians(-20), 0.01), (0.06 * n, 1.5, -0.05 * n))
        for n in range(14)
    ]
    write_plate(folder / "pan.mkv", pan)
    write_plate(folder / "walk.mkv", walk)
    shots.write_png(folder / "still.png")
    shots.cube_glb(folder / "bare.glb", camera=False, sun=False)
    shots.fit_json(folder / "fit.json", WIDTH, HEIGHT)
    return folder


def solved(files, plate, tmp_path, *words):
    run = nlens("solve", files / plate, tmp_path / "camera.json", "--no-progress", *words)
    assert run.returncode == 0, run.stderr
    return json.loads((tmp_path / "camera.json").read_text()), run


def test_pan_is_solved_as_a_rotation_with_its_field_of_view(files, tmp_path):
    camera, run = solved(files, "pan.mkv", tmp_path)
    assert camera["path"] == "rotation"
    assert camera["fov"] == "measured"
    assert camera["frames"][0]["fov_x_deg"] == pytest.approx(FOV_DEG, rel=0.03)
    assert len(camera["frames"]) == 12
    assert "rotation" in run.stderr


def test_walk_is_solved_with_the_ground_below_it(files, tmp_path):
    camera, _ = solved(files, "walk.mkv", tmp_path, "--fov", "50")
    assert camera["path"] == "moving"
    assert camera["fov"] == "metadata"
    up = np.array(camera["frames"][0]["world_to_camera"])[:3, 1]
    assert np.degrees(np.arcsin(up[2])) == pytest.approx(20.0, abs=1.0)


def test_field_of_view_that_the_movement_contradicts_is_kept_with_a_note(files, tmp_path):
    camera, run = solved(files, "pan.mkv", tmp_path, "--fov", "48")
    assert camera["frames"][0]["fov_x_deg"] == pytest.approx(48.0, abs=0.01)
    assert re.search(
        r"note .* its movement tells a field of view of (50|49\.\d+) .*, not 48", run.stderr
    )
    _, run = solved(files, "pan.mkv", tmp_path, "--fov", "50", "-y")
    assert "its movement tells" not in run.stderr


def test_report_shows_the_ground_and_what_the_camera_was_found_from(files, tmp_path):
    camera, _ = solved(files, "pan.mkv", tmp_path, "--report", tmp_path / "page")
    text = (tmp_path / "page" / "index.html").read_text()
    assert text.count("Grid on the ground of frame") == 3
    assert "Tracked points by reprojection error" in text
    assert f"{camera['reprojection_px']:.2f} px" in text
    assert camera["reprojection_px"] < 0.5
    assert "The camera turns on the spot." in text


def test_still_is_solved_to_one_camera_for_all_frames(files, tmp_path):
    camera, _ = solved(files, "still.png", tmp_path)
    assert camera["path"] == "still"
    assert len(camera["frames"]) == 1


def test_what_a_chan_file_cannot_hold_is_said_with_formats_that_can(files, tmp_path):
    out = tmp_path / "camera.chan"
    run = nlens("solve", files / "still.png", out, "--no-progress")
    assert run.returncode == 0, run.stderr
    (note,) = [line for line in run.stderr.splitlines() if "cannot hold" in line]
    assert "camera.chan cannot hold that the field of view is assumed" in note
    assert note.endswith("; camera.json, .glb and .usda do")


@pytest.mark.parametrize(("orientation", "across"), [(1, 960), (6, 512)])
def test_field_of_view_of_a_photograph_is_that_of_its_exif(files, tmp_path, orientation, across):
    exif = PIL.Image.Exif()
    exif[274] = orientation
    exif.get_ifd(34665)[41989] = 35
    rng = np.random.default_rng(2)
    noise = rng.integers(0, 255, (512, 960, 3), np.uint8)
    PIL.Image.fromarray(noise).save(tmp_path / "in.jpg", exif=exif)
    expected = 2.0 * np.degrees(np.arctan(0.5 * across / (35 / np.hypot(36, 24) * 1088)))
    camera, run = solved(files, tmp_path / "in.jpg", tmp_path)
    assert camera["fov"] == "metadata"
    assert camera["frames"][0]["fov_x_deg"] == pytest.approx(expected, rel=0.02)
    assert 0.5 < camera["stderr"]["fov_deg"] < 3.0
    assert "from metadata" in run.stderr and "FocalLengthIn35mmFilm" in run.stderr


def test_given_field_of_view_beats_the_recordings(files, tmp_path):
    exif = PIL.Image.Exif()
    exif.get_ifd(34665)[41989] = 35
    PIL.Image.fromarray(np.full((512, 960, 3), 90, np.uint8)).save(tmp_path / "in.jpg", exif=exif)
    camera, _ = solved(files, tmp_path / "in.jpg", tmp_path, "--fov", "80")
    assert camera["frames"][0]["fov_x_deg"] == pytest.approx(80.0, abs=0.3)
    assert "--fov 80" in camera["method"]


def test_object_without_a_camera_stays_on_its_point_of_the_ground(files, tmp_path):
    camera, _ = solved(files, "walk.mkv", tmp_path, "--fov", "50")
    words = (
        "--camera-from", tmp_path / "camera.json", "--at", "0.5,0.8", "--size", "0.2", "--fit",
        files / "fit.json", "--preset", "draft", "--no-progress", "--effects", "none",
        "--codec", "ffv1",
    )  # fmt: skip
    run = nlens(files / "walk.mkv", files / "bare.glb", tmp_path / "out.mkv", *words)
    assert run.returncode == 0, run.stderr
    assert "placed by --at 0.5,0.8" in run.stderr
    assert "slides" not in run.stderr
    first, later = (np.array(camera["frames"][n]["world_to_camera"]) for n in (0, 4))
    ray = np.array([0.0, -(0.8 * HEIGHT - HEIGHT / 2) / focal_of(FOV_DEG), -1.0])
    pose = np.linalg.inv(first)
    direction = pose[:3, :3] @ ray
    ground = pose[:3, 3] - pose[1, 3] / direction[1] * direction
    seen = later[:3, :3] @ ground + later[:3, 3]
    expected = WIDTH / 2 - focal_of(FOV_DEG) * seen[0] / seen[2]
    plates, results = (list(frames(path)) for path in (files / "walk.mkv", tmp_path / "out.mkv"))
    assert abs(middle(plates[0], results[0]) - WIDTH / 2) < 12.0
    assert abs(expected - WIDTH / 2) > 40.0
    assert abs(middle(plates[4], results[4]) - expected) < 12.0


@pytest.mark.parametrize("suffix", ["glb", "chan", "usda"])
def test_object_is_composited_alike_through_each_kind_of_camera_file(files, tmp_path, suffix):
    for kind in ("json", suffix):
        run = nlens(
            "solve", files / "walk.mkv", tmp_path / f"camera.{kind}", "--fov", "50",
            "--no-progress", "--range", "2:",
        )  # fmt: skip
        assert run.returncode == 0, run.stderr
        run = nlens(
            files / "walk.mkv", files / "bare.glb", tmp_path / f"{kind}.mkv", "--camera-from",
            tmp_path / f"camera.{kind}", "--at", "0.5,0.8", "--size", "0.2", "--fit",
            files / "fit.json", "--preset", "draft", "--no-progress", "--effects", "none",
            "--codec", "ffv1", "--range", "2:",
        )  # fmt: skip
        assert run.returncode == 0, run.stderr
    both = [list(frames(tmp_path / f"{kind}.mkv")) for kind in ("json", suffix)]
    plates = list(frames(files / "walk.mkv"))[2:]
    for plate, one, other in zip(plates, *both, strict=True):
        assert middle(plate, other) == pytest.approx(middle(plate, one), abs=0.1)
        assert abs(one - other).mean() < 0.05
    if suffix == "glb":
        file = pygltflib.GLTF2().load(str(tmp_path / "camera.glb"))
        points = next(node.mesh for node in file.nodes if node.name == "points")
        x, y, z = positions(file, file.meshes[points].primitives[0].attributes.POSITION)
        # All of the plate is the ground, 1.6 below the first camera; a track that slipped may be
        # off, so the outermost hundredth does not count.
        assert len(y) > 50 and abs(np.percentile(y, [1, 99])).max() < 0.1
        # The nearest ground is that in the frame's bottom row, ahead of the camera.
        below = np.radians(20.0) + np.arctan(HEIGHT / 2 / focal_of(FOV_DEG))
        assert np.percentile(z, 99) == pytest.approx(-1.6 / np.tan(below), rel=0.15)
        assert x.min() < -1.0 and x.max() > 1.0
    shots_in_json = json.loads((tmp_path / "camera.json").read_text())["frames"]
    assert [frame["index"] for frame in shots_in_json] == list(range(2, 14))


def test_object_follows_the_distortion_that_was_solved_with_the_camera(files, tmp_path):
    camera, _ = solved(files, "still.png", tmp_path, "--fov", "60")
    pose = np.eye(4)
    pose[:3, :3] = rotation(0.0, np.radians(-20), 0.0).T
    pose[:3, 3] = -pose[:3, :3] @ (0.0, 1.6, 0.0)
    camera["frames"][0]["world_to_camera"] = pose.tolist()
    columns = []
    for k1 in (0.0, -0.15):
        path = tmp_path / "bent.json"
        path.write_text(json.dumps({**camera, "distortion_k1": k1}))
        words = (
            "--camera-from", path, "--at", "0.1,0.85", "--size", "0.2", "--fit",
            files / "fit.json", "--no-progress", "--effects", "distortion" if k1 else "none",
        )  # fmt: skip
        run = nlens(files / "still.png", files / "bare.glb", tmp_path / "out.png", *words)
        assert run.returncode == 0, run.stderr
        pictures = (
            np.asarray(PIL.Image.open(one).convert("RGB"), np.int16)
            for one in (files / "still.png", tmp_path / "out.png")
        )
        columns.append(middle(*pictures))
    # where it is asked for, not where a pinhole would show it: 0.15 * 0.52² = 4 % of 384 px beside
    assert columns[1] == pytest.approx(columns[0], abs=6.0)
    shown = nlens(
        files / "still.png", files / "bare.glb", tmp_path / "out.png", *words[:-1],
        "auto", "--plan",
    )  # fmt: skip
    assert "solved with the plate's camera: k1 -0.150" in shown.stdout


def test_name_of_no_format_of_cameras_is_refused_before_solving(files, tmp_path):
    run = nlens("solve", files / "walk.mkv", tmp_path / "camera.txt")
    one_line(run, 2)
    assert ".json, .glb, .chan, .usda" in run.stderr


def test_each_shot_of_a_plate_with_a_cut_is_composited_by_its_range(files, tmp_path):
    first, second = (list(frames(files / name)) for name in ("walk.mkv", "pan.mkv"))
    write_clip(tmp_path / "cut.mkv", [one.astype(np.uint8) for one in first]
        + [(255 - one // 3).astype(np.uint8) for one in second])  # fmt: skip
    words = (
        tmp_path / "cut.mkv", files / "bare.glb", tmp_path / "out.mkv", "--fit",
        files / "fit.json", "--preset", "draft", "--effects", "none", "--no-progress",
    )  # fmt: skip
    run = nlens(*words)
    one_line(run, 3)
    assert "--range 0:14 or --range 14:" in run.stderr
    for part, path, count in (("0:14", "moving", 14), ("14:", "rotation", 12)):
        run = nlens(*words, "--range", part)
        assert run.returncode == 0, run.stderr
        assert f"path {path}" in run.stderr
        assert len(list(frames(tmp_path / "out.mkv"))) == count


@pytest.mark.parametrize("plate", ["pan.mkv", "walk.mkv"])
def test_still_camera_on_a_plate_that_moves_is_told_with_the_drift(files, tmp_path, plate):
    words = (
        "--at", "0.5,0.8", "--size", "0.2", "--horizon", "0.2", "--fit", files / "fit.json",
        "--preset", "draft", "--no-progress", "--effects", "none",
    )  # fmt: skip
    run = nlens(files / plate, files / "bare.glb", tmp_path / "out.mkv", *words)
    assert run.returncode == 0, run.stderr
    told = re.search(r"the object's does not: it slides by up to (\d+) px", run.stderr)
    assert told is not None and int(told[1]) > 20
    assert "--camera-from" in run.stderr


def test_camera_of_a_part_is_told_with_the_frames_that_it_lacks(files, tmp_path):
    run = nlens("solve", files / "walk.mkv", tmp_path / "part.json", "--range", "2:11")
    assert run.returncode == 0, run.stderr
    words = (
        "--camera-from", tmp_path / "part.json", "--at", "0.5,0.8", "--size", "0.2", "--fit",
        files / "fit.json", "--preset", "draft", "--no-progress", "--effects", "none",
    )  # fmt: skip
    run = nlens(files / "walk.mkv", files / "bare.glb", tmp_path / "out.mkv", *words)
    assert run.returncode == 0, run.stderr
    assert "covers frames 2 to 10, the run needs 0 to 13" in run.stderr
    assert "slides over the plate's ground by up to" in run.stderr
    assert "give a camera of all frames" in run.stderr


def frames(path):
    with av.open(str(path)) as container:
        for frame in container.decode(video=0):
            yield frame.to_ndarray(format="rgb24").astype(np.int16)


def positions(file, accessor):
    """The x, y and z of an accessor's points [scene units]."""
    told = file.accessors[accessor]
    view = file.bufferViews[told.bufferView]
    start = (view.byteOffset or 0) + (told.byteOffset or 0)
    return np.frombuffer(file.binary_blob(), "<f4", told.count * 3, start).reshape(-1, 3).T


def middle(plate, result):
    """Middle column of what differs [px]."""
    columns = np.flatnonzero((abs(plate - result).max(axis=2) > 8).any(axis=0))
    return 0.5 * (columns[0] + columns[-1] + 1)


def test_run_solves_the_camera_by_itself_and_says_what_it_assumes(files, tmp_path):
    out = tmp_path / "out.mkv"
    run = nlens(
        files / "pan.mkv", files / "bare.glb", out, "--fit", files / "fit.json", "--preset",
        "draft", "--no-progress", "--report", tmp_path / "page",
    )  # fmt: skip
    assert run.returncode == 0, run.stderr
    page = (tmp_path / "page" / "index.html").read_text()
    assert "Grid on the ground of frame 0" in page and "Reprojection" in page
    assert "field of view" in run.stderr and "path rotation" in run.stderr
    assert "(chosen; --at X,Y and --size S place it elsewhere)" in run.stderr
    assert out.is_file()


def test_remedies_of_an_uncertain_camera_name_no_file_that_the_user_did_not_give(files, tmp_path):
    words = ("--fallback", "constant", "--preset", "draft", "--no-progress")
    run = nlens(files / "still.png", files / "bare.glb", tmp_path / "out.png", *words)
    assert run.returncode == 0, run.stderr
    (note,) = [line for line in run.stderr.splitlines() if "camera is uncertain" in line]
    assert "give --fov DEG if the lens is known, " in note
    assert note.endswith(", or --camera-from CAMERA")
    assert "solve" not in note and "without --camera-from" not in note
    solved(files, "still.png", tmp_path)
    words = (*words, "--camera-from", tmp_path / "camera.json")
    run = nlens(files / "still.png", files / "bare.glb", tmp_path / "given.png", *words)
    assert run.returncode == 0, run.stderr
    (note,) = [line for line in run.stderr.splitlines() if "camera is uncertain" in line]
    assert "give --fov DEG to `nlens-video solve` if the lens is known, " in note
    assert note.endswith(", or another --camera-from CAMERA")


def test_farm_asks_for_a_solved_camera(files, tmp_path):
    run = nlens("farm", files / "pan.mkv", files / "bare.glb", tmp_path / "out.mkv", "--plan")
    one_line(run, 4)
    assert "--camera-from" in run.stderr


def test_horizon_beside_a_solved_camera_is_refused(files, tmp_path):
    solved(files, "still.png", tmp_path)
    run = nlens(
        files / "still.png", files / "bare.glb", tmp_path / "out.png", "--camera-from",
        tmp_path / "camera.json", "--at", "0.5,0.8", "--size", "0.2", "--horizon", "0.3",
    )  # fmt: skip
    one_line(run, 2)


def test_camera_of_a_plate_of_another_shape_is_refused(files, tmp_path):
    solved(files, "pan.mkv", tmp_path, "--fov", "50")
    run = nlens(
        files / "still.png", files / "bare.glb", tmp_path / "out.png", "--camera-from",
        tmp_path / "camera.json",
    )  # fmt: skip
    one_line(run, 4)
    assert "960x512" in run.stderr


def write_camera(path, pitch_deg, **more):
    """A camera.json of a still camera."""
    pose = np.eye(4)
    pose[:3, :3] = rotation(0.0, np.radians(pitch_deg), 0.0)
    pose[1, 3] = 1.6
    path.write_text(json.dumps({
        "width": shots.WIDTH, "height": shots.HEIGHT, "ground_y": 0.0, "fov": "assumed",
        "horizon": "measured", "path": "still", "scale": "arbitrary", "method": "test",
        "stderr": {"fov_deg": 5.0, "pitch_deg": 1.0, "roll_deg": 1.0},
        "frames": [{"index": 0, "pts_s": 0.0, "fov_x_deg": 40.0,
                    "world_to_camera": np.linalg.inv(pose).tolist()}],
        **more,
    }))  # fmt: skip
    return path


def test_a_chosen_place_without_a_sign_of_ground_is_called_a_guess(files, tmp_path):
    camera = write_camera(tmp_path / "in.json", -15.0, place=[0.4, 0.8], place_guessed=True)
    words = ("--fallback", "constant", "--preset", "draft", "--camera-from", camera)
    run = nlens(files / "still.png", files / "bare.glb", tmp_path / "out.png", *words)
    assert run.returncode == 0, run.stderr
    (said,) = [line for line in run.stderr.splitlines() if "placed by --at 0.4,0.8" in line]
    assert "a guess: no line or blur tells that this is ground; --at X,Y" in said
    words = (*words, "--at", "0.4,0.8", "--size", "0.3")
    run = nlens(files / "still.png", files / "bare.glb", tmp_path / "given.png", *words)
    assert run.returncode == 0, run.stderr
    assert "a guess: no line" not in run.stderr


def test_object_on_a_plate_without_ground_in_view_stands_under_an_assumed_horizon(files, tmp_path):
    looks_up = write_camera(tmp_path / "up.json", 40.0)
    words = ("--fallback", "constant", "--camera-from", looks_up)
    run = nlens(files / "still.png", files / "bare.glb", tmp_path / "out.png", *words)
    assert run.returncode == 0, run.stderr
    assert "(pitch 40.0 degrees, measured) sees no ground: the horizon is assumed" in run.stderr
    assert "placed by --at 0.5,0.85 --size 0.35" in run.stderr
