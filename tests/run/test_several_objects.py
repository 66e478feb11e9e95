"""Several objects and keyed ones in whole runs: pixels, order, blur, shadow, chunks, files."""

import json

import numpy as np
import pytest
from support import shots
from support.camera_paths import rotation
from support.command import nlens, one_line
from support.glb_builder import GlbBuilder

from nlens_video.cameras.solved import CameraKey, SolvedCamera

WIDTH, HEIGHT, FRAMES = 320, 180, 13
RED, BLUE = (1.0, 0.02, 0.02), (0.02, 0.05, 1.0)
CARD = np.array([[-0.3, 0, 0], [0.3, 0, 0], [0.3, 1, 0], [-0.3, 1, 0]], np.float32)
FIT = {"slope": 90.0, "intercept": -30.0, "width": WIDTH, "height": HEIGHT}
"""Of objects whose unit is that of the camera: in focus at 3."""


def card(path, colour, scale=1.0):
    """An upright card of one colour that shines by itself, somewhere in its file."""
    builder = GlbBuilder()
    paint = builder.add(
        "materials",
        {
            "pbrMetallicRoughness": {"baseColorFactor": [*colour, 1.0]},
            "doubleSided": True,
            "extensions": {"KHR_materials_unlit": {}},
        },
    )
    mesh = builder.mesh(scale * CARD, material=paint)
    builder.node(mesh=mesh, name=path.stem, translation=[2.0 * scale, scale, -5.0 * scale])
    return builder.write(path)


@pytest.fixture
def folder(tmp_path):
    grey = np.full((HEIGHT, WIDTH, 3), 90, np.uint8)
    shots.write_video(tmp_path / "in.mkv", FRAMES, codec="ffv1", rgb=grey, audio=False)
    shots.write_png(tmp_path / "in.png", grey)
    card(tmp_path / "red.glb", RED)
    card(tmp_path / "blue.glb", BLUE, 7.0)
    (tmp_path / "fit.json").write_text(json.dumps(FIT))
    return tmp_path


def written(folder, objects, *, name="shot.toml", plate="in.mkv", out="out.mkv", more=""):
    """A shot file of a list of objects, each in words of TOML."""
    path = folder / name
    listed = "".join(f"[[object]]\n{one}\n" for one in objects)
    path.write_text(
        f'version = 2\n[plate]\nfile = "{plate}"\n{listed}[camera]\nhorizon = 0.25\nfov = 50\n'
        f'[lens]\nfit = "fit.json"\n[output]\nfile = "{out}"\n{more}'
    )
    return path


def rendered(shot, *words):
    run = nlens(shot, "-q", "-y", *words)
    assert run.returncode == 0, run.stderr
    return shot.parent / "out.mkv"


def pictures(path):
    """RGB (H, W, 3) of each frame, float."""
    import av

    with av.open(str(path)) as container:
        return [f.to_ndarray(format="rgb24").astype(np.float32) for f in container.decode(video=0)]


def covered(picture, colour):
    """Left, upper, right and lower border of what is mostly of one colour [px]."""
    other = 2 if colour == RED else 0
    ours = picture[..., 0 if colour == RED else 2] - picture[..., other] > 60
    rows, columns = np.flatnonzero(ours.any(axis=1)), np.flatnonzero(ours.any(axis=0))
    return columns[0], rows[0], columns[-1] + 1, rows[-1] + 1


def stands(picture, colour):
    """Column and row of its foot, and its height, in fractions of the frame."""
    left, upper, right, lower = covered(picture, colour)
    return 0.5 * (left + right) / WIDTH, lower / HEIGHT, (lower - upper) / HEIGHT


SHARP = '[effects]\neffects = "none"\n'
ONE_PX = 1.6 / HEIGHT
KEYED = """\
file = "blue.glb"
size = 0.3
interpolation = "linear"
[[object.key]]
frame = 2
at = [0.2, 0.7]
[[object.key]]
frame = 10
at = [0.8, 0.7]
"""


def red(at="[0.5, 0.9]", size=0.4):
    return f'file = "red.glb"\nat = {at}\nsize = {size}'


@pytest.mark.parametrize("order", [1, -1], ids=["keyed second", "keyed first"])
def test_keyed_object_is_where_its_keys_say_and_halfway_between_them(folder, order):
    seen = pictures(rendered(written(folder, [red(), KEYED][::order], more=SHARP)))
    assert len(seen) == FRAMES
    for frame, x in ((0, 0.2), (2, 0.2), (6, 0.5), (10, 0.8), (12, 0.8)):
        # at frame 6 it stands behind the other one, whose upper end it shows
        if frame != 6:
            assert stands(seen[frame], BLUE) == pytest.approx((x, 0.7, 0.3), abs=ONE_PX)
        left, _, right, _ = covered(seen[frame], BLUE)
        assert 0.5 * (left + right) / WIDTH == pytest.approx(x, abs=ONE_PX)
        assert stands(seen[frame], RED) == pytest.approx((0.5, 0.9, 0.4), abs=ONE_PX)


def test_nearer_object_hides_the_farther_one_in_any_order(folder):
    behind = 'file = "blue.glb"\nat = [0.55, 0.6]\nsize = 0.45'
    first = pictures(rendered(written(folder, [red(), behind], more=SHARP), "--frame", "0"))[0]
    other = pictures(rendered(written(folder, [behind, red()], more=SHARP), "--frame", "0"))[0]
    np.testing.assert_allclose(first, other, atol=1.0)
    left, upper, right, lower = covered(first, RED)
    inside = first[upper + 2 : lower - 2, left + 2 : right - 2]
    assert (inside[..., 0] - inside[..., 2]).min() > 60  # nothing of the blue one shows through
    assert stands(first, BLUE)[1] < stands(first, RED)[1]


@pytest.mark.slow
def test_each_object_is_blurred_by_its_own_depth(folder):
    """The horizon's camera stands one unit per unit of height: the far one is out of focus."""
    fit = {**FIT, "slope": 60.0, "intercept": -20.0}
    (folder / "fit.json").write_text(json.dumps(fit))
    objects = [
        'file = "red.glb"\nat = [0.3, 0.95]\nsize = 0.6',
        'file = "blue.glb"\nat = [0.75, 0.35]\nsize = 0.3',
    ]
    more = '[effects]\neffects = "defocus"\n'
    both = pictures(rendered(written(folder, objects, more=more), "--frame", "0"))[0]
    alone = [
        pictures(rendered(written(folder, [one], more=more), "--frame", "0"))[0]
        for one in objects
    ]  # fmt: skip
    # the first object gives the units of the fit, so it looks as if it were alone
    part = (slice(None), slice(0, WIDTH // 2))
    np.testing.assert_allclose(both[part], alone[0][part], atol=1.0)

    def edge_px(picture, columns):
        row = picture[int(0.3 * HEIGHT), columns, 2] - 90.0
        return 1.0 / np.abs(np.diff(row / row.max())).max()

    wide = edge_px(both, slice(WIDTH // 2, WIDTH))
    assert wide > 3.0 * edge_px(
        pictures(rendered(written(folder, objects, more=SHARP), "--frame", "0"))[0],
        slice(WIDTH // 2, WIDTH),
    )


@pytest.mark.slow
def test_motion_blur_and_shadow_follow_the_keys(folder):
    fast = KEYED.replace("frame = 10", "frame = 6")
    more = (
        '[effects]\neffects = "motion-blur,shadow"\nshutter-angle = 360\n[light]\nsun = [0, 50]\n'
    )
    moving = pictures(rendered(written(folder, [red("[0.9, 0.95]", 0.1), fast], more=more)))
    still = pictures(rendered(written(folder, [red("[0.9, 0.95]", 0.1), fast], more=SHARP)))

    def smear(picture):
        row = np.clip(picture[int(0.55 * HEIGHT), :, 2] - 90.0, 0.0, None)
        return ((row > 0.05 * row.max()) & (row < 0.95 * row.max())).sum()

    assert smear(moving[4]) > smear(still[4]) + 20  # a step is 0.15 of 320 columns
    assert smear(moving[12]) <= smear(still[12]) + 2

    def shadow_x(picture):
        below = picture[int(0.72 * HEIGHT) :, : int(0.85 * WIDTH)].sum(axis=2)
        dark = np.clip(np.median(below) - below, 0.0, None)
        dark[dark < 0.3 * dark.max()] = 0.0
        return (dark.sum(axis=0) * np.arange(dark.shape[1])).sum() / dark.sum() / WIDTH

    assert shadow_x(moving[0]) == pytest.approx(0.2, abs=0.05)
    assert shadow_x(moving[12]) == pytest.approx(0.8, abs=0.05)


@pytest.mark.slow
def test_one_listed_object_is_byte_for_byte_the_classic_command_line(folder):
    shot = written(folder, [red() + "\nyaw = 20"], out="listed.mp4")
    assert nlens(shot, "-q", "--codec", "libx264").returncode == 0
    classic = nlens(
        folder / "in.mkv", folder / "red.glb", folder / "classic.mp4", "--at", "0.5,0.9", "--size",
        "0.4", "--yaw", "20", "--horizon", "0.25", "--fov", "50", "--fit", folder / "fit.json",
        "--codec", "libx264", "-q",
    )  # fmt: skip
    assert classic.returncode == 0, classic.stderr
    assert (folder / "listed.mp4").read_bytes() == (folder / "classic.mp4").read_bytes()


@pytest.mark.slow
def test_ranges_resumed_runs_and_saved_shots_are_parts_of_the_same_result(folder):
    shot = written(folder, [KEYED, red()])
    whole = pictures(rendered(shot))
    again = folder / "kept" / "again.toml"
    again.parent.mkdir()
    assert nlens(shot, "-q", "-y", "--save-shot", again, "--plan").returncode == 0
    assert nlens(again, "-q", "-y").returncode == 0
    np.testing.assert_array_equal(pictures(folder / "out.mkv"), whole)
    np.testing.assert_array_equal(pictures(rendered(shot, "--range", "5:8")), whole[5:8])
    np.testing.assert_array_equal(pictures(rendered(shot, "--resume")), whole)


@pytest.mark.slow
def test_still_picture_shows_the_keys_of_its_moment(folder):
    shot = written(folder, [red(), KEYED], plate="in.png", out="out.png", more=SHARP)
    said = one_line(nlens(shot, "-q"), 2)
    assert "frame 2: the plate has no frame rate; give the time in seconds" in said
    timed = KEYED.replace("frame = 2", "time = 0").replace("frame = 10", "time = 1")
    shot = written(folder, [red(), timed], plate="in.png", out="out.png", more=SHARP)
    assert nlens(shot, "-q", "-y").returncode == 0
    (picture,) = pictures(folder / "out.png")
    assert stands(picture, BLUE) == pytest.approx((0.2, 0.7, 0.3), abs=ONE_PX)
    assert stands(picture, RED) == pytest.approx((0.5, 0.9, 0.4), abs=ONE_PX)


def test_files_of_other_objects_are_not_written_over(folder):
    shot = written(folder, [red(), KEYED], out="blue.glb")
    before = (folder / "blue.glb").read_bytes()
    assert "is an object as well" in one_line(nlens(shot, "-q", "-y"), 6)
    assert (folder / "blue.glb").read_bytes() == before


def test_plan_renders_nothing_and_names_what_moves(folder):
    run = nlens(written(folder, [red(), KEYED]), "--plan", "-v")
    assert run.returncode == 0 and not (folder / "out.mkv").exists()
    assert "placed by --at 0.5,0.9 --size 0.4" in run.stdout
    assert "motion-blur: yes" in run.stdout


def test_further_object_that_lies_outside_the_frame_is_told_and_one_inside_is_not(folder):
    beside = 'file = "blue.glb"\nat = [-0.3, 0.8]\nsize = 0.1'
    run = nlens(written(folder, [red(), beside], more=SHARP), "-y")
    assert run.returncode == 0
    assert "note   object 2, " in run.stderr and "outside the frame on all frames" in run.stderr
    assert "object 1" not in run.stderr
    assert "outside" not in nlens(written(folder, [red(), KEYED], more=SHARP), "-y").stderr


def test_object_that_a_turning_camera_shows_later_is_not_refused(folder):
    keys = []
    for n in range(FRAMES):
        turn, pose = np.radians(40.0 - 6.0 * n), np.eye(4)
        pose[:3, :3] = rotation(turn, np.radians(-15.0), 0.0)
        pose[1, 3] = 1.5
        keys.append(
            CameraKey(
                index=n, pts_s=n / 25, world_to_camera=np.linalg.inv(pose), fov_x_deg=40.0
            )  # fmt: skip
        )
    solved = SolvedCamera(width=WIDTH, height=HEIGHT, keys=tuple(keys), path="rotation")
    (folder / "turn.json").write_text(solved.to_json())
    words = [folder / "in.mkv", folder / "red.glb", folder / "out.mkv", "--effects", "none"]
    place = ["--at", "0.5,0.8", "--size", "0.4", "--at-frame", "12"]
    run = nlens(*words, *place, "--camera-from", folder / "turn.json", "--fit", folder / "fit.json")
    assert run.returncode == 0, run.stderr
    seen = pictures(folder / "out.mkv")
    assert (seen[0][..., 0] - seen[0][..., 2]).max() < 20.0  # it is not in view yet
    assert stands(seen[12], RED)[0] == pytest.approx(0.5, abs=0.02)


def test_frame_of_a_place_behind_the_plates_end_is_refused(folder):
    words = [
        folder / "in.mkv",
        folder / "red.glb",
        folder / "out.mkv",
        "--horizon",
        "0.3",
        "--size",
    ]
    place = [*words, "0.4", "--at", "0.5,0.8"]
    line = one_line(nlens(*place, "--at-frame", "500"), 2)
    assert f"--at-frame 500: the plate has {FRAMES} frames, 0 to {FRAMES - 1}" in line
    file = folder / "blue.glb"
    blue = f'{{file = "{file}", at = [0.2, 0.8], at-frame = 500, size = 0.2}}'
    line = one_line(nlens(*place, "--object", blue), 2)
    assert "blue.glb: at-frame 500: the plate has" in line
    line = one_line(nlens(*words, "0.4", "--at-frame", "5"), 2)
    assert "--at-frame is the frame of --at; give --at X,Y too" in line
