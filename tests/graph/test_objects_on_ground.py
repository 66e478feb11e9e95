"""Several objects and keyed ones: where the frame shows them, how large and how turned."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace
from scipy.spatial.transform import Rotation
from support import shots

from nlens_video.cameras.placement import contact_point
from nlens_video.cameras.solved import CameraKey, SolvedCamera
from nlens_video.core.errors import SceneError, UsageError
from nlens_video.core.objects import FurtherObject, PlaceKey, PlaceKeys
from nlens_video.core.placement import GroundPlacing, Placement
from nlens_video.core.settings import ObjectSettings
from nlens_video.graph.base.objects_on_ground import load_scene, stage
from nlens_video.graph.base.view import View

WIDTH, HEIGHT = 640, 360
FPS = 25.0


def pose_key(index, pitch=-18.0, yaw=0.0, roll=0.0, eye=(0.0, 1.6, 0.0)):
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_euler("YXZ", [yaw, pitch, roll], degrees=True).as_matrix()
    pose[:3, 3] = eye
    return CameraKey(
        index=index, pts_s=index / FPS, world_to_camera=np.linalg.inv(pose), fov_x_deg=50.0
    )


def still(index=0, **named):
    return SolvedCamera(width=WIDTH, height=HEIGHT, keys=(pose_key(index),), **named)


def moving():
    """A camera that walks ahead and turns over two seconds, a key for each frame."""
    keys = tuple(
        pose_key(
            index, pitch=-18.0 - 0.1 * index, yaw=0.4 * index, roll=0.02 * index,
            eye=(0.01 * index, 1.6, -0.012 * index),
        )
        for index in range(51)
    )  # fmt: skip
    return SolvedCamera(width=WIDTH, height=HEIGHT, keys=keys)


CAMERAS = {"still": still(), "moving": moving(), "under a horizon": None}


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """Cubes that lie anywhere in their files, and one with a camera."""
    folder = tmp_path_factory.mktemp("objects")
    shots.cube_glb(folder / "a.glb", camera=False, sun=False, start=(0.3, 0.2, -1.0))
    shots.cube_glb(folder / "b.glb", camera=False, sun=False, start=(7.0, -3.0, 9.0), size=12.0)
    shots.cube_glb(folder / "cam.glb", sun=False)
    return folder


def staged(objects, camera=None):
    if camera is None and objects.on_ground is not None:
        wish = objects.on_ground
        placing = Placement(at=wish.at, size=wish.size, yaw_deg=wish.yaw_deg, horizon=0.2)
        objects = replace(objects, placing=placing, on_ground=None)
    view = View(width=WIDTH, height=HEIGHT, solved=camera, frame_s=1 / FPS)
    return stage(objects, load_scene(objects), view)


def seen(result, number, time_s):
    """Column and row of the contact point of an object, and its size, all by the frame."""
    camera = result.view.camera_at(result.scene, time_s)
    part = result.scene.parts[number]
    own = result.scene.only(number).pose(0.0).vertices()
    world = np.eye(4) if part.motion is None else part.motion.at(time_s)

    def pixels(points):
        points = np.atleast_2d(points) @ world[:3, :3].T + world[:3, 3]
        return camera.pixels(camera.to_camera(points.astype(np.float64)))

    foot = pixels(contact_point(own))[0]
    return foot[0] / WIDTH, foot[1] / HEIGHT, (foot[1] - pixels(own)[:, 1].min()) / HEIGHT


def objects_of(files, *, keys=(), others=(), wish=None, **named):
    return ObjectSettings(
        glb=files / "a.glb",
        on_ground=wish or GroundPlacing(at=(0.4, 0.8), size=0.3),
        keys=PlaceKeys(keys=keys),
        others=others,
        **named,
    )


@pytest.mark.parametrize("camera", CAMERAS.values(), ids=CAMERAS)
@settings(max_examples=15, deadline=None)
@given(x=st.floats(0.1, 0.9), y=st.floats(0.55, 0.95), size=st.floats(0.05, 0.4),
       yaw=st.floats(-400.0, 400.0))  # fmt: skip
def test_second_object_stands_where_it_is_placed_and_is_as_large(files, camera, x, y, size, yaw):
    wish = GroundPlacing(at=(x, y), size=size, yaw_deg=yaw)
    other = FurtherObject(glb=files / "b.glb", placing=wish)
    result = staged(objects_of(files, others=(other,)), camera)
    assert seen(result, 0, 0.0) == pytest.approx((0.4, 0.8, 0.3), abs=1e-5)
    assert seen(result, 1, 0.0) == pytest.approx((x, y, size), abs=1e-5)


@pytest.mark.parametrize("camera", CAMERAS.values(), ids=CAMERAS)
def test_keyed_object_is_at_its_keys_as_the_camera_of_that_moment_sees_them(files, camera):
    keys = (
        PlaceKey(time_s=0.2, at=(0.2, 0.7), size=0.2),
        PlaceKey(time_s=1.0, at=(0.6, 0.9), yaw_deg=45.0),
        PlaceKey(time_s=1.6, at=(0.8, 0.65), size=0.25),
    )
    first = objects_of(files, keys=keys, wish=GroundPlacing(at=(0.2, 0.7), size=0.2, yaw_deg=45.0))
    other = FurtherObject(glb=files / "b.glb", placing=GroundPlacing(), keys=PlaceKeys(keys=keys))
    for number, result in (
        (0, staged(first, camera)),
        (1, staged(objects_of(files, others=(other,)), camera)),
    ):
        assert seen(result, number, 0.2) == pytest.approx((0.2, 0.7, 0.2), abs=1e-5)
        assert seen(result, number, 1.0)[:2] == pytest.approx((0.6, 0.9), abs=1e-5)
        assert seen(result, number, 1.6) == pytest.approx((0.8, 0.65, 0.25), abs=1e-5)
        at_rest = [result.scene.parts[number].motion.at(t) for t in (0.0, 0.2, 1.6, 9.0)]
        np.testing.assert_array_equal(at_rest[0], at_rest[1])
        np.testing.assert_array_equal(at_rest[2], at_rest[3])


def test_linear_path_is_straight_on_the_ground_and_of_constant_speed(files):
    keys = PlaceKeys(
        keys=(PlaceKey(time_s=0.0, at=(0.2, 0.6)), PlaceKey(time_s=2.0, at=(0.8, 0.9))),
        interpolation="linear",
    )
    wish = GroundPlacing(at=(0.2, 0.6), size=0.3)
    result = staged(replace(objects_of(files, wish=wish), keys=keys), still())
    motion = result.scene.parts[0].motion
    places = np.array([motion.place_at(t) for t in np.linspace(0.0, 2.0, 9)])
    np.testing.assert_allclose(np.diff(places, axis=0), [places[1] - places[0]] * 8, atol=1e-9)
    np.testing.assert_allclose(places[:, 1], result.objects.ground_y, atol=1e-9)
    # nearer by the same ground, so larger in the frame, though it stays as large as it is
    assert seen(result, 0, 2.0)[2] > 1.4 * seen(result, 0, 0.0)[2]


def test_keyed_object_faces_the_camera_of_that_moment_where_it_is_not_turned(files):
    keys = (PlaceKey(time_s=0.0, yaw_deg=0.0), PlaceKey(time_s=2.0, yaw_deg=0.0))
    result = staged(objects_of(files, keys=keys), moving())
    for time_s in (0.0, 2.0):
        front = result.scene.parts[0].motion.turned_at(time_s)[:, 2]
        pose = result.view.camera_at(result.scene, time_s).world_from_camera
        back = pose[:3, 2] * (1.0, 0.0, 1.0)
        assert front @ back / np.linalg.norm(back) == pytest.approx(1.0, abs=1e-9)


def test_object_turns_as_often_as_its_keys_say(files):
    keys = (PlaceKey(time_s=0.0, yaw_deg=0.0), PlaceKey(time_s=2.0, yaw_deg=720.0))
    motion = staged(objects_of(files, keys=keys), still()).scene.parts[0].motion
    assert motion.turn.at(1.0)[0] - motion.turn.at(0.0)[0] == pytest.approx(2.0 * np.pi)


@pytest.mark.parametrize("camera", [moving(), still(), still(index=25), still(index=30)])
def test_frames_and_seconds_name_the_same_moment(files, camera):
    """A still camera's one key is that of the first frame that is rendered."""

    def at(**when):
        keys = (PlaceKey(**{name: 0 for name in when}, at=(0.2, 0.7)),
                PlaceKey(**when, at=(0.7, 0.8)))  # fmt: skip
        return staged(objects_of(files, keys=keys), camera).scene.parts[0].motion

    by_time, by_frame = at(time_s=30 / FPS), at(frame=30)
    np.testing.assert_array_equal(by_time.at(0.71), by_frame.at(0.71))


def test_order_of_objects_changes_nothing_that_the_frame_shows(files):
    keys = PlaceKeys(
        keys=(
            PlaceKey(time_s=0.1, at=(0.2, 0.7)),
            PlaceKey(time_s=0.9, at=(0.7, 0.8)),
            PlaceKey(time_s=1.5, at=(0.5, 0.95)),
        )
    )
    fixed = GroundPlacing(at=(0.5, 0.75), size=0.25, yaw_deg=33.0)
    one = staged(
        ObjectSettings(
            glb=files / "a.glb", on_ground=fixed,
            others=(
                FurtherObject(glb=files / "b.glb", placing=GroundPlacing(size=0.2), keys=keys),
            ),
        ),
        moving(),
    )  # fmt: skip
    other = staged(
        ObjectSettings(
            glb=files / "b.glb", on_ground=GroundPlacing(at=(0.2, 0.7), size=0.2), keys=keys,
            others=(FurtherObject(glb=files / "a.glb", placing=fixed),),
        ),
        moving(),
    )  # fmt: skip
    for time_s in (0.0, 0.4, 1.1, 1.9):
        assert seen(one, 0, time_s) == pytest.approx(seen(other, 1, time_s), abs=1e-5)
        assert seen(one, 1, time_s) == pytest.approx(seen(other, 0, time_s), abs=1e-5)


def test_object_beside_one_whose_file_has_the_camera_stands_on_its_ground(files):
    objects = ObjectSettings(
        glb=files / "cam.glb",
        others=(
            FurtherObject(glb=files / "b.glb", placing=GroundPlacing(at=(0.3, 0.8), size=0.2)),
            FurtherObject(glb=files / "a.glb"),
        ),
    )
    result = staged(objects)
    assert seen(result, 1, 0.0) == pytest.approx((0.3, 0.8, 0.2), abs=1e-5)
    assert result.scene.parts[2].motion is None
    lowest = result.scene.with_motions([None, result.scene.parts[1].motion, None])
    assert lowest.pose(0.0).meshes[1].positions[:, 1].min() == pytest.approx(0.0, abs=1e-5)


def test_heights_in_metres_hold_at_any_distance(files):
    wish = GroundPlacing(at=(0.4, 0.8), height_m=0.5)
    other = FurtherObject(glb=files / "b.glb", placing=GroundPlacing(at=(0.7, 0.6), height_m=1.0))
    result = staged(objects_of(files, wish=wish, others=(other,)), still(scale="metres"))
    heights = [np.ptp(mesh.positions[:, 1]) for mesh in result.scene.pose(0.0).meshes]
    assert heights[1] / heights[0] == pytest.approx(2.0, rel=1e-5)


def test_lamp_of_a_scaled_file_keeps_its_light_on_what_is_around_it(files, tmp_path):
    builder = shots.GlbBuilder()
    builder.node(mesh=builder.mesh(shots.CUBE, shots.CUBE_FACES))
    builder.light(kind="point", intensity=40.0, range=8.0, node={"translation": [0.0, 3.0, 0.0]})
    glb = builder.write(tmp_path / "lamp.glb")
    other = FurtherObject(glb=glb, placing=GroundPlacing(at=(0.7, 0.7), size=0.2))
    result = staged(objects_of(files, others=(other,)), still())
    (light,) = result.scene.pose(0.0).lights
    foot = result.scene.parts[1].motion.place_at(0.0)
    away = np.linalg.norm(light.position - foot)
    assert light.light.intensity / away**2 == pytest.approx(40.0 / 9.0, rel=1e-6)
    assert light.light.range / away == pytest.approx(8.0 / 3.0, rel=1e-6)


KEY_ABOVE = (PlaceKey(time_s=0.0, at=(0.5, 0.8)), PlaceKey(time_s=1.5, at=(0.5, -0.8)))
BESIDE = GroundPlacing(at=(0.7, 0.8), size=0.2)


@pytest.mark.parametrize(
    ("change", "raised", "words"),
    [
        ({"keys": KEY_ABOVE}, SceneError, r"a\.glb, at 1\.5 s: .*above the horizon"),
        ({"keys": (PlaceKey(frame=99, at=(0.5, 0.8)),)}, UsageError, "no such frame, only 0 to 50"),
        ({"keys": (PlaceKey(time_s=0.0, height_m=1.0),)}, UsageError, "scale is not known"),
        ({"layers": "layers.exr", "keys": KEY_ABOVE}, UsageError, "--layers hold one object"),
        ({"others": ("b.glb", None)}, UsageError, r"b\.glb: give at and size too"),
        ({"others": ("b.glb", replace(BESIDE, at=(0.5, -0.8)))}, SceneError, r"b\.glb, at 0 s"),
        ({"others": ("none.glb", BESIDE)}, SceneError, "cannot be read"),
    ],
)
def test_places_without_sense_are_refused_by_name(files, change, raised, words):
    if "others" in change:
        name, placing = change["others"]
        change = {"others": (FurtherObject(glb=files / name, placing=placing),)}
    objects = objects_of(files)
    if "keys" in change:
        change = {**change, "keys": PlaceKeys(keys=change["keys"])}
    with pytest.raises(raised, match=words):
        staged(replace(objects, **change), moving())


def test_too_many_vertices_together_are_refused(files, monkeypatch):
    monkeypatch.setattr("nlens_video.scene.scene.MAX_VERTICES", 12)
    with pytest.raises(SceneError, match="more than 12 vertices in all objects"):
        load_scene(objects_of(files, others=(FurtherObject(glb=files / "b.glb"),)))
