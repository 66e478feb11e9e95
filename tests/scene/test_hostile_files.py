"""Hostile scene files are refused in one line, in bounded time and memory."""

import copy
import io
import json
import os
import tracemalloc

import numpy as np
import PIL.Image
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.glb_builder import GlbBuilder
from support.rich_glb import NORMALS, rich

from nlens_video.core.errors import SceneError
from nlens_video.core.objects import Playback
from nlens_video.scene import Scene
from nlens_video.scene.gltf import document


def load(data, folder):
    path = folder / "scene.glb"
    path.write_bytes(data)
    return Scene.load(path)


def use(data, folder):
    """Load and look at a damaged file: it works, or one line says why not."""
    try:
        scene = load(data, folder)
        scene.pose(0.5).vertices()
        scene.triangles(1.0)
        if scene.camera_names:
            scene.camera(0.5, 64, 48)
    except SceneError as error:
        assert "\n" not in str(error)
        return False
    return True


@pytest.fixture
def tight(monkeypatch):
    """The bounds, small enough to be met by a test."""
    monkeypatch.setattr(document, "_FREE_BYTES", 1 << 20)
    monkeypatch.setattr(document, "MAX_TEXTURE_BYTES", 1 << 20)
    monkeypatch.setattr(document, "MAX_FILE_BYTES", 1 << 20)
    monkeypatch.setattr(document, "MAX_JSON_PARTS", 50_000)


def refused(data, folder, line):
    """The file is refused with this line, and nothing large was made on the way."""
    tracemalloc.start()
    try:
        with pytest.raises(SceneError, match=line) as raised:
            load(data, folder)
        peak = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert peak < (24 << 20) + 40 * len(data)
    assert "\n" not in str(raised.value)


def test_undamaged_test_file_loads(tmp_path):
    assert use(rich().bytes(), tmp_path)


def test_truncated_file_is_refused(tmp_path):
    data = rich().bytes()
    for end in range(0, len(data) - 1, 41):
        assert not use(data[:end], tmp_path), end


def test_file_with_a_changed_byte_loads_or_is_refused(tmp_path):
    data = rich().bytes()
    for at in range(0, len(data), 127):
        for value in (0x00, 0xFF, data[at] ^ 0x01):
            use(data[:at] + bytes([value]) + data[at + 1 :], tmp_path)


NASTY = st.sampled_from(
    [-1, 0, 1, 2, 7, 2**31, 2**53, 10**30, -0.5, 1e-30, 1e30, 1e308, True, None, "", "x", "../a",
     [], {}, [0], [1, 0], [[0]], [-1.0] * 3, [0, 0, 0, 0], [1e38] * 16, {"extras": 1}]
)  # fmt: skip


def places(value, path=()):
    """Paths of all members and elements of a JSON value."""
    pairs = value.items() if isinstance(value, dict) else enumerate(value)
    for key, inner in pairs:
        yield (*path, key)
        if isinstance(inner, (dict, list)):
            yield from places(inner, (*path, key))


RICH = rich()
PLACES = list(places(RICH.document))


@settings(max_examples=120)
@given(changes=st.lists(st.tuples(st.sampled_from(PLACES), NASTY), min_size=1, max_size=4))
def test_any_json_value_anywhere_raises_nothing_but_a_scene_error(tmp_path_factory, changes):
    changed = GlbBuilder()
    changed.binary = RICH.binary
    changed.document = copy.deepcopy(RICH.document)
    for path, value in changes:
        owner = changed.document
        for key in path[:-1]:
            inside = isinstance(owner, dict) and key in owner
            inside |= isinstance(owner, list) and isinstance(key, int) and key < len(owner)
            owner = owner[key] if inside else None
        if isinstance(owner, (dict, list)) and (
            isinstance(owner, dict) or path[-1] in range(len(owner))
        ):
            owner[path[-1]] = copy.deepcopy(value)
    use(changed.bytes(), tmp_path_factory.mktemp("nasty"))


@pytest.mark.parametrize("count", [10**6, 10**9, 10**15, 2**62])
def test_size_of_accessors_without_data_is_limited(tmp_path, tight, count):
    builder = rich()
    builder.document["accessors"].append({"componentType": 5126, "count": count, "type": "VEC3"})
    builder.document["meshes"][0]["primitives"][0]["attributes"]["POSITION"] = (
        len(builder.document["accessors"]) - 1
    )
    refused(builder.bytes(), tmp_path, "in memory .*not loaded")


def test_shared_accessors_count_for_each_use_in_the_limit(tmp_path, tight):
    many = GlbBuilder()
    many.node(mesh=many.mesh(np.zeros((2000, 3), np.float32), np.zeros((4000, 3))))
    primitive = many.document["meshes"][0]["primitives"][0]
    many.document["meshes"][0]["primitives"] = [primitive] * 1000
    refused(many.bytes(), tmp_path, r"primitives\[\d+\] would grow")
    primitive["targets"] = [{"POSITION": 0}] * 4000
    many.document["meshes"][0]["primitives"] = [primitive]
    refused(many.bytes(), tmp_path, r"primitives\[0\] would grow")
    moving = GlbBuilder()
    node = moving.node(mesh=moving.mesh())
    for _ in range(500):
        moving.node(mesh=0)
    times = np.arange(4000, dtype=np.float32)
    moving.animation((node, "translation", times, np.zeros((4000, 3)), "LINEAR"))
    clip = moving.document["animations"][0]
    clip["channels"] = [
        {"sampler": 0, "target": {"node": other, "path": "translation"}} for other in range(500)
    ]
    refused(moving.bytes(), tmp_path, r"samplers\[0\] would grow")


def test_number_of_mesh_instances_is_limited(tmp_path, monkeypatch):
    from nlens_video.scene import scene_part as gltf

    monkeypatch.setattr(gltf, "MAX_VERTICES", 4000)
    builder = GlbBuilder()
    mesh = builder.mesh(NORMAL=NORMALS)
    for _ in range(1001):
        builder.node(mesh=mesh)
    refused(builder.bytes(), tmp_path, "more than 4000 vertices in all its nodes")


def test_picture_size_is_checked_before_decoding(tmp_path, tight):
    builder = rich()
    builder.document["images"][0]["bufferView"] = builder.view(png(600, 600))
    refused(builder.bytes(), tmp_path, r"images\[0\] \(600x600\) brings the pictures to 1 MiB")


def test_picture_of_excessive_size_is_refused(tmp_path):
    builder = rich()
    header = bytearray(png(8, 8))
    header[16:24] = (100_000).to_bytes(4, "big") * 2
    header[29:33] = __import__("zlib").crc32(bytes(header[12:29])).to_bytes(4, "big")
    builder.document["images"][0]["bufferView"] = builder.view(bytes(header))
    refused(builder.bytes(), tmp_path, r"images\[0\] cannot be decoded")


def png(width, height):
    file = io.BytesIO()
    PIL.Image.new("1", (width, height)).save(file, "PNG")
    return file.getvalue()


@pytest.mark.parametrize(
    ("data", "told"),
    [
        (b"%!PS-Adobe-3.0 EPSF-3.0\n%%BoundingBox: 0 0 9 9\n%%EndComments\n", "is no PNG, JPEG,"),
        (b"GIF89a" + bytes(50), "is no PNG, JPEG,"),
        (b"DDS " + bytes(200), "is no PNG, JPEG,"),
        (b"", "is empty"),
    ],
)
def test_pictures_of_unsupported_formats_are_not_decoded(tmp_path, data, told):
    builder = rich()
    builder.document["images"][0] |= {"bufferView": builder.view(data), "mimeType": "image/x"}
    stated = r"[^<]*\(its mimeType is 'image/x'\); export it again as PNG or JPEG$"
    refused(builder.bytes(), tmp_path, rf"images\[0\] {told}{stated}")


def test_depth_of_the_node_tree_is_limited(tmp_path):
    builder = GlbBuilder()
    builder.node(mesh=builder.mesh(), children=[1])
    for index in range(1, 2_100):
        builder.node(root=False, **({"children": [index + 1]} if index < 2_099 else {}))
    refused(builder.bytes(), tmp_path, "nested more than 2000 deep")


def test_json_depth_and_number_of_elements_are_limited(tmp_path, tight):
    path = tmp_path / "deep.gltf"
    path.write_text("[" * 40_000)
    with pytest.raises(SceneError, match="JSON is broken"):
        Scene.load(path)
    path.write_text("[" + "{}," * 60_000 + "{}]")
    with pytest.raises(SceneError, match="parts, at most"):
        Scene.load(path)


def test_file_or_device_is_not_read_beyond_the_size_limit(tmp_path, tight):
    (tmp_path / "scene.glb").symlink_to("/dev/zero")
    with pytest.raises(SceneError, match="more than 1 MiB"):
        Scene.load(tmp_path / "scene.glb")


def test_external_files_are_read_once_and_share_a_size_limit(tmp_path, tight):
    builder = GlbBuilder()
    builder.node(mesh=builder.mesh())
    parts = [builder.binary[:]] + [bytes(400_000)] * 3
    buffers, views = [], builder.document["bufferViews"]
    for number, data in enumerate(parts):
        (tmp_path / f"{number}.bin").write_bytes(data)
        buffers.append({"byteLength": len(data), "uri": f"{number}.bin"})
    written = {**builder.document, "buffers": buffers}
    path = tmp_path / "scene.gltf"
    path.write_text(json.dumps(written))
    assert len(Scene.load(path).pose(0.0).meshes) == 1
    for number in (1, 2, 3):
        views.append({"buffer": number, "byteLength": 12})
        written["accessors"].append(
            {"bufferView": len(views) - 1, "componentType": 5126, "count": 1, "type": "VEC3"}
        )
        written["meshes"][0]["primitives"].append(
            {"attributes": {"POSITION": len(written["accessors"]) - 1}}
        )
    path.write_text(json.dumps(written))
    with pytest.raises(SceneError, match=r"buffers\[3\].uri: '3.bin' brings the file to more"):
        Scene.load(path)
    for buffer in buffers[2:]:
        buffer["uri"] = "1.bin"
    path.write_text(json.dumps(written))
    assert len(Scene.load(path).pose(0.0).meshes) == 1


def test_symbolic_link_out_of_the_folder_is_refused(tmp_path):
    builder = GlbBuilder()
    builder.node(mesh=builder.mesh())
    folder = tmp_path / "folder"
    folder.mkdir()
    (tmp_path / "secret.bin").write_bytes(builder.binary)
    (folder / "link.bin").symlink_to(tmp_path / "secret.bin")
    os.mkfifo(folder / "pipe.bin")
    for name, line in (("link.bin", "leaves the scene's folder"), ("pipe.bin", "missing")):
        buffers = [{"byteLength": len(builder.binary), "uri": name}]
        path = folder / "scene.gltf"
        path.write_text(json.dumps({**builder.document, "buffers": buffers}))
        with pytest.raises(SceneError, match=line):
            Scene.load(path)


def test_control_characters_of_names_are_escaped_in_messages(tmp_path):
    builder = rich()
    builder.document["animations"][0]["name"] = "a\nb\x1b[31m"
    (tmp_path / "scene.glb").write_bytes(builder.bytes())
    with pytest.raises(SceneError, match=r"one of a b \[31m$"):
        Scene.load(tmp_path / "scene.glb", Playback(animation="c"))


@pytest.mark.parametrize(
    ("extension", "field", "told"),
    [
        ("KHR_materials_ior", {"ior": -1.0}, "a number from 0 to"),
        ("KHR_materials_emissive_strength", {"emissiveStrength": 1e39}, "a number from 0 to"),
    ],
)
def test_surfaces_that_no_light_can_leave_are_refused(tmp_path, extension, field, told):
    builder = rich()
    builder.document["materials"][0].setdefault("extensions", {})[extension] = field
    refused(builder.bytes(), tmp_path, rf"materials\[0\].*{told}")


@pytest.mark.parametrize(
    ("field", "told"),
    [
        ({"intensity": 1e39}, "a number from 0 to"),
        ({"intensity": -1.0}, "a number from 0 to"),
        ({"color": [1.0, -0.5, 1.0]}, "3 numbers that are not below 0"),
    ],
)
def test_lights_of_impossible_brightness_are_refused(tmp_path, field, told):
    builder = rich()
    lights = builder.document["extensions"]["KHR_lights_punctual"]["lights"]
    lights[0] |= field
    refused(builder.bytes(), tmp_path, rf"lights\[0\].*{told}")


def test_node_of_impossible_scale_is_not_said_to_be_the_camera(tmp_path):
    builder = GlbBuilder()
    builder.node(camera=builder.camera())
    builder.node(mesh=builder.mesh(), scale=[1e30] * 3)
    scene = load(builder.bytes(), tmp_path)
    with pytest.raises(SceneError, match=r"scene\.glb: a node's place or scale lies beyond 1e\+18"):
        scene.camera(0.0, 64, 48)
