"""Whether a shot calls for occlusion by what moves in it, and which way the order falls."""

import numpy as np
import pytest
from support import shots

from nlens_video.core.layers import Box
from nlens_video.graph.base.view import View
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


def test_a_card_that_walks_before_the_object_covers_it_where_it_is(scene):
    moving, finding = found(scene, depth=1.9)
    assert finding.wanted and finding.certainty > 0.95
    got = matte(moving, 11, 1.9)
    left = 10 + 19 * 11 - got.box.x0
    rows = slice(round(row_of(1.9)) - 120 - got.box.y0, round(row_of(1.9)) - 40 - got.box.y0)
    cover = (got.coverage * got.before)[rows]
    assert cover[:, left + 3 : left + 37].min() > 0.95
    assert cover[:, : left - 4].max() < 0.05 and cover[:, left + 45 :].max() < 0.05


def test_a_card_that_walks_behind_the_object_hides_the_ground_alone(scene):
    moving, finding = found(scene, depth=2.6)
    assert finding.wanted and "behind" in finding.reason
    got = matte(moving, 11, 2.6)
    assert got.coverage.max() == 1.0 and got.before.max() == 0.0


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
