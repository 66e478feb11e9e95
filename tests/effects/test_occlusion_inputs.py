"""Holdout, occlusion and reflection options on whole runs of the command."""

import json
import subprocess
import sys

import av
import cv2
import numpy as np
import pytest
from support import shots
from support.clips import REPEATABLE
from support.command import nlens

from nlens_video.scene.scene import Scene
from nlens_video.video.exr import write_layers

pytestmark = pytest.mark.needs_gl
SIZE = (shots.HEIGHT, shots.WIDTH)
EDGE = 240  # the object stands on both sides of this column
OTHER_BLUR = 1  # beside things the shadow is scattered, on the plane alone gathered [code value]
AT = (0.0, 0.0, -2.6)


def half(soft=0):
    """A matte that is white on the left of EDGE, over so many pixels."""
    share = np.clip(0.5 - (np.arange(SIZE[1]) + 0.5 - EDGE) / max(soft, 1e-6), 0.0, 1.0)
    return np.tile(np.round(255 * share).astype(np.uint8), (SIZE[0], 1))


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("real")
    shots.write_png(folder / "plate.png")
    shots.cube_glb(folder / "anim.glb", start=AT, size=0.5)
    shots.fit_json(folder / "fit.json")
    cv2.imwrite(str(folder / "matte.png"), half())
    return folder


def still(files, out, *words):
    run = nlens(
        files / "plate.png", files / "anim.glb", out, "--fit", files / "fit.json", "--json", *words
    )
    assert run.returncode == 0, run.stderr
    return cv2.imread(str(out)).astype(int), json.loads(run.stdout)


@pytest.fixture(scope="module")
def plain(files):
    """The composite without anything in front."""
    return still(files, files / "plain.png")[0]


def test_holdout_matte_hides_object_and_shadow_and_keeps_the_plates_bits(files, plain, tmp_path):
    got, summary = still(files, tmp_path / "o.png", "--holdout", files / "matte.png")
    plate = cv2.imread(str(files / "plate.png")).astype(int)
    assert np.array_equal(got[:, :EDGE], plate[:, :EDGE])
    assert np.array_equal(got[:, EDGE:], plain[:, EDGE:])
    assert (plain[:, :EDGE] != plate[:, :EDGE]).any() and (got[:, EDGE:] != plate[:, EDGE:]).any()
    occlusion = next(d for d in summary["decisions"] if d["effect"] == "occlusion")
    assert occlusion["wanted"] and "matte.png, by its luminance" in occlusion["reason"]


@pytest.mark.slow
@pytest.mark.parametrize("preset", ["draft", "realtime", "reference", "paper"])
def test_every_preset_applies_a_holdout_matte(files, tmp_path, preset):
    words = ("--preset", preset, "--holdout", files / "matte.png")
    got, _ = still(files, tmp_path / "o.png", *words)
    plate = cv2.imread(str(files / "plate.png")).astype(int)
    assert np.array_equal(got[:, :EDGE], plate[:, :EDGE])
    assert (got[:, EDGE:] != plate[:, EDGE:]).any()


def test_nearer_plate_depth_occludes_with_an_edge_as_soft_as_its_coc(files, plain, tmp_path):
    depth = np.full(SIZE, 10.0, np.float32)
    depth[:, :EDGE] = 1.2  # CoC 24 / 1.2 - 12 = 8 px
    write_layers(tmp_path / "z.exr", {"Z": depth})
    got, summary = still(files, tmp_path / "o.png", "--holdout", tmp_path / "z.exr")
    plate = cv2.imread(str(files / "plate.png")).astype(int)
    assert np.array_equal(got[:, : EDGE - 5], plate[:, : EDGE - 5])
    assert np.abs(got - plain)[:, EDGE + 5 :].max() <= OTHER_BLUR
    strip = slice(EDGE - 3, EDGE + 3)
    assert (got[:, strip] != plate[:, strip]).any() and (got[:, strip] != plain[:, strip]).any()
    write_layers(tmp_path / "far.exr", {"Z": np.full(SIZE, 10.0, np.float32)})
    far, _ = still(files, tmp_path / "far.png", "--holdout", tmp_path / "far.exr")
    assert np.array_equal(far, plain)
    assert any("Z is nearer" in d["reason"] for d in summary["decisions"])


@pytest.fixture(scope="module")
def placed(files):
    """A cube without a camera, and the plate's camera in metres and of unknown scale."""
    shots.cube_glb(files / "cube.glb", camera=False)
    for scale in ("metres", "arbitrary"):
        shots.camera_json(files / f"{scale}.json", scale=scale)
    return files


def beside_a_wall(placed, out, scale, depth, *words):
    """The command that stands the cube on the ground 2.9 m off, with a wall at a depth."""
    wall = out.with_suffix(".exr")
    write_layers(wall, {"Z": np.full(SIZE, depth, np.float32)})
    return nlens(
        placed / "plate.png", placed / "cube.glb", out, "--camera-from", placed / f"{scale}.json",
        "--fit", placed / "fit.json", "--at", "0.5,0.6", *words,
        "--effects", "occlusion", "--holdout", wall,
    )  # fmt: skip


@pytest.mark.parametrize("size", ["0.05", "0.4"])
def test_depth_is_in_metres_where_the_camera_that_places_the_object_is(placed, tmp_path, size):
    plate = cv2.imread(str(placed / "plate.png")).astype(int)
    seen = []
    for depth in (2.0, 5.0):
        out = tmp_path / f"{depth}.png"
        run = beside_a_wall(placed, out, "metres", depth, "--size", size)
        assert run.returncode == 0 and "Z is taken in" not in run.stderr + run.stdout, run.stderr
        seen.append((cv2.imread(str(out)).astype(int) != plate).any(axis=2).sum())
    assert seen[0] == 0 and seen[1] > 100


def test_depth_under_a_camera_without_scale_is_told_to_be_in_units_of_the_file(placed, tmp_path):
    run = beside_a_wall(placed, tmp_path / "o.png", "arbitrary", 5.0, "--size", "0.3")
    assert run.returncode == 0 and run.stderr.count("Z is taken in units of the object's") == 1
    own = nlens(
        placed / "plate.png", placed / "anim.glb", tmp_path / "p.png", "--plan",
        "--fit", placed / "fit.json", "--holdout", tmp_path / "o.exr",
    )  # fmt: skip
    assert own.returncode == 0 and "Z is taken in" not in own.stdout


def test_shadow_falls_on_what_a_depth_map_shows_off_the_ground(files, plain, tmp_path):
    camera = Scene.load(files / "anim.glb").camera(0.0, *SIZE[::-1])

    def depth_of(heights):
        planes = [camera.plane_disparity(height) for height in heights]
        return [np.where(one > 0.0, 1.0 / np.maximum(one, 1e-6), 1e9) for one in planes]

    level, low = depth_of((0.0, -0.3))
    write_layers(tmp_path / "level.exr", {"Z": level.astype(np.float32)})
    same, _ = still(files, tmp_path / "level.png", "--holdout", tmp_path / "level.exr")
    assert np.array_equal(same, plain)
    # Left of the object the ground is 30 cm lower, and its shadow reaches farther to the left.
    edge = 190
    level[:, :edge] = low[:, :edge]
    write_layers(tmp_path / "step.exr", {"Z": level.astype(np.float32)})
    got, _ = still(files, tmp_path / "step.png", "--holdout", tmp_path / "step.exr")
    plate = cv2.imread(str(files / "plate.png")).astype(int)
    lost, lost_on_plane = ((plate - one)[:, 120:170].sum() for one in (got, plain))
    assert lost > 2 * lost_on_plane
    assert np.abs(got - plain)[:, edge + 20 :].max() <= OTHER_BLUR


def test_holdout_matte_applies_to_prerendered_layers(files, tmp_path):
    rgba = np.zeros((*SIZE, 4), np.float32)
    rgba[100:180, 200:280] = (0.2, 0.4, 0.1, 1.0)
    channels = {name: rgba[..., at] for at, name in enumerate("RGBA")}
    depth = np.where(rgba[..., 3] > 0, np.float32(2.6), np.float32(1e10))
    write_layers(tmp_path / "l.exr", {**channels, "Z": depth})
    words = ("--layers", tmp_path / "l.exr", "--holdout", files / "matte.png")
    got, _ = still(files, tmp_path / "o.png", *words)
    plate = cv2.imread(str(files / "plate.png")).astype(int)
    assert np.array_equal(got[:, :EDGE], plate[:, :EDGE])
    assert (got[120:160, EDGE + 5 : 270] != plate[120:160, EDGE + 5 : 270]).any(axis=2).all()


@pytest.mark.slow
def test_holdout_video_is_matched_by_frame_for_a_piped_plate(files, tmp_path):
    shots.write_video(tmp_path / "in.mkv", codec="ffv1", frames=6, audio=False)
    with av.open(str(tmp_path / "m.mkv"), "w") as container:
        stream = container.add_stream("ffv1", rate=25)
        stream.width, stream.height, stream.pix_fmt = shots.WIDTH, shots.HEIGHT, "gray"
        for number in range(6):  # all is covered on every second frame
            grey = np.full(SIZE, 255 * (number % 2), np.uint8)
            container.mux(stream.encode(av.VideoFrame.from_ndarray(grey, "gray")))
        container.mux(stream.encode())
    command = [
        sys.executable, "-m", "nlens_video", "-", str(files / "anim.glb"), "-", "--range", "1:5",
        "--fit", str(files / "fit.json"), "--holdout", str(tmp_path / "m.mkv"), "--codec", "ffv1",
        "--preset", "realtime", "-q",
    ]  # fmt: skip
    done = subprocess.run(
        command, input=(tmp_path / "in.mkv").read_bytes(), capture_output=True, check=False
    )
    assert done.returncode == 0, done.stderr
    (tmp_path / "out.mkv").write_bytes(done.stdout)
    before, after = shots.read_planes(tmp_path / "in.mkv"), shots.read_planes(tmp_path / "out.mkv")
    same = [
        np.array_equal(old[0], new[0])
        for (_, old), (_, new) in zip(before[1:5], after, strict=True)
    ]
    assert same == [True, False, True, False]


def test_lost_frames_of_the_plate_do_not_shift_its_mattes(files, tmp_path):
    for number in range(5):
        shots.write_png(tmp_path / f"p_{number}.png")
        cv2.imwrite(str(tmp_path / f"m_{number}.png"), np.full(SIZE, 255 * (number > 2), np.uint8))
    damaged = tmp_path / "p_1.png"
    damaged.write_bytes(damaged.read_bytes()[:60])
    run = nlens(
        tmp_path / "p_%d.png", files / "anim.glb", tmp_path / "o_%d.png", "-q",
        "--fit", files / "fit.json", "--preset", "realtime", "--holdout", tmp_path / "m_%d.png",
    )  # fmt: skip
    assert run.returncode == 0, run.stderr
    plate = cv2.imread(str(files / "plate.png"))
    same = {at: np.array_equal(cv2.imread(str(tmp_path / f"o_{at}.png")), plate) for at in (2, 3)}
    assert same == {2: False, 3: True}


def test_invalid_holdout_mattes_are_refused_in_one_line(files, tmp_path):
    cv2.imwrite(str(tmp_path / "small.png"), half()[::2, ::2])
    words = (files / "plate.png", files / "anim.glb", tmp_path / "o.png")
    run = nlens(*words, "--holdout", tmp_path / "small.png")
    assert run.returncode == 3 and run.stderr.count("\n") == 1
    assert "240x135 pixels, the plate has 480x270" in run.stderr
    run = nlens(*words, "--holdout", files / "matte.png", "--occlusion", "auto")
    assert run.returncode == 2 and "leave --occlusion auto out" in run.stderr
    assert not (tmp_path / "o.png").exists()


@pytest.mark.parametrize(
    ("words", "line"),
    [
        ((), "effect occlusion: no, what moves is looked for in files, not in streams or stills;"),
        (("--occlusion", "none"), "effect occlusion: no, --occlusion none"),
        (("--occlusion", "auto"), "effect occlusion: yes, --occlusion auto: where the plate's CoC"),
        (("--effects", "shadow"), "node shadow"),
        (("--reflect",), "effect reflection: yes, --ground-reflectance: 0.04 at normal incidence"),
        (("--reflect", "0.3"), "effect reflection: yes, --ground-reflectance: 0.3 at normal"),
        (("--effects", "defocus"), "effect reflection: no, left out by --effects"),
        (("--effects", "occlusion"), "node occlusion-cue [each frame; lane render] F: CoC network"),
    ],
)
def test_plan_states_occlusion_and_reflection_with_reasons(files, words, line):
    run = nlens(files / "plate.png", files / "anim.glb", "o.png", "--plan", "-v", *words)
    assert run.returncode == 0 and line in run.stdout, run.stdout


def test_plan_of_a_stream_does_not_say_that_foreground_was_looked_for(files):
    words = (files / "anim.glb", "o.mp4", "--fit", files / "fit.json", "--plan", "-v")
    run = nlens("testsrc2=size=480x270:rate=25", *words, "--input-format", "lavfi")
    assert run.returncode == 0, run.stderr
    assert "effect occlusion: no, what moves is looked for in files, not in streams" in run.stdout


def test_reflection_lies_on_the_ground_below_the_object(files, plain, tmp_path):
    got, _ = still(files, tmp_path / "o.png", "--reflect", "0.5")
    changed = (got != plain).any(axis=2)
    camera = Scene.load(files / "anim.glb").camera(0.0, *SIZE[::-1])
    image = (0.5 * shots.CUBE + AT) * (1, -1, 1)
    seen = camera.pixels(camera.to_camera(image.astype(np.float64)))
    rows, columns = np.flatnonzero(changed.any(axis=1)), np.flatnonzero(changed.any(axis=0))
    coc = 0.5 * abs(shots.SLOPE / 2.6 + shots.INTERCEPT)
    assert rows[-1] == pytest.approx(seen[:, 1].max() + coc, abs=3)
    assert columns[0] == pytest.approx(seen[:, 0].min() - coc, abs=3)
    assert columns[-1] == pytest.approx(seen[:, 0].max() + coc, abs=3)
    middle = camera.pixels(camera.to_camera(np.array([[0.0, -0.2, -2.35]])))[0].astype(int)
    assert got[middle[1], middle[0], 2] != plain[middle[1], middle[0], 2]
    covered, _ = still(
        files, tmp_path / "c.png", "--reflect", "0.5", "--holdout", files / "matte.png"
    )
    plate = cv2.imread(str(files / "plate.png")).astype(int)
    assert np.array_equal(covered[:, :EDGE], plate[:, :EDGE])
    assert np.array_equal(covered[:, EDGE:], got[:, EDGE:])


CARD = (40, 110)  # columns and rows of what walks [px]


@pytest.fixture(scope="module")
def walked(files):
    """A video in which a card walks past the cube, nearer than it, and one farther away."""
    plate = shots.plate()
    for name, foot in (("before", 225), ("behind", 108)):
        with av.open(str(files / f"{name}.mp4"), "w") as container:
            options = {"crf": "18", **REPEATABLE["libx264"]}
            stream = container.add_stream("libx264", rate=25, options=options)
            stream.width, stream.height, stream.pix_fmt = shots.WIDTH, shots.HEIGHT, "yuv420p"
            for number in range(24):
                rgb, left = plate.copy(), 10 + 18 * number
                rgb[max(0, foot - CARD[1]) : foot, left : left + CARD[0]] = (200, 40, 30)
                rgb = np.clip(rgb + np.random.default_rng(number).normal(0, 1, rgb.shape), 0, 255)
                container.mux(stream.encode(av.VideoFrame.from_ndarray(rgb.astype(np.uint8))))
            container.mux(stream.encode())
    return files


def moving(files, plate, out, *words):
    """Planes of a plate and of its composite, frame by frame, and the decision on occlusion."""
    run = nlens(
        files / plate, files / "anim.glb", out, "--fit", files / "fit.json", "--codec", "ffv1",
        "--effects", "auto,-grain,-exposure", "--json", *words,
    )  # fmt: skip
    assert run.returncode == 0, run.stderr
    decisions = json.loads(run.stdout)["decisions"]
    found = next(one for one in decisions if one["effect"] == "occlusion")
    pictures = [planes[0] for _, planes in shots.read_planes(out)]
    return [planes[0] for _, planes in shots.read_planes(files / plate)], pictures, found


@pytest.mark.slow
def test_what_walks_before_the_object_hides_it_by_default(walked, tmp_path):
    plate, seen, found = moving(walked, "before.mp4", tmp_path / "o.mkv")
    assert found["wanted"] and found["measured"] > 0.9
    *_, left_out = moving(walked, "before.mp4", tmp_path / "n.mkv", "--occlusion", "none")
    assert not left_out["wanted"]
    there = np.s_[150:190, 10 + 18 * 11 + 5 : 10 + 18 * 11 + 35]  # the card before the cube
    off = np.abs(seen[11][there].astype(int) - plate[11][there])
    assert (off <= 2).mean() > 0.98
    over = np.abs(shots.read_planes(tmp_path / "n.mkv")[11][1][0].astype(int) - plate[11])[there]
    assert (over > 10).mean() > 0.5


@pytest.mark.slow
def test_what_walks_behind_the_object_is_hidden_by_it(walked, tmp_path):
    _, seen, found = moving(walked, "behind.mp4", tmp_path / "o.mkv")
    assert found["wanted"] and "behind" in found["reason"]
    _, alone, _ = moving(walked, "behind.mp4", tmp_path / "n.mkv", "--occlusion", "none")
    inside = np.s_[150:180, 215:265]  # the cube
    assert np.array_equal(seen[11][inside], alone[11][inside])


@pytest.mark.slow
def test_a_range_of_a_shot_in_which_something_walks_equals_the_whole(walked, tmp_path):
    _, whole, _ = moving(walked, "before.mp4", tmp_path / "o.mkv")
    _, part, _ = moving(walked, "before.mp4", tmp_path / "p.mkv", "--range", "10:13")
    assert all(np.array_equal(a, b) for a, b in zip(whole[10:13], part, strict=True))
