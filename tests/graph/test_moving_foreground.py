"""Whether a shot calls for occlusion by what moves in it, and which way the order falls."""

import math

import cv2
import numpy as np
import pytest
from msgspec.structs import replace
from scipy.spatial.transform import Rotation
from support import shots
from support.rooms import room

from nlens_video.cameras.placed import in_solved_world
from nlens_video.cameras.solved import CameraKey, SolvedCamera
from nlens_video.core.errors import InputError
from nlens_video.core.layers import Box
from nlens_video.graph.base.view import View
from nlens_video.graph.foreground_file import read_foreground, write_foreground
from nlens_video.graph.moving_foreground import find_moving_foreground
from nlens_video.scene.scene import Scene
from nlens_video.video.info import SourceFrame
from nlens_video.video.pixels.picture import ArrayPicture

PLACE = (0.0, 0.0, -2.2)
FRAMES = 24


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    return Scene.load(
        shots.cube_glb(tmp_path_factory.mktemp("cube") / "a.glb", start=PLACE, size=0.4)
    )


def row_of(depth):
    """Row of the ground at a distance along z [px]."""
    view = shots.camera()
    return float(view.pixels(view.to_camera(np.array([[0.0, 0.0, -depth]])))[0, 1])


def shot(depth=None, pan=0, count=FRAMES, start=0):
    """Frames of a textured plate over which a card walks that stands at a distance."""
    plate = shots.plate()
    for index in range(count):
        rgb = np.roll(plate, pan * index, axis=1).copy()
        if depth is not None:
            foot, left = round(row_of(depth)), 10 + 19 * (index + start)
            rgb[max(0, foot - 150) : foot, left : left + 40] = (200, 30, 40)
        grain = np.random.default_rng(index).normal(0, 1, rgb.shape)
        codes = np.clip(rgb + grain, 0, 255).astype(np.uint8)
        yield SourceFrame(index=index, time_s=index / 25, picture=ArrayPicture(codes, "rgb"))


def read_again(frames, passes=None):
    """Reads a shot; counts how many frames each pass took."""

    def again(*, sparse=False):
        taken = [0]
        if passes is not None:
            passes.append(taken)
        for frame in frames():
            taken[0] += 1
            if not sparse or frame.index % 2 == 0:
                yield frame

    return again


def found(scene, **what):
    view = View(width=shots.WIDTH, height=shots.HEIGHT)
    return find_moving_foreground(read_again(lambda: shot(**what)), scene, view, 0.0)


def matte(moving, index, depth):
    frame = list(shot(depth))[index]
    whole = Box(0, 0, shots.WIDTH, shots.HEIGHT)
    return moving.on_frame(index).matte(frame.picture, whole, None)


def around_object(moving, index):
    """Where the background is known on a frame (rows, columns)."""
    known = moving.reference.box_in_frame(moving.clean_plate.box, moving.cameras[index])
    whole = Box(0, 0, shots.WIDTH, shots.HEIGHT)
    return known.intersection(whole).slices_in(whole)


def on_frame(got, values):
    """Values of a matte on the whole frame, 0 beyond its box."""
    out = np.zeros((shots.HEIGHT, shots.WIDTH), np.float32)
    out[got.box.slices_in(Box(0, 0, shots.WIDTH, shots.HEIGHT))] = values
    return out


def test_a_card_that_walks_before_the_object_covers_it_where_it_is(scene):
    moving, finding = found(scene, depth=1.9)
    assert finding.wanted and finding.certainty > 0.95
    got = matte(moving, 11, 1.9)
    left = 10 + 19 * 11
    rows = slice(round(row_of(1.9)) - 120, round(row_of(1.9)) - 40)
    cover = on_frame(got, got.coverage * got.before)[rows]
    assert cover[:, left + 3 : left + 37].min() > 0.95
    assert cover[:, : left - 4].max() < 0.05 and cover[:, left + 45 :].max() < 0.05


def test_the_matte_of_a_card_takes_no_more_of_the_frame_than_the_card(scene):
    moving, _ = found(scene, depth=1.9)
    box, left, foot = matte(moving, 11, 1.9).box, 10 + 19 * 11, round(row_of(1.9))
    card = Box(left, foot - 150, left + 40, foot)
    assert box.union(card.expanded(12)) == card.expanded(12)


def test_a_card_that_walks_behind_the_object_hides_the_ground_alone(scene):
    moving, finding = found(scene, depth=2.6)
    assert finding.wanted and "behind" in finding.reason
    got = matte(moving, 11, 2.6)
    assert got.coverage.max() == 1.0 and got.before.max() == 0.0


def flashed(index=11):
    """Frames on which a card walks before the object, one of them lit by a flash."""
    for frame in shot(1.9):
        if frame.index == index:
            frame.picture.array[:] = np.minimum(frame.picture.array * 1.9, 255)
        yield frame


def test_a_card_lit_by_a_flash_covers_the_object_by_its_outline_in_a_run_that_is_told_too(
    scene, tmp_path
):
    view = View(width=shots.WIDTH, height=shots.HEIGHT)
    moving, finding = find_moving_foreground(read_again(flashed), scene, view, 0.0)
    assert finding.wanted
    write_foreground(tmp_path / "found.npz", moving, finding)
    told, _ = read_foreground(tmp_path / "found.npz")
    frame, whole = list(flashed())[11], Box(0, 0, shots.WIDTH, shots.HEIGHT)
    got, also = (one.on_frame(11).matte(frame.picture, whole, None) for one in (moving, told))
    assert np.array_equal(got.coverage, also.coverage)
    foot, left = round(row_of(1.9)), 10 + 19 * 11
    card = np.zeros((shots.HEIGHT, shots.WIDTH), np.bool_)
    card[foot - 150 : foot, left : left + 40] = True
    card = card[got.box.slices_in(whole)]
    assert np.abs(got.coverage - card).sum() < 0.12 * card.sum()
    assert got.before[card].mean() > 0.95


@pytest.mark.parametrize(
    ("what", "reason"),
    [
        ({}, "nothing moves"),
        ({"pan": 3}, "camera moves"),
        ({"depth": 1.9, "count": 8}, "too few frames"),
    ],
)
def test_a_shot_that_tells_nothing_calls_for_nothing_and_says_why(scene, what, reason):
    moving, finding = found(scene, **what)
    assert moving is None and not finding.wanted and reason in finding.reason


def test_a_place_that_changes_all_the_time_leaves_the_background_unknown(scene):
    def screen():
        for frame in shot():
            shade = np.random.default_rng(frame.index).integers(0, 255, 3)
            frame.picture.array[100:220, 180:300] = shade
            yield frame

    view = View(width=shots.WIDTH, height=shots.HEIGHT)
    moving, finding = find_moving_foreground(read_again(screen), scene, view, 0.0)
    assert moving is None and not finding.wanted
    assert "is known" in finding.reason and finding.certainty < 0.9


def flickering():
    """Lamps of 20 px behind the object that flicker, and one that sways by a pixel."""
    for frame in shot(count=72):
        draw = np.random.default_rng(frame.index)
        for left in (120, 180, 240):
            level = draw.uniform(0.3, 1.0)
            frame.picture.array[60:80, left : left + 20] = np.uint8(
                level * np.array([255, 200, 90])
            )
        sway = int(draw.integers(0, 3))
        frame.picture.array[90:110, 200 + sway : 220 + sway] = (255, 220, 120)
        yield frame


def test_lamps_that_flicker_or_sway_are_seen_to_go_nowhere_by_one_sparse_look(scene):
    passes = []
    view = View(width=shots.WIDTH, height=shots.HEIGHT)
    moving, finding = find_moving_foreground(read_again(flickering, passes), scene, view, 0.0)
    assert moving is None and "nothing moves" in finding.reason
    assert len(passes) == 1


def jumping():
    """Frames on which a card walks whose lower end jumps."""
    for frame in shot(count=96):
        left, foot = 10 + 4 * frame.index, 150 + 60 * (frame.index % 3)
        frame.picture.array[100:foot, left : left + 60] = (200, 30, 40)
        yield frame


def test_what_has_no_steady_outline_is_given_up_before_the_shot_is_read_through(scene):
    passes = []
    view = View(width=shots.WIDTH, height=shots.HEIGHT)
    moving, finding = find_moving_foreground(read_again(jumping, passes), scene, view, 0.0)
    assert moving is None and "steady outline" in finding.reason
    assert passes[0][0] == 96 and passes[1][0] < 60


def turned(index):
    """World to camera (3, 3) of a frame of a camera that turns by 0.6 degrees each frame."""
    yaw = math.radians(0.6 * (0.5 * FRAMES - index))
    return shots.camera_pose()[:3, :3].T @ Rotation.from_euler("Y", -yaw).as_matrix()


def view_of_a_turning_camera(eyes=None):
    """The frames' cameras as they were solved; `eyes` are where the camera stands."""
    cameras = []
    for index in range(FRAMES):
        pose = np.eye(4)
        pose[:3, :3] = turned(index)
        eye = shots.camera_pose()[:3, 3] if eyes is None else eyes[index]
        pose[:3, 3] = -pose[:3, :3] @ eye
        cameras.append(pose)
    return view_of(cameras, "rotation")


def view_of(cameras, path):
    """Frames whose camera from world (4, 4) was solved."""
    fov = math.degrees(2 * math.atan(shots.WIDTH / shots.HEIGHT * math.tan(0.5 * shots.YFOV)))
    keys = tuple(
        CameraKey(index=index, pts_s=index / 25, world_to_camera=pose, fov_x_deg=fov)
        for index, pose in enumerate(cameras)
    )
    solved = SolvedCamera(
        width=shots.WIDTH, height=shots.HEIGHT, keys=keys, path=path, fov="measured"
    )
    view = View(width=shots.WIDTH, height=shots.HEIGHT, solved=solved)
    return replace(view, cameras=in_solved_world(solved))


def seen_turned(picture, index):
    """A picture of the still camera, twice as wide, as a frame of the turning one shows it."""
    view = shots.camera()
    lens = np.array([[view.fx, 0, -view.cx], [0, -view.fy, -view.cy], [0, 0, -1]])
    wide = np.array([[1, 0, shots.WIDTH / 2], [0, 1, 0], [0, 0, 1]]) @ lens
    turn = turned(index) @ shots.camera_pose()[:3, :3]
    matrix = lens @ turn @ np.linalg.inv(wide)
    half = np.array([[1, 0, 0.5], [0, 1, 0.5], [0, 0, 1]])
    size = shots.WIDTH, shots.HEIGHT
    return cv2.warpPerspective(
        picture, np.linalg.inv(half) @ matrix @ half, size, flags=cv2.INTER_CUBIC,
        borderMode=cv2.BORDER_REFLECT_101,
    )  # fmt: skip


def turning_shot(depth):
    """Frames of a camera that turns, and where a card is that walks through its picture."""
    half = shots.plate()
    plate = np.hstack([half[:, ::-1][:, shots.WIDTH // 2 :], half, half[:, : shots.WIDTH // 2]])
    for index in range(FRAMES):
        wide, where = plate.copy(), np.zeros(plate.shape[:2], np.float32)
        foot, left = round(row_of(depth)), shots.WIDTH // 2 + 10 + 19 * index
        wide[max(0, foot - 150) : foot, left : left + 40] = (200, 30, 40)
        where[max(0, foot - 150) : foot, left : left + 40] = 1.0
        grain = np.random.default_rng(index).normal(0, 1, half.shape)
        codes = np.clip(seen_turned(wide, index) + grain, 0, 255).astype(np.uint8)
        frame = SourceFrame(index=index, time_s=index / 25, picture=ArrayPicture(codes, "rgb"))
        yield frame, seen_turned(where, index)


@pytest.mark.slow
@pytest.mark.parametrize(("depth", "before"), [(1.9, True), (2.6, False)])
def test_the_order_with_what_walks_past_holds_while_the_camera_turns(
    scene, depth, before, tmp_path
):
    frames = list(turning_shot(depth))
    again = read_again(lambda: (frame for frame, _ in frames))
    moving, finding = find_moving_foreground(again, scene, view_of_a_turning_camera(), 0.0)
    assert finding.wanted and finding.certainty > 0.9
    whole = Box(0, 0, shots.WIDTH, shots.HEIGHT)
    file = tmp_path / "found.npz"
    write_foreground(file, moving, finding)
    told, also = read_foreground(file)
    assert also == finding
    for index in (9, 11, 13):
        frame, where = frames[index]
        got = moving.on_frame(index).matte(frame.picture, whole, None)
        again = told.on_frame(index).matte(frame.picture, whole, None)
        for name in ("box", "coverage", "before", "background"):
            assert np.array_equal(getattr(got, name), getattr(again, name))
        middle = (where > 0.99)[got.box.slices_in(whole)]
        off = np.abs(on_frame(got, got.coverage) - where)[around_object(moving, index)]
        assert off.sum() < 0.05 * middle.sum()
        assert (got.before[middle] > 0.5).mean() == float(before)


def travelling_shot(depth):
    """Frames of a camera that travels through a room, and where a card is that walks there."""
    for index in range(FRAMES):
        view = replace(shots.camera(), world_from_camera=travelled(index))
        walker = (0.08 * index - 0.9, depth)
        seen = room(view, walker=walker, grain=index + 1)
        empty = room(view, grain=index + 1)
        whole = Box(0, 0, shots.WIDTH, shots.HEIGHT)
        where = np.abs(seen.linear(whole) - empty.linear(whole)).max(axis=2) > 0.0
        yield SourceFrame(index=index, time_s=index / 25, picture=seen), where


def travelled(index):
    pose = shots.camera_pose()
    pose[:3, 3] += [0.012 * index - 0.14, 0.003 * np.sin(index), -0.006 * index]
    return pose


@pytest.mark.slow
@pytest.mark.parametrize(("depth", "before"), [(1.9, True), (2.6, False)])
def test_the_order_with_what_walks_past_holds_while_the_camera_travels(
    scene, depth, before, tmp_path
):
    frames = list(travelling_shot(depth))
    again = read_again(lambda: (frame for frame, _ in frames))
    view = view_of([np.linalg.inv(travelled(index)) for index in range(FRAMES)], "moving")
    moving, finding = find_moving_foreground(again, scene, view, 0.0)
    assert finding.wanted and finding.certainty > 0.9
    whole = Box(0, 0, shots.WIDTH, shots.HEIGHT)
    write_foreground(tmp_path / "found.npz", moving, finding)
    told, _ = read_foreground(tmp_path / "found.npz")
    for index in (10, 12, 14):
        frame, where = frames[index]
        got = moving.on_frame(index).matte(frame.picture, whole, None)
        also = told.on_frame(index).matte(frame.picture, whole, None)
        assert np.array_equal(got.coverage, also.coverage)
        middle = where[got.box.slices_in(whole)]
        off = np.abs(on_frame(got, got.coverage) - where)[around_object(moving, index)]
        assert off.sum() < 0.1 * middle.sum()
        assert (got.before[middle] > 0.5).mean() == float(before)


def test_a_camera_that_travels_far_calls_for_nothing(scene):
    frames = [frame for frame, _ in turning_shot(1.9)]
    eyes = [np.array([0.1 * index, shots.EYE_HEIGHT, 0.0]) for index in range(FRAMES)]
    view = view_of_a_turning_camera(eyes)
    moving, finding = find_moving_foreground(read_again(lambda: frames), scene, view, 0.0)
    assert moving is None and "travels" in finding.reason


@pytest.mark.parametrize("content", [b"", b"PK nothing", None])
def test_a_file_that_tells_nothing_is_refused(tmp_path, content):
    file = tmp_path / "found.npz"
    if content is not None:
        file.write_bytes(content)
    with pytest.raises(InputError, match="cannot be read"):
        read_foreground(file)


def test_that_nothing_moves_is_kept_too(scene, tmp_path):
    file = tmp_path / "found.npz"
    write_foreground(file, *found(scene))
    assert read_foreground(file) == found(scene)
