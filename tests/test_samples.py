"""The committed samples: what a visitor gets, and that the scripts beside them still make it."""

from __future__ import annotations

import json
import struct
import subprocess
import sys
from itertools import pairwise

import av
import numpy as np
import pygltflib
import pytest
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from support.folders import SAMPLES

from nlens_video.core.lens_fit import LensFit

PAIRS = [("in.mp4", "anim.glb", "terrace"), ("in2.mp4", "anim2.glb", "park")]
COLUMNS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT4": 16}
TYPES = {5121: np.uint8, 5123: np.uint16, 5126: np.float32}

clips = pytest.mark.parametrize("clip", [pair[0] for pair in PAIRS])
objects = pytest.mark.parametrize(("clip", "glb", "scene"), PAIRS)


def read(gltf, accessor):
    entry = gltf.accessors[accessor]
    view = gltf.bufferViews[entry.bufferView]
    flat = np.frombuffer(
        gltf.binary_blob(),
        TYPES[entry.componentType],
        entry.count * COLUMNS[entry.type],
        view.byteOffset,
    )
    return flat.reshape(entry.count, -1).astype(float)


def local_matrix(node):
    x, y, z, w = node.rotation or (0.0, 0.0, 0.0, 1.0)
    matrix = np.eye(4)
    matrix[:3, :3] = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    matrix[:3, 3] = node.translation or (0.0, 0.0, 0.0)
    return matrix


def world_matrices(gltf):
    world = {}

    def visit(index, above):
        world[index] = above @ local_matrix(gltf.nodes[index])
        for child in gltf.nodes[index].children or []:
            visit(child, world[index])

    for root in gltf.scenes[0].nodes:
        visit(root, np.eye(4))
    return world


def first_pose(gltf):
    """World positions of every vertex as the nodes rest, which is the first frame."""
    world, posed = world_matrices(gltf), []
    for index, node in enumerate(gltf.nodes):
        if node.mesh is None:
            continue
        for primitive in gltf.meshes[node.mesh].primitives:
            points = read(gltf, primitive.attributes.POSITION)
            points = np.c_[points, np.ones(len(points))]
            matrices = world[index][None]
            if node.skin is not None:
                skin = gltf.skins[node.skin]
                unbind = read(gltf, skin.inverseBindMatrices).reshape(-1, 4, 4).transpose(0, 2, 1)
                joints = np.stack([world[j] for j in skin.joints]) @ unbind
                chosen = read(gltf, primitive.attributes.JOINTS_0).astype(int)
                weights = read(gltf, primitive.attributes.WEIGHTS_0)
                matrices = np.einsum("vk,vkij->vij", weights, joints[chosen])
            posed.append(
                np.einsum("vij,vj->vi", np.broadcast_to(matrices, (len(points), 4, 4)), points)
            )
    return np.concatenate(posed)[:, :3]


def first_luma(clip):
    with av.open(str(SAMPLES / clip)) as source:
        return next(source.decode(video=0)).to_ndarray(format="gray").astype(float)


@clips
def test_sample_clip_is_six_seconds_of_h264_with_full_colour_tags(clip):
    with av.open(str(SAMPLES / clip)) as source:
        video = source.streams.video[0]
        context = video.codec_context
        frames = list(source.decode(video))
    assert (context.name, context.pix_fmt, context.width, context.height) == (
        "h264",
        "yuv420p",
        960,
        512,
    )
    assert (
        context.colorspace,
        context.color_primaries,
        context.color_trc,
        context.color_range,
    ) == (1, 1, 1, 1)
    assert video.average_rate == 24
    assert len(frames) == 144
    steps = {(b.pts - a.pts) * b.time_base for a, b in pairwise(frames)}
    assert [float(step) for step in steps] == [pytest.approx(1 / 24)]


@clips
def test_sample_clip_has_audible_stereo_sound_of_the_same_length(clip):
    with av.open(str(SAMPLES / clip)) as source:
        audio = source.streams.audio[0]
        assert (audio.codec_context.name, audio.rate, audio.channels) == ("aac", 48000, 2)
        sound = np.concatenate([frame.to_ndarray() for frame in source.decode(audio)], axis=1)
    assert sound.shape[1] / 48000 == pytest.approx(6.0, abs=0.1)
    assert 0.005 < sound.std() < 0.2
    assert abs(sound).max() < 0.95


@clips
def test_sample_plate_is_well_exposed(clip):
    luma = first_luma(clip)
    assert 60 < luma.mean() < 160
    assert (luma > 250).mean() < 0.02


@clips
def test_sample_plate_is_sharpest_at_the_focal_plane_of_its_lens_file(clip):
    text = (SAMPLES / clip).with_suffix(".json").read_text()
    camera, detail = json.loads(text)["camera"], abs(np.diff(first_luma(clip), axis=1))
    down = np.radians(camera["pitch_deg"])
    slopes = (np.arange(512) + 0.5 - 256.0) / 256.0 * np.tan(0.5 * camera["yfov_rad"])
    disparity = (np.sin(down) + slopes * np.cos(down)) / camera["height_m"]
    coc_px = LensFit.from_json(text).coc_px(disparity.astype(np.float32))
    rows = detail[:, 200:760].mean(axis=1)
    rows = np.convolve(rows, np.full(15, 1 / 15), mode="same") * (coc_px > -15.0)
    assert abs(coc_px[rows.argmax()]) < 2.0
    assert rows.max() > 2.0 * rows[(coc_px > -15.0) & (coc_px < -8.0)].mean()


@clips
def test_sample_lens_file_is_a_fit_consistent_with_its_lens(clip):
    text = (SAMPLES / clip).with_suffix(".json").read_text()
    fit, lens = LensFit.from_json(text), json.loads(text)["lens"]
    f, zf = lens["focal_length_mm"] * 1e-3, lens["focus_distance_m"]
    at_infinity = f / lens["f_number"] * f / (zf - f) * fit.width / (lens["sensor_width_mm"] * 1e-3)
    assert fit.intercept == pytest.approx(-at_infinity)
    assert fit.focus_disparity == pytest.approx(1.0 / zf)


@objects
def test_sample_object_has_the_plates_camera_and_lights(clip, glb, scene):
    plate = json.loads((SAMPLES / clip).with_suffix(".json").read_text())
    gltf = pygltflib.GLTF2().load(str(SAMPLES / glb))
    assert gltf.cameras[0].perspective.yfov == pytest.approx(plate["camera"]["yfov_rad"])
    pose = world_matrices(gltf)[next(i for i, n in enumerate(gltf.nodes) if n.camera is not None)]
    assert pose[:3, 3] == pytest.approx([0.0, plate["camera"]["height_m"], 0.0])
    assert np.degrees(np.arcsin(pose[1, 2])) == pytest.approx(plate["camera"]["pitch_deg"])
    lights = gltf.extensions["KHR_lights_punctual"]["lights"]
    assert {light["type"] for light in lights} == {"directional"}
    assert lights[0]["intensity"] > max(light["intensity"] for light in lights[1:])


@objects
def test_sample_object_stands_on_the_ground_in_view_on_the_first_frame(clip, glb, scene):
    gltf = pygltflib.GLTF2().load(str(SAMPLES / glb))
    points = first_pose(gltf)
    assert points[:, 1].min() == pytest.approx(0.0, abs=1e-5)
    camera = np.linalg.inv(world_matrices(gltf)[0])
    seen = points @ camera[:3, :3].T + camera[:3, 3]
    half = np.tan(0.5 * gltf.cameras[0].perspective.yfov)
    assert (abs(seen[:, 0]) < -seen[:, 2] * half * 960 / 512).all()
    assert (abs(seen[:, 1]) < -seen[:, 2] * half).all()


@objects
def test_sample_object_crosses_the_focal_plane_within_six_seconds(clip, glb, scene):
    fit = LensFit.from_json((SAMPLES / clip).with_suffix(".json").read_text())
    gltf = pygltflib.GLTF2().load(str(SAMPLES / glb))
    moves = next(c for c in gltf.animations[0].channels if c.target.path == "translation")
    sampler = gltf.animations[0].samplers[moves.sampler]
    times, places = read(gltf, sampler.input), read(gltf, sampler.output)
    camera = np.linalg.inv(world_matrices(gltf)[0])
    depth = -(places @ camera[:3, :3].T + camera[:3, 3])[:, 2]
    coc_px = fit.coc_px((1.0 / depth).astype(np.float32))
    assert times[-1, 0] == pytest.approx(6.0)
    assert coc_px.max() > 7.0
    assert coc_px.min() < -7.0


def test_first_sample_object_is_skinned_and_the_second_has_morph_targets():
    first, second = (pygltflib.GLTF2().load(str(SAMPLES / pair[1])) for pair in PAIRS)
    assert len(first.skins[0].joints) > 8
    weights = read(first, first.meshes[0].primitives[0].attributes.WEIGHTS_0)
    assert weights.sum(axis=1) == pytest.approx(np.ones(len(weights)), abs=1e-5)
    assert ((weights > 0.05).sum(axis=1) > 1).mean() > 0.2
    assert len(second.meshes[0].primitives[0].targets) == 2
    paths = {channel.target.path for channel in second.animations[0].channels}
    assert paths == {"translation", "rotation", "weights"}


@objects
def test_every_part_of_the_sample_object_faces_outwards(clip, glb, scene):
    gltf = pygltflib.GLTF2().load(str(SAMPLES / glb))
    for primitive in (part for mesh in gltf.meshes for part in mesh.primitives):
        points = read(gltf, primitive.attributes.POSITION)
        normals = read(gltf, primitive.attributes.NORMAL)
        a, b, c = read(gltf, primitive.indices).astype(int).reshape(-1, 3).T
        links = coo_array(
            (np.ones(2 * len(a)), (np.r_[a, b], np.r_[b, c])), shape=(len(points),) * 2
        )
        count, part = connected_components(links, directed=False)
        centre = np.stack([np.bincount(part, points[:, k]) for k in range(3)], axis=1)
        centre /= np.bincount(part)[:, None]
        face = np.cross(points[b] - points[a], points[c] - points[a])
        volume = np.bincount(part[a], ((points[a] - centre[part[a]]) * face).sum(axis=1), count)
        assert (volume > 0).all()
        assert (np.einsum("ij,ij->i", face, normals[a]) >= -1e-12).mean() > 0.99


@objects
def test_sample_object_embeds_a_texture_of_at_most_512_pixels(clip, glb, scene):
    gltf = pygltflib.GLTF2().load(str(SAMPLES / glb))
    view = gltf.bufferViews[gltf.images[0].bufferView]
    png = gltf.binary_blob()[view.byteOffset : view.byteOffset + view.byteLength]
    assert png[:8] == b"\x89PNG\r\n\x1a\n"
    assert max(struct.unpack(">II", png[16:24])) <= 512


@pytest.mark.slow
@objects
def test_scripts_reproduce_the_committed_sample_object(clip, glb, scene, tmp_path):
    again = tmp_path / glb
    command = [sys.executable, str(SAMPLES / "make_object.py"), scene, str(again)]
    subprocess.run([*command, "--plate", str((SAMPLES / clip).with_suffix(".json"))], check=True)
    made, committed = (pygltflib.GLTF2().load(str(path)) for path in (again, SAMPLES / glb))
    assert [node.name for node in made.nodes] == [node.name for node in committed.nodes]
    assert len(made.accessors) == len(committed.accessors)
    for index in range(len(made.accessors)):
        assert read(made, index) == pytest.approx(read(committed, index), abs=1e-5)


def test_samples_are_small_and_hold_no_project_files():
    files = [
        path for path in SAMPLES.iterdir() if path.is_file() and not path.name.startswith("out")
    ]
    assert sum(path.stat().st_size for path in files) < 8e6
    assert {path.suffix for path in files} <= {".py", ".md", ".mp4", ".glb", ".json"}


@pytest.mark.slow
@pytest.mark.parametrize("script", ["make_samples.py", "make_object.py"])
def test_sample_script_prints_help_without_blender(script):
    shown = subprocess.run(
        [sys.executable, str(SAMPLES / script), "--help"],
        capture_output=True,
        text=True,
        check=True,
    )
    assert "usage:" in shown.stdout
