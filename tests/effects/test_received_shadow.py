"""What moves in the plate casts its shadow on the object, where the sun is known."""

import math

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from support import shots, walking_card
from support.command import nlens

from nlens_video.core.layers import BlurredLayer, Box, DefocusedLayer, ObjectLayer
from nlens_video.core.settings import SunSettings
from nlens_video.effects.foreground.received_shadow import (
    GroundLight,
    Sunlight,
    all_toward_sun,
    attenuate,
    ground_light,
    receive_shadow,
    sun_share,
    sun_visibility,
    sunlit_fraction,
)
from nlens_video.effects.occlusion_cues import MovingThings, SeenBackground
from nlens_video.effects.shadow.apply import BlurredShadow
from nlens_video.graph.base.context import NodeContext, OcclusionSource, ShadowScene
from nlens_video.graph.base.object_source import RenderedObject
from nlens_video.graph.base.view import ScreenBounds, View
from nlens_video.graph.moving_foreground import find_moving_foreground
from nlens_video.graph.nodes.ground import BlurShadow, CompositeShadow, ShadowCasters, ShadowNode
from nlens_video.scene.illumination import Illumination, Lamp, hemispheres, sun
from nlens_video.scene.scene import Scene
from nlens_video.scene.scene_light import SceneLight
from nlens_video.video.pixels.picture import ArrayPicture

DOWN = np.array([0.0, -1.0, 0.0])
SUNS = [(120, 35), (-60, 40), (-130, 50)]


@pytest.fixture(scope="module")
def scene(tmp_path_factory):
    path = tmp_path_factory.mktemp("cube") / "a.glb"
    return Scene.load(shots.cube_glb(path, start=walking_card.PLACE, size=0.4, sun=False))


def front_of_the_cube():
    """Points (h, w, 3) of the side that the camera sees."""
    across, up = np.meshgrid(np.linspace(-0.19, 0.19, 30), np.linspace(0.01, 0.39, 30))
    return walking_card.PLACE + np.stack([across, up, np.full_like(up, 0.2)], axis=-1)


@pytest.mark.parametrize(("azimuth", "elevation"), SUNS)
def test_shadow_of_a_card_lies_on_the_object_where_its_rays_are_blocked(scene, azimuth, elevation):
    toward = walking_card.direction(azimuth, elevation)
    shown = list(walking_card.frames(toward))
    view = View(width=shots.WIDTH, height=shots.HEIGHT)
    moving, _ = find_moving_foreground(lambda *, sparse=False: iter(shown), scene, view, 0.0)
    points, camera, seen = front_of_the_cube(), shots.camera(), 0
    for frame in shown:
        things = moving.on_frame(frame.index)
        if not len(things.feet):
            continue
        feet, _ = camera.ground_seen_at(things.feet, 0.0)
        assert all_toward_sun(feet, walking_card.PLACE, toward)
        assert not all_toward_sun(feet, walking_card.PLACE, toward * (-1.0, 1.0, -1.0))
        ground = ground_light(frame.picture, things.background(frame.picture))
        left = sun_visibility(points, camera, 0.0, toward, ground, walking_card.LEFT)
        lit = 1.0 - walking_card.blocked(points, toward, frame.index)
        error = np.abs(left - lit).mean()  # ground that the card hides counts as lit
        assert error < 0.16
        if lit.mean() < 0.75:
            seen += 1
            assert error < (1.0 - lit).mean() / 3.0
    assert seen >= 2


def test_ground_is_known_as_far_as_the_object_casts_its_shadow_by_a_low_sun(scene):
    toward, camera = walking_card.direction(110, 25), shots.camera()
    shown = list(walking_card.frames(toward))
    view = View(width=shots.WIDTH, height=shots.HEIGHT)
    points, read_again = front_of_the_cube(), lambda *, sparse=False: iter(shown)
    low_sun = SceneLight(0, sun=SunSettings(azimuth_deg=110.0, elevation_deg=25.0))
    index, known = 26, []
    for light in (None, low_sun):
        moving, _ = find_moving_foreground(read_again, scene, view, 0.0, None, light)
        picture = shown[index].picture
        ground = ground_light(picture, moving.on_frame(index).background(picture))
        known.append(sun_visibility(points, camera, 0.0, toward, ground, walking_card.LEFT))
    lit = 1.0 - walking_card.blocked(points, toward, index)
    assert known[0] is None and lit.mean() < 0.75
    assert np.abs(known[1] - lit).mean() < (1.0 - lit).mean() / 3.0


def test_what_is_out_of_view_or_covered_tells_nothing():
    camera, toward = shots.camera(), walking_card.direction(120, 35)
    points = front_of_the_cube()
    small = GroundLight(box=Box(0, 0, 20, 20), ratio=np.ones((20, 20), np.float32))
    assert sun_visibility(points, camera, 0.0, toward, small, 0.4) is None
    whole = Box(0, 0, camera.width, camera.height)
    hidden = GroundLight(box=whole, ratio=np.full(whole.shape, np.nan, np.float32))
    assert (sun_visibility(points, camera, 0.0, toward, hidden, 0.4) == 1.0).all()


def test_grain_of_the_ground_is_no_shadow():
    camera, toward = shots.camera(), walking_card.direction(120, 35)
    box = Box(0, 0, camera.width, camera.height)
    plate = shots.plate() / 255.0
    codes = 255.0 * plate + np.random.default_rng(0).normal(0.0, 2.0, plate.shape)
    picture = ArrayPicture(np.uint8(np.clip(codes, 0, 255)), "rgb")
    clean = ArrayPicture(shots.plate(), "rgb").linear(box)
    ground = ground_light(picture, SeenBackground(box=box, light=clean))
    left = sun_visibility(front_of_the_cube(), camera, 0.0, toward, ground, 0.4)
    assert left.mean() > 0.98


def test_share_of_the_sun_is_none_on_its_far_side_and_all_where_nothing_else_shines():
    lamp = Lamp(sun(np.full(3, 2.0), DOWN))
    points = np.zeros((1, 3, 3))
    unit = np.array([[[0.0, 1.0, 0.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]]])
    alone = sun_share(Illumination((lamp,), None), lamp, points, unit)
    np.testing.assert_allclose(alone[0, :, 0], [1.0, 0.0, 0.0])
    around = Illumination((lamp,), hemispheres(np.ones(3), np.ones(3)))
    np.testing.assert_allclose(
        sun_share(around, lamp, points, unit)[0, 0], 2.0 / (2.0 + math.pi), rtol=1e-6
    )


def layer_of(points_depth, box):
    rgba = np.ones((*box.shape, 4), np.float32)
    return ObjectLayer(box=box, rgba=rgba, depth=np.full(box.shape, points_depth, np.float32))


def test_lost_light_is_as_soft_as_the_discs_and_leaves_coverage():
    box = Box(10, 10, 50, 50)
    layer = layer_of(2.0, box)
    defocused = DefocusedLayer(layer=layer, coc_px=np.full(box.shape, 12.0, np.float32))
    wide = box.expanded(6)
    blurred = BlurredLayer(box=wide, rgba=np.ones((*wide.shape, 4), np.float32))
    lost = np.zeros((*box.shape, 3))
    lost[:, 20:] = 0.6
    out = attenuate(blurred, defocused, lost).rgba
    np.testing.assert_array_equal(out[..., 3], 1.0)
    middle = out[26, :, 0]
    assert middle[0] == pytest.approx(1.0, abs=1e-3) and middle[-1] == pytest.approx(0.4, abs=1e-3)
    assert (np.diff(middle) <= 1e-6).all()
    assert 4 < ((middle > 0.5) & (middle < 0.9)).sum() < 14


def test_nothing_is_shaded_by_what_stands_on_the_far_side_or_without_things():
    camera, box = shots.camera(), Box(200, 100, 240, 140)
    layer = layer_of(2.2, box)
    defocused = DefocusedLayer(layer=layer, coc_px=np.zeros(box.shape, np.float32))
    blurred = BlurredLayer(box=box, rgba=layer.rgba)
    picture = ArrayPicture(shots.plate(), "rgb")
    lamp = Lamp(sun(np.full(3, 3.0), -walking_card.direction(120, 35)))
    light = Illumination((lamp,), hemispheres(np.ones(3), np.ones(3)))
    known = Sunlight.known(lamp, light, light, walking_card.PLACE)
    behind = view_of(walking_card.PLACE - 0.5 * walking_card.direction(120, 0), camera)
    for feet in (np.empty((0, 2)), behind):
        things = MovingThings(
            lambda *given: None, feet, lambda seen: pytest.fail("nothing has to be looked at")
        )
        out = receive_shadow(blurred, defocused, picture, things, camera, walking_card.PLACE, known)
        assert out is blurred


def view_of(point, camera):
    return camera.pixels(camera.to_camera(point[None]))


def test_only_a_known_sun_that_shows_casts_one():
    light = hemispheres(np.ones(3), np.ones(3))
    high, low = (Lamp(sun(np.full(3, 3.0), -walking_card.direction(60, up))) for up in (40, 3))
    faint = Lamp(sun(np.full(3, 0.05), DOWN))
    for lamp, cast in ((high, True), (low, False), (faint, False), (None, False)):
        both = Illumination(() if lamp is None else (lamp,), light)
        assert (Sunlight.known(lamp, both, both, np.zeros(3)) is not None) == cast


def test_the_known_sun_is_the_files_or_the_options_and_never_a_guess():
    camera = shots.camera()
    files = (sun(np.full(3, 4.0), DOWN),)
    guess = Illumination.plausible()
    assert SceneLight(0).known_sun(guess, camera, ()) is None
    light = SceneLight(1).on_object(files)
    assert SceneLight(1).known_sun(light, camera, files).posed is files[0]
    given_sun = SceneLight(0, sun=SunSettings(azimuth_deg=90.0, elevation_deg=40.0))
    lamp = Lamp(sun(np.full(3, 4.0), -walking_card.direction(90, 40)))
    found = given_sun.known_sun(Illumination((lamp,), None), camera, files)
    assert found is lamp
    assert given_sun.known_sun(guess, camera, files) is None


SHARES = st.floats(0.0, 1.0)


@given(st.floats(0.1, 0.9), st.floats(0.0, 0.9), SHARES, SHARES)
def test_ground_loses_the_sun_once_by_two_shadows(in_shadow, sun, own, around):
    lit = in_shadow + (1.0 - in_shadow) * sun  # of the ground's light, as the plate shows it
    in_sun = (1.0 - in_shadow) * own + in_shadow * around
    box, size = Box(0, 0, 4, 3), (3, 4)
    ground = GroundLight(box=box, ratio=np.full(size, lit, np.float32))
    shadows = [
        BlurredShadow(box=box, loss=np.full((*size, 4), loss, np.float32))
        for loss in (in_sun, around)
    ]
    part = sunlit_fraction(ground, in_shadow)
    loss = shadows[0].mixed(shadows[1], box, part).loss
    known = in_shadow * (1.0 - around) + (1.0 - in_shadow) * sun * (1.0 - own)
    assert lit > 0.93 or lit * (1.0 - loss) == pytest.approx(known, abs=1e-5)


def test_shadows_that_are_mixed_stay_as_they_are_where_the_ground_is_not_known():
    own = BlurredShadow(box=Box(2, 2, 6, 6), loss=np.full((4, 4, 4), 0.5, np.float32))
    part = np.zeros((3, 3), np.float32)
    for other in (None, BlurredShadow(box=Box(0, 0, 4, 4), loss=np.zeros((4, 4, 4), np.float32))):
        found = own.mixed(other, Box(4, 4, 7, 7), part)
        there = found.loss[Box(2, 2, 6, 6).slices_in(found.box)]
        assert (there[2:, 2:] == 0.0).all() and (there[:2] == 0.5).all()


def own_shadow(points, toward):
    """Whether points (h, w, 3) of the ground lie in the cube's shadow."""
    half = np.array([0.2, 0.2, 0.2])
    middle = walking_card.PLACE + (0.0, 0.2, 0.0)
    ways = np.sort([(middle - half - points) / toward, (middle + half - points) / toward], axis=0)
    return ways[0].max(axis=-1) < ways[1].min(axis=-1)


def test_ground_in_the_objects_shadow_is_as_dark_in_the_cards_too(scene):
    toward, camera, index = walking_card.direction(120, 35), shots.camera(), 20
    frame = Box(0, 0, camera.width, camera.height)
    view = View(width=shots.WIDTH, height=shots.HEIGHT)
    context = NodeContext(
        objects=RenderedObject(scene=scene, renderer=None, view=view), estimate_coc=None,
        ground_y=0.0, fallback_constant=False, pixel_aspect=1.0,
        shadow_scene=ShadowScene(
            pose=scene.pose, pre_rendered=False, strength=1.0,
            light=SceneLight(0, sun=SunSettings(azimuth_deg=120.0, elevation_deg=35.0)),
        ),
        occlusion=OcclusionSource("", lambda frame, picture, plate_coc: None),
    )  # fmt: skip
    level, share = 0.5 * math.pi, 1.0 - walking_card.LEFT
    lamp = Lamp(sun(np.full(3, share * level / toward[1]), -toward))
    around = np.full(3, walking_card.LEFT * level / math.pi)
    light = Illumination((lamp,), hemispheres(around, around))
    bounds = ScreenBounds(
        time_s=0.0, camera=camera, box=frame, nearest=1.0, farthest=9.0, plate_light=light
    )
    casters = ShadowCasters(context)(bounds, None, None)
    shadow = ShadowNode(context)(casters, None, None)
    clean = ArrayPicture(shots.plate(), "rgb").linear(frame)
    things = MovingThings(
        lambda *given: None,
        np.array([[320.0, 200.0]]),
        lambda seen: SeenBackground(box=frame, light=clean),
    )
    blur, composite, light_of = BlurShadow(context), CompositeShadow(context), []
    for codes in (shots.plate(), walking_card.codes(toward, index)):
        picture = ArrayPicture(codes, "rgb")
        composite(picture, blur(picture, shadow, frame, None, things))
        light_of.append(picture.linear(frame).sum(axis=-1))
    ground = camera.plane_points(0.0)
    both = own_shadow(ground, toward) & walking_card.blocked(ground, toward, index)
    there = cv2.erode(np.uint8(both), np.ones((5, 5))) > 0
    assert there.sum() > 100
    alone, together = (float(np.median((one / clean.sum(axis=-1))[there])) for one in light_of)
    assert alone < 0.35 and together == pytest.approx(alone, rel=0.1)


@pytest.mark.slow
@pytest.mark.needs_gl
def test_command_shades_the_object_under_a_sun_that_is_given(tmp_path):
    toward = walking_card.direction(120, 35)
    for index in range(walking_card.FRAMES):
        shots.write_png(tmp_path / f"in_{index:03d}.png", walking_card.codes(toward, index))
    shots.cube_glb(tmp_path / "a.glb", start=walking_card.PLACE, size=0.4, sun=False)
    shots.fit_json(tmp_path / "fit.json")

    def composited(name, *more):
        words = [tmp_path / "in_%03d.png", tmp_path / "a.glb", tmp_path / f"{name}_%03d.png"]
        asked = ["--input-rate", walking_card.RATE, "--fit", tmp_path / "fit.json", "-q", "-y"]
        assert nlens(*words, *asked, "--sun", "120,35", *more).returncode == 0
        return [
            cv2.imread(str(tmp_path / f"{name}_{index:03d}.png")).astype(int)
            for index in range(walking_card.FRAMES)
        ]

    shadowed, plain = composited("on"), composited("off", "--occlusion", "none")
    view = shots.camera()
    points = front_of_the_cube()[4:-4:8, 4:-4:8].reshape(-1, 3)
    places = np.round(view.pixels(view.to_camera(points)) - 0.5).astype(int)
    darker, same = [], []
    for index, (now, without) in enumerate(zip(shadowed, plain, strict=True)):
        here = walking_card.blocked(points, toward, index)
        for (column, row), dark in zip(places, here, strict=True):
            ratio = now[row, column].sum() / max(1, without[row, column].sum())
            (darker if dark else same).append(ratio)
    assert np.median(darker) < 0.85
    assert np.median(same) == pytest.approx(1.0, abs=0.02)
