"""What the studio draws is what a run renders; its frames are the plate's."""

import copy
import json

import av
import cv2
import numpy as np
import pytest
from msgspec.structs import replace
from support import shots
from support.clips import trim, write_clip
from support.command import nlens
from support.studio import TABLES, write_shot

from nlens_video.cli.solve_command import camera_and_lines
from nlens_video.core.color import transfer
from nlens_video.core.errors import InputError, UsageError
from nlens_video.core.layers import Box
from nlens_video.core.lens_fit import LensFit
from nlens_video.core.settings import SourceSettings
from nlens_video.stages.r_lens_track import FitTrack, Keyframe
from nlens_video.studio.plate_frames import PlateFrames, to_jpeg
from nlens_video.studio.shot_state import ShotState
from nlens_video.studio.stage import Stage
from nlens_video.video.named_files import ImageSequence

pytestmark = pytest.mark.slow


@pytest.fixture
def stage():
    made = Stage(camera_and_lines)
    yield made
    made.close()


@pytest.mark.parametrize("preset", ["draft", "standard"])
@pytest.mark.parametrize("fit", [True, False])
def test_picture_at_rest_is_the_one_that_a_run_renders(tmp_path, stage, preset, fit):
    shots.write_png(tmp_path / "in.png")
    shots.cube_glb(tmp_path / "bare.glb", camera=False, sun=False)
    shots.fit_json(tmp_path / "fit.json")
    tables = copy.deepcopy(TABLES) | {"plate": {"file": "in.png"}, "output": {"file": "out.png"}}
    tables["quality"] = {"preset": preset}
    tables["effects"] = {"effects": "auto"}
    if not fit:
        tables["lens"] = {"fallback": "constant"}
    state = ShotState(tmp_path / "shot.toml", tables)
    for x, azimuth in ((0.7, -60), (0.4, 60)):  # the second is drawn with what is kept of the first
        tables["place"]["at"] = [x, 0.8]
        tables["light"] = {"sun": [azimuth, 40, 2]}
        drawn = stage.draw(state.settings(tables), 0)
    assert any("--sun 60,40,2" in note for note in drawn.notes)
    state.save(tables)
    assert nlens(state.path, "--no-progress", "-q", "-y").returncode == 0
    rendered = cv2.imread(str(tmp_path / "out.png"))[..., ::-1]
    levels = np.round(255.0 * drawn.picture.srgb()).astype(np.uint8)
    np.testing.assert_array_equal(levels, rendered)


def test_lens_of_a_saved_track_is_drawn_as_a_run_renders_it(tmp_path, stage):
    shots.cube_glb(tmp_path / "bare.glb", camera=False, sun=False)
    for index in range(3):
        shots.write_png(tmp_path / f"in_{index}.png")
    lens = LensFit.load(shots.fit_json(tmp_path / "fit.json"))
    keys = (Keyframe(0, 0, lens), Keyframe(2, 0, replace(lens, intercept=2 * shots.INTERCEPT)))
    (tmp_path / "fit.json").write_text(FitTrack(keys, 1.0).to_json())
    tables = copy.deepcopy(TABLES) | {"plate": {"file": "in_%d.png"}, "light": {"sun": [60, 40, 2]}}
    tables |= {"effects": {"effects": "defocus"}, "quality": {"preset": "realtime"}}
    tables["output"] = {"file": "out.png"}
    state = ShotState(tmp_path / "shot.toml", tables)
    for index in (0, 2):  # the second one is drawn with what is kept of the first
        drawn = stage.draw(state.settings(tables), index).picture.srgb()
    state.save(tables)
    assert nlens(state.path, "--frame", "2", "-q", "-y").returncode == 0
    rendered = cv2.imread(str(tmp_path / "out.png"))[..., ::-1]
    np.testing.assert_array_equal(np.round(255.0 * drawn).astype(np.uint8), rendered)


def test_several_objects_with_keys_are_drawn_as_a_run_renders_them(tmp_path, stage):
    shot = write_shot(tmp_path)
    keys = [{"frame": 0, "at": [0.2, 0.75]}, {"frame": 3, "at": [0.6, 0.9]}]
    tables = {name: table for name, table in copy.deepcopy(TABLES).items() if name != "place"}
    other = {"file": "bare.glb", "size": 0.2, "key": keys}
    tables["object"] = [{"file": "bare.glb", "at": [0.4, 0.8], "size": 0.3}, other]
    tables["output"] = {"file": "out.mkv", "codec": "ffv1"}
    state = ShotState(shot, tables)
    for x in (0.9, 0.6):  # the second one is drawn with what is kept of the first
        keys[1]["at"] = [x, 0.9]
        drawn = stage.draw(state.settings(tables), 2)
    state.save(tables)
    assert nlens(shot, "--frame", "2", "-q", "-y").returncode == 0
    frames = PlateFrames(SourceSettings(spec=str(tmp_path / "out.mkv")), 1 << 30)
    rendered = frames.frame(0).picture.srgb()
    frames.close()
    np.testing.assert_allclose(drawn.picture.srgb(), rendered, atol=1e-6)
    quick = stage.draw(state.settings(tables), 2, "drag")
    assert quick.guides == drawn.guides
    assert len(drawn.guides.objects[1].stops) == 2


def test_dragged_picture_shows_the_object_where_the_one_at_rest_does(tmp_path, stage):
    shot = write_shot(tmp_path)
    tables = copy.deepcopy(TABLES)
    tables["lens"] = {"fallback": "constant"}
    state = ShotState(shot, tables)
    stage.draw(state.settings(tables), 1)
    tables["place"].update(at=[0.6, 0.7], yaw=40)
    quick, rest = (stage.draw(state.settings(tables), 1, kind) for kind in ("drag", "rest"))
    assert quick.guides == rest.guides
    apart = np.abs(quick.picture.srgb() - rest.picture.srgb()).max(axis=2)
    assert np.quantile(apart, 0.99) < 0.1


def test_picture_of_a_moving_sun_has_its_shadow_and_guides(tmp_path, stage):
    tables = copy.deepcopy(TABLES) | {"effects": {"effects": "shadow"}, "light": {}}
    tables["quality"] = {"preset": "standard"}
    state = ShotState(write_shot(tmp_path), tables)
    for azimuth in (-60, 70):  # the second is drawn with the light that is kept of the first
        tables["light"]["sun"] = [azimuth, 30, 2]
        quick, rest = (stage.draw(state.settings(tables), 0, kind) for kind in ("light", "rest"))
        assert quick.guides == rest.guides
        apart = np.abs(quick.picture.srgb() - rest.picture.srgb()).max(axis=2)
        assert np.quantile(apart, 0.99) < 0.1
    bare = stage.draw(state.settings(tables | {"effects": {"effects": "none"}}), 0)
    shaded = bare.picture.srgb().mean(axis=2) - quick.picture.srgb().mean(axis=2) > 0.05
    (one,) = rest.guides.objects
    seen, body = np.array(one.shadow.seen), np.array(one.shadow.body)

    def spots(points):
        across, down, away = seen @ np.column_stack([points, np.ones(len(points))]).T
        assert (away > 0).all()
        return np.column_stack([across, down]) / away[:, None]

    np.testing.assert_allclose(spots(np.zeros((1, 3)))[0], one.at, atol=1e-6)
    corners = spots(body)
    np.testing.assert_allclose([*corners.min(axis=0), *corners.max(axis=0)], one.outline, atol=1e-3)
    # what is drawn darker lies in the outline of the shadow
    a, h = np.radians([70, 30])
    toward = np.array([np.cos(h) * np.sin(a), np.sin(h), np.cos(h) * np.cos(a)])
    cast = spots(body - body[:, 1:2] / toward[1] * toward)
    outline = cv2.convexHull(np.float32(cast * quick.picture.srgb().shape[1::-1]))
    inside = cv2.fillPoly(np.zeros(shaded.shape, np.uint8), [np.int32(outline)], 1) > 0
    assert shaded.sum() > 100
    assert (shaded & inside).sum() > 0.9 * shaded.sum()


def test_black_beginning_of_a_shot_is_drawn_as_a_run_renders_it(tmp_path, stage):
    shots.cube_glb(tmp_path / "bare.glb", camera=False, sun=False)
    shots.fit_json(tmp_path / "fit.json")
    for index, rgb in enumerate((np.zeros_like(shots.plate()), shots.plate(), shots.plate())):
        shots.write_png(tmp_path / f"in_{index}.png", rgb)
    tables = copy.deepcopy(TABLES) | {"plate": {"file": "in_%d.png"}, "light": {"sun": [60, 40, 2]}}
    tables |= {"effects": {"effects": "defocus,exposure"}, "quality": {"preset": "realtime"}}
    tables["output"] = {"file": "out.png"}
    state = ShotState(tmp_path / "shot.toml", tables)
    drawn = stage.draw(state.settings(tables), 0).picture.srgb()
    state.save(tables)
    assert nlens(state.path, "--frame", "0", "-q", "-y").returncode == 0
    rendered = cv2.imread(str(tmp_path / "out.png"))[..., ::-1]
    np.testing.assert_array_equal(np.round(255.0 * drawn).astype(np.uint8), rendered)


def test_white_lines_enclose_the_ground_that_is_in_focus(tmp_path, stage):
    """Disparity grows evenly from the horizon down, so the lens tells the rows."""
    state = ShotState(write_shot(tmp_path), TABLES)
    horizon, focus_row, slope = TABLES["camera"]["horizon"], 0.7, 30.0
    ground = stage.inspect(state.settings(TABLES)).ground
    nearest = float(ground.disparity[-1].mean())
    given = json.loads((tmp_path / "fit.json").read_text()) | {
        "slope": slope, "intercept": -slope * nearest * (focus_row - horizon) / (1.0 - horizon),
    }  # fmt: skip
    (tmp_path / "lens.json").write_text(json.dumps(given))
    lens = {"lens": {"fit": "lens.json"}}
    data, said = stage.inspect(state.settings(TABLES | lens)).drawn()
    assert "in focus" in said["lens"]
    levels = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
    rows = np.flatnonzero(levels.min(axis=2).mean(axis=1) > 200) / levels.shape[0]
    half = (1.0 - horizon) / (slope * nearest)  # of the band: a CoC of a pixel
    assert rows.min() == pytest.approx(focus_row - half, abs=0.015)
    assert rows.max() == pytest.approx(focus_row + half, abs=0.015)


def test_lens_that_is_held_while_dragging_is_that_of_the_new_place(tmp_path, stage):
    """The unit of the object's world changes with its place; the blur of the plate does not."""
    shot = write_shot(tmp_path)
    tables = copy.deepcopy(TABLES)
    tables["lens"] = {"lens": "50mm f/1.8 focus 2m"}
    state = ShotState(shot, tables)
    before = stage.draw(state.settings(tables), 0)
    tables["place"].update(at=[0.4, 0.72], size=0.2)
    held = stage.draw(state.settings(tables), 0, "drag").fit
    found = stage.draw(state.settings(tables), 0).fit
    assert held.slope > 1.2 * before.fit.slope
    assert held.slope == pytest.approx(found.slope, rel=0.05)
    assert held.intercept == pytest.approx(found.intercept, rel=0.05)


def test_frames_are_those_of_the_plate_in_any_order(tmp_path):
    path = shots.write_video(tmp_path / "in.mp4", frames=70, group=10, audio=False)
    source = SourceSettings(spec=str(path))
    frames = PlateFrames(source)
    told = {index: frames.frame(index).picture.srgb() for index in (60, 3, 69, 0, 61, 4)}
    frames.close()
    again = PlateFrames(source)
    for index in sorted(told):
        np.testing.assert_array_equal(told[index], again.frame(index).picture.srgb())
    assert again.count() == 70
    with pytest.raises(InputError, match="has no frame 70"):
        again.frame(70)
    again.close()


@pytest.mark.parametrize("name", ["in.mkv", "in.webm"])
def test_frames_are_counted_where_the_sound_is_longer_and_no_header_tells(tmp_path, name):
    picture = av.VideoFrame.from_ndarray(shots.plate(), "rgb24")
    frames = [picture.reformat(format="yuv420p") for _ in range(6)]
    codec = {"in.webm": "libvpx"}.get(name, "libx264")
    sound = "libopus" if codec == "libvpx" else True
    path = write_clip(tmp_path / name, frames, codec=codec, audio=sound)
    source = SourceSettings(spec=str(path))
    plate = PlateFrames(source)
    assert plate.count() == 6
    assert plate.frame(5).index == 5
    with pytest.raises(InputError, match="has no frame 6"):
        plate.frame(6)
    plate.close()


def test_frames_that_an_edit_list_leaves_out_do_not_count(tmp_path):
    whole = shots.write_video(tmp_path / "whole.mp4", frames=24, audio=False)
    plate = PlateFrames(SourceSettings(spec=str(trim(whole, tmp_path / "in.mp4", 16))))
    assert plate.count() == 8
    assert plate.frame(7).index == 7
    plate.close()


def test_large_plate_is_reduced(tmp_path):
    large = cv2.resize(shots.plate(), (3840, 2048))
    shots.write_png(tmp_path / "in.png", large)
    frames = PlateFrames(SourceSettings(spec=str(tmp_path / "in.png")), 960 * 544)
    assert frames.reduced
    assert frames.frame(0).picture.width == frames.size[0] <= 1012
    assert frames.size[0] / frames.size[1] == pytest.approx(3840 / 2048, rel=0.002)
    frames.close()


@pytest.mark.parametrize("wide", [640, 2560])  # the second is reduced
def test_browser_gets_the_codes_of_a_video_and_light_by_its_curve(tmp_path, wide):
    levels = np.linspace(0.0, 255.0, wide).astype(np.uint8)
    grey = av.VideoFrame.from_ndarray(np.tile(levels[None, :, None], (720, 1, 3)), "rgb24")
    grey = grey.reformat(format="yuv444p", dst_colorspace="ITU709")
    grey.colorspace, grey.color_range, grey.color_trc, grey.color_primaries = 1, 1, 1, 1
    write_clip(tmp_path / "in.mkv", [grey])
    frames = PlateFrames(SourceSettings(spec=str(tmp_path / "in.mkv")), 960 * 544)
    picture = frames.frame(0).picture
    assert frames.reduced == (wide > 960)
    at = np.linspace(0.1, 0.9, 9)
    shown = cv2.imdecode(np.frombuffer(to_jpeg(picture, 100), np.uint8), cv2.IMREAD_COLOR)
    columns = (at * picture.width).astype(int)
    np.testing.assert_allclose(shown[200, columns], np.tile(255 * at[:, None], 3), atol=2.5)
    light = picture.linear(Box(0, 0, picture.width, picture.height))[200, columns, 1]
    np.testing.assert_allclose(light, transfer("bt709").to_linear(at), atol=0.015)
    frames.close()


def test_a_stream_has_no_frames_on_demand():
    with pytest.raises(UsageError, match="needs a plate in files"):
        PlateFrames(SourceSettings(spec="-"))


@pytest.mark.parametrize(
    ("plate", "result"),
    [("take 100%.mp4", "take 100%-composite.mp4"), ("pl.%04d.png", "pl-composite.%04d.png"),
     ("%03d.png", "shot-composite.%03d.png")],
)  # fmt: skip
def test_result_that_is_proposed_can_be_rendered(tmp_path, plate, result):
    if plate.endswith(".mp4"):
        shots.write_video(tmp_path / plate, frames=2)
    else:
        for number in (7, 8):
            shots.write_png(ImageSequence(str(tmp_path / plate)).path(number))
    shots.cube_glb(tmp_path / "bare.glb", camera=False, sun=False)
    shots.fit_json(tmp_path / "fit.json")
    shot = tmp_path / "shot.toml"
    state = ShotState.opened(shot, str(tmp_path / plate), tmp_path / "bare.glb")
    assert state.tables["output"]["file"] == result
    place, quality = {"at": [0.4, 0.8], "size": 0.3}, {"preset": "draft"}
    more = {"place": place, "camera": TABLES["camera"], "lens": TABLES["lens"]}
    state.save(state.tables | more | {"quality": quality})
    assert nlens(shot, "--no-progress", "-q").returncode == 0
    written = [one for one in tmp_path.iterdir() if "-composite" in one.name]
    assert sorted(written) == (
        [tmp_path / result] if plate.endswith(".mp4")
        else [ImageSequence(str(tmp_path / result)).path(number) for number in (7, 8)]
    )  # fmt: skip


def test_saving_keeps_what_a_person_wrote_beside_it(tmp_path):
    shot = write_shot(tmp_path, frames=1)
    shot.write_text("# the corner\n" + shot.read_text().replace("size = 0.3", "size = 0.3  # sic"))
    state = ShotState.opened(shot, None, None)
    tables = copy.deepcopy(state.tables)
    tables["place"]["at"] = [0.1, 0.9]
    del tables["camera"]
    tables["light"] = {"sun": [60, 40, 2]}
    state.save(tables)
    text = shot.read_text()
    assert text.startswith("# the corner\n")
    assert "size = 0.3  # sic" in text
    assert "[camera]" not in text
    assert ShotState.opened(shot, None, None).tables == tables
