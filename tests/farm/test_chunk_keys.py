"""The name of a chunk tells all files that its pictures are made of: a stale one is never taken."""

import json
import shutil
import struct

import numpy as np
import pytest
from msgspec.structs import replace
from support import shots
from support.camera_files import write_colmap

from nlens_video.cameras.camera_json import camera_of_json
from nlens_video.cameras.colmap import TEXT_FILES
from nlens_video.cameras.files import camera_bytes
from nlens_video.cli.main import main
from nlens_video.farm.chunk import mark_of
from nlens_video.options.parser import parse
from nlens_video.options.to_settings import settings

BINARY_HEAD = 12
CHUNK_HEAD = 8


@pytest.fixture
def shot(tmp_path):
    folder = tmp_path / "shot"
    folder.mkdir()
    return shots.write_shot(folder, 3)


def arguments(shot, scene="anim.glb", *more):
    given = [str(shot / "in.mp4"), str(shot / scene), str(shot / "chunks"), "--chunk-out"]
    return [*given, "--fit", str(shot / "fit.json"), "--preset", "realtime", *more]


def key(shot, *more):
    return mark_of(settings(parse(["render", *arguments(shot, *more)]))).key


def write_in_parts(shot, suffix):
    """The object as a glTF file whose buffer is a file beside it, with a name that is escaped."""
    raw = (shot / "anim.glb").read_bytes()
    (length,) = struct.unpack_from("<I", raw, BINARY_HEAD)
    begin = BINARY_HEAD + CHUNK_HEAD
    document = json.loads(raw[begin : begin + length])
    document["buffers"][0]["uri"] = "mesh%20data.bin"
    (shot / "mesh data.bin").write_bytes(raw[begin + length + CHUNK_HEAD :])
    text = json.dumps(document).encode()
    text += b" " * (-len(text) % 4)
    if suffix == ".glb":
        size = begin + len(text)
        text = struct.pack("<4sIII4s", b"glTF", 2, size, len(text), b"JSON") + text
    (shot / f"parts{suffix}").write_bytes(text)
    return f"parts{suffix}"


def shrink_corners(shot):
    """Halve the positions, the first thing in the buffer."""
    path = shot / "mesh data.bin"
    raw = bytearray(path.read_bytes())
    corners = np.frombuffer(raw, "<f4", shots.CUBE.size)
    corners *= 0.5
    path.write_bytes(raw)


@pytest.mark.needs_gl
@pytest.mark.parametrize("suffix", [".gltf", ".glb"])
def test_changed_buffer_beside_a_scene_makes_another_chunk(shot, suffix):
    scene = write_in_parts(shot, suffix)
    for _ in range(2):
        assert main([*arguments(shot, scene), "-q"]) == 0
    (before,) = (shot / "chunks").glob("*.nut")
    shrink_corners(shot)
    assert main([*arguments(shot, scene), "-q"]) == 0
    (after,) = set((shot / "chunks").glob("*.nut")) - {before}
    old, new = shots.read_planes(before), shots.read_planes(after)
    assert not np.array_equal(old[0][1][0], new[0][1][0])


def test_copies_of_a_scene_in_parts_have_one_key(shot, tmp_path):
    scene = write_in_parts(shot, ".gltf")
    copy = shutil.copytree(shot, tmp_path / "elsewhere")
    assert key(shot, scene) == key(copy, scene)


def test_changed_clip_of_a_playlist_makes_another_chunk(shot):
    clip = (shot / "in.mp4").read_bytes()
    (shot / "clips").mkdir()
    (shot / "clips" / "a.mp4").write_bytes(clip)
    (shot / "clips" / "all.ffconcat").write_text("ffconcat version 1.0\nfile a.mp4\nfile a.mp4\n")
    (shot / "in.ffconcat").write_text("ffconcat version 1.0\nfile 'clips/all.ffconcat'\n")

    def listed():
        given = [str(shot / "in.ffconcat"), *arguments(shot)[1:]]
        return mark_of(settings(parse(["render", *given]))).key

    first = listed()
    assert listed() == first
    (shot / "clips" / "a.mp4").write_bytes(clip + b"changed")
    assert listed() != first


def test_changed_layer_of_a_usd_camera_changes_the_key(shot):
    solved = camera_of_json(shots.camera_json(shot / "camera.json").read_text())
    camera, layer = shot / "camera.usda", shot / "layer.usda"
    camera.write_text("#usda 1.0\n(subLayers = [@./layer.usda@])\n")
    layer.write_bytes(camera_bytes(solved, layer))
    given = ["anim.glb", "--camera-from", str(camera)]
    before = key(shot, *given)
    assert before == key(shot, *given)
    (still,) = solved.keys
    layer.write_bytes(camera_bytes(replace(solved, keys=(replace(still, fov_x_deg=40.0),)), layer))
    assert key(shot, *given) != before


def add_colmap_model(shot):
    """The camera of a shot as a text model of COLMAP, over points of the ground."""
    rng = np.random.default_rng(2)
    ground = np.column_stack([rng.uniform(-3, 3, 200), np.zeros(200), rng.uniform(-9, -1, 200)])
    model = write_colmap(shot / "model", [shots.camera_pose()], ground)
    middle = f"{shots.WIDTH / 2} {shots.HEIGHT / 2}"
    (model / "cameras.txt").write_text(
        f"1 SIMPLE_PINHOLE {shots.WIDTH} {shots.HEIGHT} 370 {middle}\n"
    )
    return model


@pytest.mark.needs_gl
def test_chunk_under_a_camera_of_colmap_is_the_plain_run(shot):
    given = ["--camera-from", str(add_colmap_model(shot)), "--at", "0.5,0.8", "-q"]
    assert main([*arguments(shot, "anim.glb", *given)]) == 0
    merged = ["merge", str(shot / "merged.mkv"), str(shot / "chunks")]
    assert main([*merged, "--plate", str(shot / "in.mp4"), "--codec", "ffv1", "-q"]) == 0
    plain = [str(shot / "in.mp4"), str(shot / "anim.glb"), str(shot / "plain.mkv")]
    known = ["--fit", str(shot / "fit.json"), "--preset", "realtime", "--codec", "ffv1"]
    assert main([*plain, *known, *given]) == 0
    shots.assert_same_frames(shot / "merged.mkv", shot / "plain.mkv")


@pytest.mark.parametrize("name", TEXT_FILES)
def test_changed_file_of_a_model_of_colmap_changes_the_key(shot, name):
    model = add_colmap_model(shot)
    given = ["anim.glb", "--camera-from", str(model), "--at", "0.5,0.8"]
    before = key(shot, *given)
    (model / "project.ini").write_text("read by COLMAP alone\n")
    assert key(shot, *given) == before
    with (model / name).open("a") as file:
        file.write("# \n")
    assert key(shot, *given) != before
