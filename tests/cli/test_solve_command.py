"""`solve`, and runs whose GLB has no camera: the plate's own is found and used."""

import json

import av
import cv2
import numpy as np
import pytest
from support import shots
from support.camera_paths import focal_of, rotation
from support.command import nlens, one_line

pytestmark = [pytest.mark.needs_gl, pytest.mark.slow]
WIDTH, HEIGHT, FOV_DEG = 960, 512, 50.0


def view(texture, turn, eye):
    """A textured ground seen by a camera (H, W, 3)."""
    focal = focal_of(FOV_DEG)
    lens = np.array([[focal, 0.0, -WIDTH / 2], [0.0, -focal, -HEIGHT / 2], [0.0, 0.0, -1.0]])
    size = texture.shape[0]
    # texture pixels to the ground: 12 units wide, from 2 behind the camera to 10 before it
    ground = np.array([[12.0 / size, 0.0, -6.0], [0.0, 0.0, 0.0], [0.0, 12.0 / size, -10.0]])
    from_ground = lens @ turn.T @ (ground - np.outer(eye, (0.0, 0.0, 1.0)))
    rows, columns = np.mgrid[0:HEIGHT, 0:WIDTH] + 0.5
    back = np.linalg.inv(from_ground)
    at = np.tensordot(back, np.stack([columns, rows, np.ones_like(rows)]), axes=1)
    x, y = (at[:2] / at[2]).astype(np.float32)
    seen = cv2.remap(texture, x, y, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REFLECT)
    behind = (from_ground @ np.stack([x, y, np.ones_like(x)]).reshape(3, -1))[2] <= 0.0
    seen[behind.reshape(HEIGHT, WIDTH)] = 190
    return seen


def write_plate(path, poses):
    """A clip of a ground by a camera that moves; lossless."""
    rng = np.random.default_rng(4)
    texture = cv2.resize(
        rng.integers(40, 220, (128, 128, 3), np.uint8), (2048, 2048), interpolation=cv2.INTER_CUBIC
    )
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264rgb", rate=24, options={"crf": "0"})
        stream.width, stream.height, stream.pix_fmt = WIDTH, HEIGHT, "rgb24"
        for turn, eye in poses:
            picture = np.ascontiguousarray(view(texture, turn, np.array(eye)))
            frame = av.VideoFrame.from_ndarray(picture, "rgb24")
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    return path


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


def test_still_is_solved_to_one_camera_for_all_frames(files, tmp_path):
    camera, _ = solved(files, "still.png", tmp_path)
    assert camera["path"] == "still"
    assert len(camera["frames"]) == 1


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


def frames(path):
    with av.open(str(path)) as container:
        for frame in container.decode(video=0):
            yield frame.to_ndarray(format="rgb24").astype(np.int16)


def middle(plate, result):
    """Middle column of what differs [px]."""
    columns = np.flatnonzero((abs(plate - result).max(axis=2) > 8).any(axis=0))
    return 0.5 * (columns[0] + columns[-1] + 1)


def test_run_solves_the_camera_by_itself_and_says_what_it_assumes(files, tmp_path):
    out = tmp_path / "out.mkv"
    run = nlens(
        files / "pan.mkv", files / "bare.glb", out, "--fit", files / "fit.json", "--preset",
        "draft", "--no-progress",
    )  # fmt: skip
    assert run.returncode == 0, run.stderr
    assert "field of view" in run.stderr and "path rotation" in run.stderr
    assert "(chosen; --at X,Y and --size S place it elsewhere)" in run.stderr
    assert out.is_file()


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
