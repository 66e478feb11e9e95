"""Cameras in scene files: what is written comes back, and what other programs write is read."""

import importlib.util
import json
import math
import subprocess
import sys
from fractions import Fraction

import numpy as np
import pygltflib
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace
from pxr import Gf, Usd, UsdGeom
from scipy.spatial.transform import Rotation
from support.glb_builder import GlbBuilder

from nlens_video.cameras.files import camera_bytes, check_camera_name, lost_in, read_camera
from nlens_video.cameras.solved import CameraErrors, CameraKey, SolvedCamera
from nlens_video.core.errors import SceneError, UsageError

SIZE, RATE = (960, 512), Fraction(24)
SUFFIXES = (".json", ".glb", ".chan", ".usda")
WHOLE = (".json", ".glb", ".usda")  # formats that keep sources, errors and method


def pose_of(pitch=-15.0, yaw=10.0, roll=1.0, eye=(0.2, 1.6, 0.5)):
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_euler("YXZ", [yaw, pitch, roll], degrees=True).as_matrix()
    pose[:3, 3] = eye
    return pose


def shot(poses, fovs, size=SIZE, first=0, rate=RATE, **fields):
    keys = tuple(
        CameraKey(
            index=first + n, pts_s=float((first + n) / rate), fov_x_deg=fov,
            world_to_camera=np.linalg.inv(pose),
        )
        for n, (pose, fov) in enumerate(zip(poses, fovs, strict=True))
    )  # fmt: skip
    path = "moving" if len(keys) > 1 else "still"
    return SolvedCamera(width=size[0], height=size[1], keys=keys, path=path, **fields)


def walk(count=5, step_deg=2.0, **fields):
    poses = [pose_of(yaw=10 - step_deg * n, eye=(0.2 + 0.1 * n, 1.6, 0.5)) for n in range(count)]
    return shot(poses, [50.0 - step_deg * n for n in range(count)], **fields)


def uneven(camera):
    """The camera of a plate whose third frame comes by a third of a frame late."""
    late = [1 / 72 if n == 2 else 0.0 for n in range(len(camera.keys))]
    return timed(camera, [key.pts_s + by for key, by in zip(camera.keys, late, strict=True)])


def in_whole_milliseconds(camera):
    """The camera of a Matroska file."""
    return timed(camera, [round(key.pts_s, 3) for key in camera.keys])


def timed(camera, times_s):
    keys = zip(camera.keys, times_s, strict=True)
    return replace(camera, keys=tuple(replace(key, pts_s=time) for key, time in keys))


def written(camera, path, rate=RATE):
    """What a file holds after it was written."""
    path.write_bytes(camera_bytes(camera, path))
    return read_camera(path, (camera.width, camera.height), rate)


def test_camera_of_later_frames_claims_no_frames_before_them(tmp_path):
    camera = walk(first=10)
    for suffix in WHOLE:
        read = written(camera, tmp_path / f"camera{suffix}")
        assert [key.index for key in read.keys] == [10, 11, 12, 13, 14], suffix


MEASURED = {"fov": "measured", "horizon": "measured"}


@pytest.mark.parametrize(
    ("camera", "named"),
    [
        (
            walk(first=10, distortion_k1=-0.1, principal_px=(470.0, 250.0), **MEASURED),
            (
                "the lens distortion", "the principal point",
                "that frames before 10 have no camera",
            ),
        ),
        (walk(fov="assumed", horizon="measured"), ("that the field of view is assumed",)),
        (walk(fov="measured", horizon="assumed"), ("that pitch and roll are assumed",)),
        (
            walk(fov="assumed", horizon="assumed"),
            ("that the field of view is assumed", "that pitch and roll are assumed"),
        ),
        (walk(scale="metres", **MEASURED), ("that its unit is the metre",)),
        (uneven(walk(**MEASURED)), ("the times of a variable frame rate",)),
        (walk(**MEASURED), ()),
        (walk(**{**MEASURED, "fov": "metadata"}), ()),
        (uneven(walk(1, **MEASURED)), ()),
        (in_whole_milliseconds(walk(100, step_deg=0.2, **MEASURED)), ()),
    ],
)  # fmt: skip
def test_what_a_format_cannot_hold_is_named(tmp_path, camera, named):
    assert lost_in(camera, tmp_path / "camera.chan") == named
    assert not any(lost_in(camera, tmp_path / f"camera{suffix}") for suffix in WHOLE)


def assert_same_view(one, other, *, pixels=5e-3, size=1e-5):
    """Two cameras see a point before them on the same pixel."""
    point = (one.world_from_camera @ [0.3, -0.2, -2.0, 1.0])[None, :3]
    seen, again = (camera.pixels(camera.to_camera(point)) for camera in (one, other))
    np.testing.assert_allclose(again, seen, atol=pixels)
    np.testing.assert_allclose(other.world_from_camera, one.world_from_camera, atol=size)


angles = st.floats(-180.0, 180.0)
poses = st.builds(
    pose_of, pitch=st.floats(-90.0, 90.0), yaw=angles, roll=angles,
    eye=st.tuples(*[st.floats(-3.0, 3.0)] * 3),
)  # fmt: skip
frames = st.lists(st.tuples(poses, st.floats(15.0, 140.0)), min_size=1, max_size=6)


sizes = st.sampled_from([(960, 512), (512, 960), (64, 64), (1998, 1080)])
rates = st.sampled_from([Fraction(24), Fraction(30000, 1001), Fraction(50)])
grounds = st.sampled_from([0.0, -0.7])


@settings(max_examples=50, deadline=None)
@given(
    frames=frames, size=sizes, ground=grounds, rate=rates,
    suffix=st.sampled_from([".json", ".glb", ".chan"]),
)  # fmt: skip
def test_camera_comes_back_from_each_format(tmp_path_factory, frames, size, ground, suffix, rate):
    assert_comes_back(tmp_path_factory.mktemp("files"), frames, size, ground, suffix, rate)


@pytest.mark.slow
@settings(max_examples=20, deadline=None)
@given(frames=frames, size=sizes, ground=grounds, rate=rates)
def test_camera_comes_back_from_usd(tmp_path_factory, frames, size, ground, rate):
    assert_comes_back(tmp_path_factory.mktemp("files"), frames, size, ground, ".usda", rate)


def assert_comes_back(folder, frames, size, ground, suffix, rate):
    camera = shot(*zip(*frames, strict=True), size=size, rate=rate, ground_y=ground)
    read = written(camera, folder / f"camera{suffix}", rate)
    lowered = 0.0 if suffix == ".json" else ground  # the ground of the others is y = 0
    assert read.ground_y == ground - lowered
    assert [key.index for key in read.keys] == [key.index for key in camera.keys]
    for key in camera.keys:
        seen = camera.at(key.pts_s)
        pose = seen.world_from_camera.copy()
        pose[1, 3] -= lowered
        assert_same_view(replace(seen, world_from_camera=pose), read.at(key.pts_s))


@pytest.mark.parametrize("suffix", WHOLE)
def test_sources_errors_and_scale_come_back(tmp_path, suffix):
    camera = walk(
        fov="metadata", horizon="assumed", scale="arbitrary", method="by hand",
        errors=CameraErrors(fov_deg=1.5, pitch_deg=0.4, roll_deg=0.2),
    )  # fmt: skip
    read = written(camera, tmp_path / f"camera{suffix}")
    for name in ("fov", "horizon", "path", "scale", "method", "errors"):
        assert getattr(read, name) == getattr(camera, name)


@pytest.mark.parametrize("suffix", WHOLE)
@pytest.mark.parametrize("size", [(960, 512), (512, 960)])
def test_principal_point_comes_back(tmp_path, suffix, size):
    camera = walk(size=size, principal_px=(0.5 * size[0] + 12.5, 0.5 * size[1] - 7.25))
    read = written(camera, tmp_path / f"camera{suffix}")
    assert read.principal_px == pytest.approx(camera.principal_px, abs=1e-3)
    assert_same_view(camera.at(0.1), read.at(0.1))


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_camera_of_a_later_range_keeps_its_times(tmp_path, suffix):
    camera = walk(first=10)
    read = written(camera, tmp_path / f"camera{suffix}")
    for time_s in (0.0, 10 / 24, 12 / 24, 14 / 24, 2.0):
        assert_same_view(camera.at(time_s), read.at(time_s))


@pytest.mark.parametrize("suffix", [".json", ".glb", ".usda"])
def test_uneven_frame_times_come_back(tmp_path, suffix):
    times = [0.0, 0.04, 0.11, 0.13, 0.31]
    even = walk()
    keys = tuple(replace(key, pts_s=t) for key, t in zip(even.keys, times, strict=True))
    camera = replace(even, keys=keys)
    read = written(camera, tmp_path / f"camera{suffix}")
    for time_s in times:
        assert_same_view(camera.at(time_s), read.at(time_s))


@pytest.mark.parametrize("suffix", SUFFIXES)
def test_files_are_the_same_bytes_each_time(suffix, tmp_path):
    camera = walk(points=np.arange(12.0).reshape(4, 3))
    assert camera_bytes(camera, tmp_path / f"a{suffix}") == camera_bytes(
        camera, tmp_path / f"b{suffix}"
    )


@pytest.mark.parametrize("suffix", [".glb", ".usda"])
@pytest.mark.parametrize("shape", [(540, 960), (1024, 1024)])
def test_file_for_another_shape_of_the_plate_is_refused(tmp_path, suffix, shape):
    path = tmp_path / f"camera{suffix}"
    path.write_bytes(camera_bytes(walk(), path))
    with pytest.raises(SceneError, match=str(path)):
        read_camera(path, shape, RATE)


@pytest.mark.parametrize("suffix", [".glb", ".usda"])
def test_file_for_a_smaller_copy_of_the_plate_is_used(tmp_path, suffix):
    path = tmp_path / f"camera{suffix}"
    path.write_bytes(camera_bytes(walk(principal_px=(490.0, 250.0)), path))
    small = read_camera(path, (480, 256), RATE)
    assert small.principal_px == pytest.approx((245.0, 125.0), abs=1e-3)
    assert small.keys[0].fov_x_deg == pytest.approx(50.0, abs=1e-4)


# GLB


def test_glb_holds_an_animated_camera_a_grid_of_lines_and_the_points(tmp_path):
    points = np.random.default_rng(0).normal(size=(40, 3))
    path = tmp_path / "camera.glb"
    path.write_bytes(camera_bytes(walk(points=points), path))
    file = pygltflib.GLTF2().load(str(path))
    lens = file.cameras[0].perspective
    assert lens.aspectRatio == pytest.approx(960 / 512)
    assert lens.yfov == pytest.approx(2 * math.atan(math.tan(math.radians(25)) * 512 / 960))
    named = {node.name: file.meshes[node.mesh].primitives[0] for node in file.nodes[1:]}
    assert {name: one.mode for name, one in named.items()} == {"ground": 1, "points": 0}
    assert file.extensionsUsed == ["KHR_animation_pointer"]
    for accessor in file.accessors:
        view = file.bufferViews[accessor.bufferView]
        values = np.frombuffer(
            file.binary_blob(), np.float32, view.byteLength // 4, view.byteOffset
        ).reshape(accessor.count, -1)
        assert {"SCALAR": 1, "VEC3": 3, "VEC4": 4}[accessor.type] == values.shape[1]
        if accessor.min:
            np.testing.assert_array_equal(values.min(axis=0), np.float32(accessor.min))
            np.testing.assert_array_equal(values.max(axis=0), np.float32(accessor.max))
    clip = file.animations[0]
    assert all(file.accessors[sampler.input].min for sampler in clip.samplers)
    ground = file.accessors[named["ground"].attributes.POSITION]
    assert ground.min[1] == ground.max[1] == 0.0
    assert file.accessors[named["points"].attributes.POSITION].count == 40


def test_glb_of_a_lens_that_stays_needs_no_extension(tmp_path):
    camera = shot([pose_of(), pose_of(yaw=5.0)], [50.0, 50.0])
    path = tmp_path / "camera.glb"
    path.write_bytes(camera_bytes(camera, path))
    file = pygltflib.GLTF2().load(str(path))
    assert not file.extensionsUsed
    assert len(file.animations[0].channels) == 2


def test_glb_of_a_still_camera_has_no_animation(tmp_path):
    camera = shot([pose_of()], [50.0])
    read = written(camera, tmp_path / "camera.glb")
    assert len(read.keys) == 1
    assert not pygltflib.GLTF2().load(str(tmp_path / "camera.glb")).animations


def test_camera_of_any_glb_is_read_through_its_parents_and_splines(tmp_path):
    builder = GlbBuilder()
    lens = builder.node(root=False, camera=builder.camera(0.6), translation=[0.0, 0.5, 0.0])
    rig = builder.node(children=[lens], rotation=[0.0, math.sin(0.3), 0.0, math.cos(0.3)])
    tangents = [[0, 0, 0], [0, 0, 0], [4, 0, 0], [0, 0, 0], [0, 0, 0], [0, 0, 0]]
    builder.animation((rig, "translation", [0.0, 1.0], tangents, "CUBICSPLINE"))
    camera = read_camera(builder.write(tmp_path / "rig.glb"), SIZE, RATE)
    assert len(camera.keys) == 25
    # u^3 - 2 u^2 + u = 0.125 at u = 0.5, times a tangent of 4
    middle = camera.at(0.5).world_from_camera
    np.testing.assert_allclose(middle[:3, 3], [0.5, 0.5, 0.0], atol=1e-6)
    np.testing.assert_allclose(middle[:3, :3], Rotation.from_euler("Y", 0.6).as_matrix(), atol=1e-6)
    assert camera.at(0.5).fy == pytest.approx(256 / math.tan(0.3))
    assert (camera.scale, camera.ground_y) == ("metres", 0.0)


@pytest.mark.parametrize(
    ("damage", "said"),
    [
        (lambda data: b"", "JSON"),
        (lambda data: data[:200], "truncated"),
        (lambda data: data.replace(b"perspective", b"persqective"), "no perspective camera"),
    ],
)
def test_damaged_glb_is_refused(tmp_path, damage, said):
    path = tmp_path / "camera.glb"
    path.write_bytes(damage(camera_bytes(walk(), path)))
    with pytest.raises(SceneError, match=said):
        read_camera(path, SIZE, RATE)


BLENDER = """
import bpy, json, numpy, sys
numpy.bool = getattr(numpy, "bool", bool)  # Blender 3.4 asks for it, Debian's numpy 1.24 lacks it
source, target = sys.argv[-2:]
bpy.ops.wm.read_factory_settings(use_empty=True)
scene = bpy.context.scene
scene.render.fps, scene.render.resolution_x, scene.render.resolution_y = 24, {width}, {height}
bpy.ops.import_scene.gltf(filepath=source)
scene.frame_start, scene.frame_end = 0, {last}
camera = next(item for item in scene.objects if item.type == "CAMERA")
seen = []
for frame in range({last} + 1):
    scene.frame_set(frame)
    graph = bpy.context.evaluated_depsgraph_get()
    lens = camera.calc_matrix_camera(graph, x={width}, y={height})
    placed = camera.evaluated_get(graph).matrix_world
    focal = lens[0][0] * {width} / 2, lens[1][1] * {height} / 2
    seen.append([[list(row) for row in placed], *focal])
drawn = [item for item in scene.objects if item.type == "MESH"]
meshes = {{item.name: [len(item.data.vertices), len(item.data.edges)] for item in drawn}}
bpy.ops.mesh.primitive_cube_add(size=0.5)
bpy.ops.export_scene.gltf(filepath=target, export_cameras=True)
print("SEEN" + json.dumps([seen, meshes, camera.data.lens, camera.data.sensor_height]))
"""
"""Reads a camera as an artist does, says what it sees, and exports it with a cube."""


@pytest.mark.slow
@pytest.mark.needs_blender
@pytest.mark.parametrize("size", [(960, 512), (540, 960)])
def test_blender_sees_what_was_written_and_its_export_is_read_back(tmp_path, size):
    poses = [
        pose_of(pitch=-15 + n, yaw=8 * n, roll=1 + 0.3 * n, eye=(0.2 * n, 1.6, -0.1 * n))
        for n in range(9)
    ]
    camera = shot(poses, [50.0] * 9, size=size, points=np.random.default_rng(0).normal(size=(7, 3)))
    source, target = tmp_path / "camera.glb", tmp_path / "artist.glb"
    source.write_bytes(camera_bytes(camera, source))
    script = tmp_path / "script.py"
    script.write_text(BLENDER.format(width=size[0], height=size[1], last=8))
    run = subprocess.run(
        ["blender", "-b", "--factory-startup", "-P", script, "--", source, target],
        capture_output=True, text=True, check=True, timeout=300,
    )  # fmt: skip
    line = next((line for line in run.stdout.splitlines() if line.startswith("SEEN")), None)
    assert line is not None, run.stdout + run.stderr
    seen, meshes, lens_mm, sensor_mm = json.loads(line[4:])
    z_up = np.array([[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1.0]])
    for (placed, fx, fy), pose in zip(seen, poses, strict=True):
        np.testing.assert_allclose(placed, z_up @ pose, atol=1e-5)
        assert fx == pytest.approx(camera.at(0.0).fx, rel=1e-5)
        assert fy == pytest.approx(fx, rel=1e-5)
    # The sensor's height is the picture's: f [mm] = f [px] * height [mm] / height [px].
    assert lens_mm == pytest.approx(camera.at(0.0).fx * sensor_mm / size[1], rel=1e-5)
    assert meshes["points"] == [7, 0]
    assert meshes["ground"][0] == 2 * meshes["ground"][1] > 40
    read = read_camera(target, size, RATE)
    assert len(read.keys) == 9
    for key in camera.keys:
        assert_same_view(camera.at(key.pts_s), read.at(key.pts_s), pixels=0.02, size=1e-4)
    left = pygltflib.GLTF2().load(str(target))
    assert len(left.meshes) == 1, "grid and points do not become a part of the object's file"


def test_frames_of_a_chan_file_have_the_times_of_a_plate_in_whole_milliseconds(tmp_path):
    camera, path = walk(), tmp_path / "shot.chan"
    path.write_bytes(camera_bytes(camera, path))
    read = read_camera(path, SIZE, RATE, Fraction(1, 1000))
    assert [key.pts_s for key in read.keys] == [0.0, 0.042, 0.083, 0.125, 0.167]
    for key, own in zip(camera.keys, read.keys, strict=True):
        np.testing.assert_allclose(own.world_to_camera, key.world_to_camera, atol=1e-6)


# OpenUSD


def stage_of(path, *, up="Y", unit=None, per_second=24.0, start=None):
    stage = Usd.Stage.CreateNew(str(path))
    UsdGeom.SetStageUpAxis(stage, up)
    if unit is not None:
        UsdGeom.SetStageMetersPerUnit(stage, unit)
    if per_second is not None:
        stage.SetTimeCodesPerSecond(per_second)
    if start is not None:
        stage.SetStartTimeCode(start)
        stage.SetEndTimeCode(start + 10)
    return stage


def lens_of(stage, path="/shot/cam", focal=35.0, aperture=(36.0, 24.0)):
    camera = UsdGeom.Camera.Define(stage, path)
    camera.CreateHorizontalApertureAttr(aperture[0])
    camera.CreateVerticalApertureAttr(aperture[1])
    camera.CreateFocalLengthAttr(focal)
    return camera


@pytest.mark.parametrize("suffix", [".usda", ".usdc", ".usd"])
def test_stage_with_z_up_in_centimetres_is_read_in_metres(tmp_path, suffix):
    stage = stage_of(tmp_path / f"shot{suffix}", up="Z", unit=0.01, start=1001)
    camera = lens_of(stage)
    moved = camera.AddTranslateOp()
    moved.Set(Gf.Vec3d(0, 0, 160), 1001)
    moved.Set(Gf.Vec3d(240, 0, 160), 1025)
    camera.AddRotateXYZOp().Set(Gf.Vec3f(75, 0, 0))  # 15 degrees below the horizon, along +Y
    stage.Save()
    read = read_camera(tmp_path / f"shot{suffix}", SIZE, RATE)
    assert (read.scale, len(read.keys), read.keys[-1].index) == ("metres", 25, 24)
    assert read.keys[0].pitch_deg == pytest.approx(-15.0)
    np.testing.assert_allclose(read.at(0.5).world_from_camera[:3, 3], [1.2, 1.6, 0.0], atol=1e-9)
    assert read.keys[0].fov_x_deg == pytest.approx(2 * math.degrees(math.atan(18 / 35)))


def test_stage_without_a_unit_keeps_its_own(tmp_path):
    stage = stage_of(tmp_path / "shot.usda")
    lens_of(stage).AddTranslateOp().Set(Gf.Vec3d(0, 160, 0))
    stage.Save()
    read = read_camera(tmp_path / "shot.usda", SIZE, RATE)
    assert read.scale == "arbitrary"
    assert read.keys[0].world_from_camera[1, 3] == pytest.approx(160.0)


def test_focal_length_that_is_animated_zooms(tmp_path):
    stage = stage_of(tmp_path / "shot.usda")
    focal = lens_of(stage).GetFocalLengthAttr()
    focal.Clear()
    focal.Set(24.0, 0.0)
    focal.Set(48.0, 12.0)
    stage.Save()
    read = read_camera(tmp_path / "shot.usda", SIZE, RATE)
    for time_s, length in ((0.0, 24.0), (0.25, 36.0), (0.5, 48.0), (9.0, 48.0)):
        assert read.at(time_s).fx == pytest.approx(960 * length / 36.0, rel=1e-6)


def test_offset_of_the_aperture_is_the_principal_point(tmp_path):
    stage = stage_of(tmp_path / "shot.usda")
    camera = lens_of(stage, aperture=(36.0, 19.2))
    camera.CreateHorizontalApertureOffsetAttr(1.5)
    camera.CreateVerticalApertureOffsetAttr(0.75)
    stage.Save()
    read = read_camera(tmp_path / "shot.usda", SIZE, RATE).at(0.0)
    # Where pxr's own frustum shows a point on the optical axis.
    frustum = camera.GetCamera(Usd.TimeCode.Default()).frustum
    seen = (frustum.ComputeViewMatrix() * frustum.ComputeProjectionMatrix()).Transform(
        Gf.Vec3d(0, 0, -2)
    )
    assert read.cx == pytest.approx(480 * (1 + seen[0]), abs=1e-3)
    assert read.cy == pytest.approx(256 * (1 - seen[1]), abs=1e-3)


def test_plates_rate_counts_where_the_stage_says_none(tmp_path):
    stage = stage_of(tmp_path / "shot.usda", per_second=None)
    moved = lens_of(stage).AddTranslateOp()
    moved.Set(Gf.Vec3d(0, 1, 0), 100)
    moved.Set(Gf.Vec3d(4, 1, 0), 110)
    stage.Save()
    read = read_camera(tmp_path / "shot.usda", SIZE, Fraction(50))
    assert read.keys[-1].pts_s == pytest.approx(0.2)
    assert [key.index for key in read.keys] == list(range(11))


def test_stage_with_frames_before_its_start_begins_at_it(tmp_path):
    stage = stage_of(tmp_path / "shot.usda", start=5)
    moved = lens_of(stage).AddTranslateOp()
    moved.Set(Gf.Vec3d(0, 1, 0), 0)
    moved.Set(Gf.Vec3d(10, 1, 0), 10)
    stage.Save()
    read = read_camera(tmp_path / "shot.usda", SIZE, RATE)
    assert read.keys[0].world_from_camera[0, 3] == pytest.approx(5.0)
    assert (read.keys[0].index, read.keys[0].pts_s, len(read.keys)) == (0, 0.0, 6)


def test_usda_shows_the_grid_and_the_points_to_other_programs(tmp_path):
    path = tmp_path / "camera.usda"
    path.write_bytes(camera_bytes(walk(points=np.ones((9, 3)), ground_y=-0.4), path))
    stage = Usd.Stage.Open(str(path))
    grid = UsdGeom.BasisCurves(stage.GetPrimAtPath("/world/ground"))
    ends = np.array(grid.GetPointsAttr().Get())
    assert len(ends) == 2 * len(grid.GetCurveVertexCountsAttr().Get()) > 40
    assert not ends[:, 1].any()
    cloud = np.array(UsdGeom.Points(stage.GetPrimAtPath("/world/points")).GetPointsAttr().Get())
    np.testing.assert_allclose(cloud, [[1.0, 1.4, 1.0]] * 9, rtol=1e-6)
    assert UsdGeom.GetStageUpAxis(stage) == "Y"
    assert stage.GetEndTimeCode() == 4.0


@pytest.mark.parametrize(
    ("suffix", "text"),
    [(".usda", ""), (".usda", "#usda 1.0\n("), (".usda", "#usda 1.0\n"), (".usdc", "hello"),
     (".usd", "hello"), (".usdz", "PK")],
)  # fmt: skip
def test_damaged_stage_is_refused(tmp_path, text, suffix):
    path = tmp_path / f"shot{suffix}"
    path.write_text(text)
    with pytest.raises(SceneError, match="shot") as caught:
        read_camera(path, SIZE, RATE)
    assert "\n" not in str(caught.value)


def test_stage_whose_bytes_are_no_text_is_refused(tmp_path):
    path = tmp_path / "shot.usda"
    path.write_bytes(camera_bytes(walk(), path).replace(b"float focalLength", b"fl\xe9at focal"))
    with pytest.raises(SceneError, match="cannot be read as USD"):
        read_camera(path, SIZE, RATE)


def test_stage_that_lost_a_transform_of_its_camera_is_refused(tmp_path):
    path = tmp_path / "shot.usda"
    path.write_bytes(camera_bytes(walk(), path).replace(b"3 xformOp:translate", b"3 xformOp:tran"))
    with pytest.raises(SceneError, match="its xformOps are incomplete"):
        read_camera(path, SIZE, RATE)


@pytest.mark.parametrize(("focal", "aperture"), [(0.0, 36.0), (-35.0, 36.0), (35.0, 0.0)])
def test_camera_without_a_lens_is_refused(tmp_path, focal, aperture):
    stage = stage_of(tmp_path / "shot.usda")
    lens_of(stage, focal=focal, aperture=(aperture, 24.0))
    stage.Save()
    with pytest.raises(SceneError, match="/shot/cam: a focal length"):
        read_camera(tmp_path / "shot.usda", SIZE, RATE)


def test_orthographic_camera_is_passed_over(tmp_path):
    stage = stage_of(tmp_path / "shot.usda")
    lens_of(stage, "/a").CreateProjectionAttr("orthographic")
    lens_of(stage, "/b", focal=50.0)
    stage.Save()
    read = read_camera(tmp_path / "shot.usda", SIZE, RATE)
    assert read.at(0.0).fx == pytest.approx(960 * 50 / 36)


def test_usd_without_its_library_says_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "pxr", None)
    assert importlib.util.find_spec("pxr") is None
    for attempt in (
        lambda: read_camera(tmp_path / "shot.usda", SIZE, RATE),
        lambda: check_camera_name(tmp_path / "camera.usda"),
    ):
        with pytest.raises(UsageError, match=r"install nlens-video\[usd\]"):
            attempt()
