"""A cut inside the plate is told with its frame; flashes, pans and people who cross are not."""

from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from support import shots, takes

from nlens_video.cli.main import main
from nlens_video.core.layers import Box
from nlens_video.run.checks.cut import CutCheck, CutWatch
from nlens_video.video.info import SourceFrame
from nlens_video.video.pixels.picture import ArrayPicture

WIDTH, HEIGHT = 480, 270
RATE, RETURNS = 25, 15
FRAMES = 30


def scene(seed, width=WIDTH):
    """A view (HEIGHT, width, 3) of large and small things."""
    rng = np.random.default_rng(seed)
    picture = np.full((HEIGHT, width, 3), 0.4, np.float32)
    for _ in range(width // 8):
        x, y, side = rng.integers(0, width), rng.integers(0, HEIGHT), rng.integers(6, 70)
        shade = rng.uniform(0.05, 0.95, 3).tolist()
        cv2.rectangle(picture, (int(x), int(y)), (int(x + side), int(y + side // 2)), shade, -1)
    return picture


def found(frames, indices=None):
    watch, rng = CutWatch(RETURNS), np.random.default_rng(0)
    for index, frame in zip(indices or range(len(frames)), frames, strict=False):
        noisy = 255 * np.clip(frame, 0, 1) + rng.normal(0, 2, frame.shape)
        watch.see(index, ArrayPicture(np.uint8(np.clip(noisy, 0, 255)), "rgb"))
    return watch.cut


def panned(way_px, frames=FRAMES):
    """A camera that pans by so many pixels a frame, blurred along."""
    steps = np.cumsum([way_px] * frames)
    wide = scene(1, WIDTH + int(steps[-1]) + 1)
    wide = cv2.blur(wide, (max(1, way_px // 2), 1))
    return [wide[:, at : at + WIDTH] for at in steps]


def crossed(width, way_px):
    """Somebody of a width crosses close to the camera, so many pixels a frame."""
    frames, coat = [], scene(9, max(width, 100))[:, :width]
    for at in range(FRAMES):
        frame = scene(1)
        left = at * way_px - width
        begin, end = max(0, left), min(WIDTH, left + width)
        if begin < end:
            frame[:, begin:end] = 0.3 * coat[:, begin - left : end - left]
        frames.append(frame)
    return frames


@pytest.mark.parametrize("at", [1, 2, 14, 27])
def test_cut_is_found_on_its_frame(at):
    assert found([scene(1)] * at + [scene(2)] * (FRAMES - at)) == at


def test_cut_between_a_pan_and_a_pan_is_found():
    assert found(panned(6)[:15] + [one[::-1] for one in panned(6)[:15]]) == 15


def test_first_of_two_cuts_is_told():
    assert found([scene(1)] * 20 + [scene(2)] * 20 + [scene(3)] * 20) == 20


@pytest.mark.parametrize("length", [1, 2, 5, 9])
@pytest.mark.parametrize("light", ["brighter", "white", "black"])
def test_flash_is_no_cut(light, length):
    lit = {"brighter": 2.5 * scene(1), "white": 0.97 + 0.02 * scene(2), "black": 0 * scene(1)}
    assert found([scene(1)] * 10 + [lit[light]] * length + [scene(1)] * 10) is None


def test_another_picture_that_is_shown_for_a_moment_is_no_cut():
    assert found([scene(1)] * 10 + [scene(2)] * 4 + [scene(1)] * 10) is None


def test_lamp_that_is_switched_is_no_cut():
    side = np.linspace(0.2, 1.4, WIDTH, dtype=np.float32)[:, None]
    assert found([scene(1)] * 10 + [0.6 * side * scene(1)] * 20) is None


@pytest.mark.parametrize("way_px", [4, 30, 90, 200])
def test_pan_is_no_cut(way_px):
    assert found(panned(way_px)) is None


@pytest.mark.parametrize("way_px", [40, 150, 400])
def test_whip_pan_from_view_to_view_is_no_cut(way_px):
    moving = panned(way_px, 12)
    assert found([moving[0]] * 8 + moving + [moving[-1]] * 10) is None


def test_jolt_is_no_cut():
    wide = scene(1, 2 * WIDTH)
    assert found([wide[:, :WIDTH]] * 10 + [wide[:, 90 : 90 + WIDTH]] * 10) is None


@pytest.mark.parametrize(("width", "way_px"), [(120, 12), (300, 30), (460, 60), (480, 120)])
def test_people_who_cross_are_no_cut(width, way_px):
    assert found(crossed(width, way_px)) is None


def test_frames_of_noise_and_without_texture_tell_nothing():
    rng = np.random.default_rng(3)
    assert found([rng.uniform(0, 1, (HEIGHT, WIDTH, 3)) for _ in range(FRAMES)]) is None
    assert found([np.full((HEIGHT, WIDTH, 3), 0.1 + 0.6 * (at > 9)) for at in range(20)]) is None


def test_frames_that_do_not_follow_each_other_are_not_compared():
    frames = [scene(1)] * 10 + [scene(2)] * 10
    assert found(frames, [*range(10), *range(40, 50)]) is None


def told(boxes):
    """Notes on a plate with a cut at frame 10, and the object in these boxes."""
    check = CutCheck(1 / RATE)
    for index, box in enumerate(boxes):
        plate = np.uint8(255 * scene(1 if index < 10 else 2))
        frame = SourceFrame(index=index, picture=ArrayPicture(plate, "rgb"))
        bounds = None if box is None else SimpleNamespace(box=box)
        state = SimpleNamespace(frame=frame, values=SimpleNamespace(bounds=bounds))
        check.on_frame_start(state)
        check.frame(state, None)
    return check.notes


HERE, BESIDE, LARGER = Box(100, 100, 180, 200), Box(200, 100, 280, 200), Box(80, 40, 200, 220)


def test_cut_that_the_objects_camera_knows_of_is_not_told():
    assert "frame 10" in told([HERE] * 20)[0]
    assert "frame 10" in told([None] * 20)[0]
    for other in (BESIDE, LARGER, None):
        assert told([HERE] * 10 + [other] * 10) == ()


@pytest.mark.slow
@pytest.mark.needs_gl
def test_run_tells_of_the_cut_and_of_the_ranges(tmp_path, capsys):
    shots.write_shot(tmp_path, 1, still=False)
    size = shots.WIDTH, shots.HEIGHT
    frames = [shots.plate() / 255] * 8 + [shots.plate(7)[:, ::-1] / 255] * 8
    takes.encode(tmp_path / "in.mp4", frames, size=size, crf=16, audio=False)
    words = [
        *(str(tmp_path / name) for name in ("in.mp4", "anim.glb", "out.mp4")),
        "--fit", str(tmp_path / "fit.json"), "--effects", "none", "--no-progress",
    ]  # fmt: skip
    assert main(words) == 0
    told = capsys.readouterr().err
    assert "frame 8: another shot begins" in told
    assert "--range 0:8 and --range 8:" in told
    assert main([*words, "--range", "0:8"]) == 0
    assert "another shot" not in capsys.readouterr().err
