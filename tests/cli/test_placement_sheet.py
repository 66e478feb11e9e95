"""Placement of objects without a camera, and the contact sheet of placements."""

import json
import re
import shlex

import av
import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from support import shots
from support.command import nlens
from support.glb_builder import GlbBuilder

from nlens_video import Compositor
from nlens_video.cameras.solved import CameraKey, SolvedCamera
from nlens_video.cli.placement_choices import Choice, choices, choices_on_ground
from nlens_video.core.errors import UsageError
from nlens_video.core.placement import Placement, focal_of_fov, fov_of_focal
from nlens_video.core.settings import ObjectSettings
from nlens_video.options import parser as arguments
from nlens_video.options import to_settings

pytestmark = pytest.mark.needs_gl
WORDS = ["--at", "0.3,0.8", "--size", "0.4", "--horizon", "0.2"]


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("place")
    shots.write_png(folder / "plate.png", shots.grey())
    shots.cube_glb(folder / "cube.glb", camera=False)
    shots.cube_glb(folder / "camera.glb")
    shots.fit_json(folder / "fit.json")
    return folder


def changed(before, after):
    """First and last column and row that differ, as fractions of the picture."""
    height, width = before.shape[:2]
    seen = np.abs(before.astype(int) - after).max(axis=2) > 8
    rows, columns = np.flatnonzero(seen.any(axis=1)), np.flatnonzero(seen.any(axis=0))
    return columns[0] / width, columns[-1] / width, rows[0] / height, rows[-1] / height


def test_object_is_drawn_at_the_place_that_the_options_state(files, tmp_path):
    run = nlens(
        files / "plate.png", files / "cube.glb", tmp_path / "out.png", *WORDS, "--effects", "none"
    )
    assert run.returncode == 0, run.stderr
    left, right, top, bottom = changed(
        cv2.imread(str(files / "plate.png")), cv2.imread(str(tmp_path / "out.png"))
    )
    assert 0.5 * (left + right) == pytest.approx(0.3, abs=0.03)
    assert re.search(r"^lens +none: defocus is off$", run.stderr, re.MULTILINE)
    assert top == pytest.approx(0.8 - 0.4, abs=0.01)
    assert 0.8 < bottom < 0.95  # the cube's near edge lies below the middle of its foot


def test_plan_states_the_placement_and_the_assumed_focal_length(files, tmp_path):
    run = nlens(files / "plate.png", files / "camera.glb", tmp_path / "o.png", *WORDS, "--plan")
    assert run.returncode == 0, run.stderr
    assert (
        "placed by --at 0.3,0.8 --size 0.4 --yaw 0 --horizon 0.2, focal length 35 mm" in run.stdout
    )
    assert "assumed" in run.stdout and "the file's own camera is not used" in run.stdout


def test_focal_length_in_the_plates_metadata_is_used(files, tmp_path):
    key = "com.apple.quicktime.camera.focal_length.35mm_equivalent"
    options = {"movflags": "use_metadata_tags"}
    with av.open(str(tmp_path / "in.mov"), "w", options=options) as container:
        container.metadata[key] = "52"
        stream = container.add_stream("libx264", rate=25)
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
        grey = np.full((48, 64, 3), 119, np.uint8)
        container.mux(stream.encode(av.VideoFrame.from_ndarray(grey, "rgb24")))
        container.mux(stream.encode())
    run = nlens(tmp_path / "in.mov", files / "cube.glb", tmp_path / "o.mov", *WORDS, "--plan")
    assert "focal length 52 mm (35 mm equivalent, as the plate says)" in run.stdout, run.stderr


def test_fov_option_replaces_the_assumed_focal_length(files, tmp_path):
    words = (*WORDS, "--fov", "60")
    run = nlens(files / "plate.png", files / "cube.glb", tmp_path / "o.png", *words, "--plan")
    # half of 480 px by tan 30 degrees, in frame diagonals of 550.73 px, times 43.267 mm
    assert "focal length 32.66 mm (35 mm equivalent, by --fov 60)" in run.stdout, run.stderr


def test_size_is_chosen_where_the_horizon_alone_is_given(files, tmp_path):
    words = ("--at", "0.5,0.9", "--horizon", "0.3", "--plan")
    run = nlens(files / "plate.png", files / "cube.glb", tmp_path / "o.png", *words)
    assert "placed by --at 0.5,0.9 --size 0.35 --yaw 0 --horizon 0.3" in run.stdout, run.stderr


def test_unknown_scene_name_lists_the_scenes_of_the_file(files, tmp_path):
    run = nlens(files / "plate.png", files / "camera.glb", tmp_path / "o.png", "--scene", "dusk")
    assert run.returncode == 4 and "no scene is named 'dusk'; expected one of 0" in run.stderr


@pytest.mark.parametrize(
    ("glb", "words", "code", "line"),
    [
        ("cube.glb", ["--yaw", "20", "--horizon", "0.3"], 2, "under --horizon give --at X,Y"),
        ("cube.glb", ["--size", "0.2", "--height", "1m"], 2, "leave one out"),
        ("cube.glb", ["--height", "1m"], 2, "the plate's scale is not known; give --marker SIDE"),
        ("cube.glb", ["--at", "0.5", "--size", "1"], 2, "is not X,Y"),
        ("camera.glb", ["--fov", "60"], 2, "--fov is of an object without a camera"),
        ("cube.glb", [*WORDS, "--fov", "180"], 2, "not an angle from 1 to 170 degrees"),
        (
            "cube.glb",
            ["--at", "0.5,0.4", "--size", "1", "--horizon", "0.5"],
            2,
            "lies above the horizon",
        ),
        ("camera.glb", [*WORDS, "--camera", "Plate"], 2, "leave one of them out"),
        ("camera.glb", [*WORDS, "--layers", "l.exr"], 2, "leave --at out"),
        (
            "camera.glb",
            ["--footprint", "car"],
            4,
            "no object is named 'car'; its objects have no names",
        ),
        ("camera.glb", ["--animation", "run"], 4, "the file has none"),
        ("camera.glb", ["--animation-speed", "0"], 2, "not a positive number"),
        ("camera.glb", ["--animation-offset", "inf"], 2, "not a number from -1e9 to 1e9"),
    ],
)
def test_invalid_placement_options_are_refused_in_one_line(files, tmp_path, glb, words, code, line):
    run = nlens(files / "plate.png", files / glb, tmp_path / "o.png", *words)
    assert run.returncode == code, run.stderr
    assert line in run.stderr and run.stderr.count("\n") == 1
    assert not list(tmp_path.iterdir())


def test_contact_sheet_has_nine_placements_that_differ_in_one_parameter():
    start = Placement(at=(0.5, 0.8), size=0.3, yaw_deg=10.0, horizon=0.75)
    shown = choices(start, None, 60.0)
    assert len(set(shown)) == 9 and shown[0] == Choice(start, None)
    places = [choice.placing for choice in shown]
    assert [p.horizon for p in places[1:3]] == pytest.approx([0.63, 0.775])
    assert [p.yaw_deg for p in places[3:6]] == [-35.0, 55.0, 190.0]
    assert [p.size for p in places[6:8]] == pytest.approx([0.2, 0.45])
    assert shown[8] == Choice(start, 30.0)
    assert [choice.fov_deg for choice in choices(start, 40.0, 60.0)] == [40.0] * 8 + [20.0]


def test_choices_on_a_solved_ground_differ_in_place_size_and_turn():
    start = Placement(at=(0.5, 0.6), size=0.3, horizon=None)
    shown = choices_on_ground(start, None)
    assert len(set(shown)) == 9 and shown[0].placing == start
    places = [choice.placing for choice in shown]
    assert [p.at[0] for p in places[1:3]] == pytest.approx([0.3, 0.7])
    assert places[3].at == pytest.approx((0.5, 0.72)) and places[3].size > start.size
    assert [p.size for p in places[4:6]] == pytest.approx([0.2, 0.45])
    assert [p.yaw_deg for p in places[6:]] == [-45.0, 45.0, 180.0]
    words = places[1].describe()
    assert "--horizon" not in words


def test_contact_sheet_starts_from_the_plates_camera_where_no_horizon_is_given(files, tmp_path):
    solve = nlens("solve", files / "plate.png", tmp_path / "camera.json")
    assert solve.returncode == 0, solve.stderr
    sheets = []
    for words in ((), ("--camera-from", tmp_path / "camera.json"), ("--no-grid",)):
        run = nlens(
            "place", files / "plate.png", files / "cube.glb", tmp_path / "s.png", "-y", *words,
            "--json",
        )  # fmt: skip
        assert run.returncode == 0, run.stderr
        told = json.loads(run.stdout)["choices"]
        assert len(told) == 9 and not any("--horizon" in line for line in told)
        assert all(("--camera-from" in line) == bool("--camera-from" in words) for line in told)
        sheets.append(cv2.imread(str(tmp_path / "s.png")))
    assert sheets[0].shape[:2] == sheets[2].shape[:2]
    assert np.array_equal(sheets[0][:270], sheets[1][:270])  # the captions are longer
    assert not np.array_equal(sheets[0][:270], sheets[2][:270])


def test_contact_sheet_takes_a_place_high_in_the_frame_where_the_plates_ground_is(files, tmp_path):
    turn = Rotation.from_euler("x", 30.0, degrees=True).as_matrix()  # downwards: no horizon in view
    view = np.eye(4)
    view[:3, :3], view[:3, 3] = turn, -turn @ (0.0, 1.5, 0.0)
    key = CameraKey(index=0, pts_s=0.0, world_to_camera=view, fov_x_deg=50.0)
    camera = SolvedCamera(width=shots.WIDTH, height=shots.HEIGHT, keys=(key,))
    (tmp_path / "camera.json").write_text(camera.to_json())
    run = nlens(
        "place", files / "plate.png", files / "cube.glb", tmp_path / "s.png", "--at", "0.5,0.3",
        "--camera-from", tmp_path / "camera.json",
    )  # fmt: skip
    assert run.returncode == 0, run.stderr


def test_contact_sheet_refuses_a_horizon_beside_a_camera(files, tmp_path):
    words = ("--camera-from", files / "fit.json", "--horizon", "0.3")
    run = nlens("place", files / "plate.png", files / "cube.glb", tmp_path / "s.png", *words)
    assert run.returncode == 2 and "leave --horizon out" in run.stderr


def test_field_of_view_and_focal_length_are_inverse_functions():
    assert fov_of_focal(focal_of_fov(50.0, (960, 512)), (960, 512)) == pytest.approx(50.0)


def test_contact_sheet_shows_the_object_at_each_placement(files, tmp_path):
    run = nlens(
        "place", files / "plate.png", files / "cube.glb", tmp_path / "s.png", *WORDS, "--json"
    )
    assert run.returncode == 0, run.stderr
    told = json.loads(run.stdout)
    assert told["saved"] == str(tmp_path / "s.png") and len(set(told["choices"])) == 9
    sheet = cv2.imread(str(tmp_path / "s.png"))
    cells = [row[:270, 480 * n : 480 * n + 480] for row in np.split(sheet, 3) for n in range(3)]
    assert sheet.shape[1] == 3 * 480 and sheet.shape[0] > 3 * (270 + 25)
    assert all(not np.array_equal(cells[0], other) for other in cells[1:])
    orange = [((c[..., 2] > 1.6 * c[..., 0]) & (c[..., 2] > 40)).sum() for c in cells]
    assert min(orange) > 500
    assert orange[6] < 0.6 * orange[0] < 0.36 * orange[7]  # smaller, as told, larger


def test_printed_options_of_a_placement_reproduce_it(files, tmp_path):
    shots.cube_glb(tmp_path / "cube.glb", camera=False, end=(0.1, 0.0, -1.6))
    words = [*WORDS, "--ground-y", "-0.1", "--animation", "0", "--animation-speed", "2", "--loop",
             "--animation-offset", "0.25", "--scene", "0", "--fov", "50", "--yaw", "0"]  # fmt: skip
    run = nlens("place", files / "plate.png", tmp_path / "cube.glb", tmp_path / "s.png", *words)
    assert run.returncode == 0, run.stderr
    first, *_, last = (line.split(maxsplit=1)[1] for line in run.stderr.splitlines()[1:])
    for line, fov in ((first, 50.0), (last, 25.0)):
        pasted = arguments.parse(["in.png", "cube.glb", "o.png", *shlex.split(line)])
        asked = arguments.parse(["in.png", "cube.glb", "o.png", *words])
        asked.fov = fov
        assert to_settings.settings(pasted).scene == to_settings.settings(asked).scene


def test_contact_sheet_leaves_out_placements_that_are_impossible(files, tmp_path):
    builder = GlbBuilder()
    plank = shots.CUBE * [1, 0.1, 40]
    builder.node(mesh=builder.mesh(plank, shots.CUBE_FACES))
    builder.write(tmp_path / "plank.glb")
    run = nlens("place", files / "plate.png", tmp_path / "plank.glb", tmp_path / "s.png")
    assert run.returncode == 0, run.stderr


@pytest.mark.parametrize(
    ("output", "code", "line"),
    [("s.jpg", 2, "is a PNG"), ("none/s.png", 6, "does not exist"), ("s.png/", 6, "folder")],
)
def test_unwritable_contact_sheet_is_refused_before_any_rendering(
    files, tmp_path, output, code, line
):
    (tmp_path / "s.png").mkdir()
    run = nlens("place", files / "plate.png", files / "cube.glb", tmp_path / output)
    assert (run.returncode, line in run.stderr) == (code, True), run.stderr


def test_python_interface_accepts_a_placement_and_an_animation(files):
    objects = ObjectSettings(
        glb=files / "cube.glb", placing=Placement(at=(0.3, 0.8), size=0.4, horizon=0.2)
    )
    plate = shots.grey()
    with Compositor(objects, effects="none") as lens:
        left, right, top, _ = changed(plate, lens.process(plate))
    assert (0.5 * (left + right), top) == pytest.approx((0.3, 0.4), abs=0.03)
    with pytest.raises(UsageError, match="leave them out"):
        Compositor(objects, ground_y=1.0)
