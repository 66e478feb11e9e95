"""The scene as a whole: cameras, lights, triangles, materials, and files that cannot be used."""

import base64
import json
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from support.glb_builder import QUAD, GlbBuilder

from nlens_video.core.errors import SceneError
from nlens_video.scene import Scene, scene_part
from nlens_video.scene.gltf import document


def load(builder, tmp_path):
    return Scene.load(builder.write(tmp_path / "scene.glb"))


def minimal():
    builder = GlbBuilder()
    builder.node(mesh=builder.mesh())
    return builder


def as_gltf(builder, folder, uri):
    document = {**builder.document, "buffers": [{"byteLength": len(builder.binary), "uri": uri}]}
    path = folder / "scene.gltf"
    path.write_text(json.dumps(document))
    return path


def test_camera_has_the_files_pose_and_vertical_field_of_view(tmp_path):
    builder = minimal()
    builder.node(camera=builder.camera(math.pi / 2), translation=[1, 2, 3], scale=[5, 5, 5])
    camera = load(builder, tmp_path).camera(0.0, 200, 100)
    assert (camera.fx, camera.fy, camera.cx, camera.cy) == pytest.approx((50, 50, 100, 50))
    expected = np.eye(4)
    expected[:3, 3] = [1, 2, 3]
    np.testing.assert_allclose(camera.world_from_camera, expected, atol=1e-9)


def test_unknown_camera_name_error_lists_the_cameras(tmp_path):
    builder = minimal()
    builder.node(camera=builder.camera(0.5, name="wide"))
    builder.node(camera=builder.camera(0.5), name="close", translation=[0, 0, 9])
    scene = load(builder, tmp_path)
    assert scene.camera_names == ("wide", "close")
    assert scene.camera(0.0, 10, 10).world_from_camera[2, 3] == 0.0
    assert scene.camera(0.0, 10, 10, "close").world_from_camera[2, 3] == 9.0
    with pytest.raises(SceneError, match="no camera is named 'x'; expected one of wide, close"):
        scene.camera(0.0, 10, 10, "x")


def test_camera_follows_its_animated_node(tmp_path):
    builder = minimal()
    node = builder.node(camera=builder.camera())
    builder.animation((node, "translation", [0, 2], [[0, 0, 0], [4, 0, 0]], "LINEAR"))
    assert load(builder, tmp_path).camera(1.0, 10, 10).world_from_camera[0, 3] == 2.0


@pytest.mark.parametrize(("aspect", "warned"), [(2.0, False), (1.99, False), (1.9, True)])
def test_camera_of_another_aspect_ratio_is_reported_once(tmp_path, aspect, warned):
    builder = minimal()
    builder.node(camera=builder.camera(aspect=aspect))
    scene = load(builder, tmp_path)
    for time_s in (0.0, 1.0):
        scene.camera(time_s, 200, 100)
    assert sum("aspect ratio" in line for line in scene.warnings) == int(warned)


def test_scene_without_a_camera_error_states_what_to_do(tmp_path):
    scene = load(minimal(), tmp_path)
    assert scene.camera_names == ()
    with pytest.raises(SceneError, match="add one in the modelling program and export it"):
        scene.camera(0.0, 10, 10)


def test_lights_shine_along_minus_z_of_their_nodes(tmp_path):
    builder = minimal()
    half = math.sqrt(0.5)
    builder.light(
        "spot",
        node={"rotation": [-half, 0, 0, half], "translation": [1, 2, 3]},
        intensity=7,
        range=4,
        spot={"outerConeAngle": 0.5},
    )
    (posed,) = load(builder, tmp_path).pose(0.0).lights
    np.testing.assert_allclose(posed.direction, [0, -1, 0], atol=1e-9)
    np.testing.assert_allclose(posed.position, [1, 2, 3])
    assert (posed.light.intensity, posed.light.range, posed.light.outer_cone) == (7, 4, 0.5)


@pytest.mark.parametrize(
    ("mode", "indices", "expected"),
    [
        (4, [0, 1, 2, 0, 2, 3, 1], [[0, 1, 2], [0, 2, 3]]),
        (5, [0, 1, 3, 2], [[0, 1, 3], [1, 2, 3]]),
        (5, [0, 1, 1, 2, 3, 0], [[1, 2, 3], [2, 0, 3]]),
        (6, [0, 1, 2, 3], [[1, 2, 0], [2, 3, 0]]),
    ],
)
def test_strips_and_fans_become_triangles_of_the_same_winding(tmp_path, mode, indices, expected):
    builder = GlbBuilder()
    normals = np.tile(np.array([[0, 0, 1]], np.float32), (4, 1))
    builder.node(mesh=builder.mesh(faces=indices, mode=mode, NORMAL=normals))
    found = load(builder, tmp_path).pose(0.0).meshes[0].faces
    assert [sorted_cycle(f) for f in found.tolist()] == [sorted_cycle(f) for f in expected]


def sorted_cycle(face):
    start = face.index(min(face))
    return face[start:] + face[:start]


def test_point_primitives_are_skipped_with_a_warning(tmp_path):
    builder = minimal()
    builder.node(mesh=builder.mesh(mode=0))
    scene = load(builder, tmp_path)
    assert len(scene.pose(0.0).meshes) == 1
    assert any("points are not drawn" in line for line in scene.warnings)


def test_instances_share_their_geometry(tmp_path):
    builder = GlbBuilder()
    mesh = builder.mesh(NORMAL=np.tile(np.array([[0, 0, 1]], np.float32), (4, 1)))
    builder.node(mesh=mesh)
    builder.node(mesh=mesh, translation=[5, 0, 0])
    posed = load(builder, tmp_path).pose(0.0)
    assert posed.meshes[0].geometry is posed.meshes[1].geometry
    vertices, faces = posed.triangles()
    np.testing.assert_array_equal(vertices[faces[2]], QUAD[[0, 1, 2]] + [5, 0, 0])
    np.testing.assert_array_equal(posed.bounds(), [[-1, -1, 0], [6, 1, 0]])


def test_nodes_outside_the_default_scene_are_not_drawn(tmp_path):
    builder = minimal()
    builder.node(root=False, mesh=builder.mesh(), translation=[50, 0, 0])
    assert len(load(builder, tmp_path).pose(0.0).meshes) == 1


def test_quantised_positions_are_plain_numbers(tmp_path):
    builder = GlbBuilder()
    builder.document["extensionsRequired"] = ["KHR_mesh_quantization"]
    positions = (QUAD * 100).astype(np.int16)
    builder.node(mesh=builder.mesh(positions), scale=[0.01, 0.01, 0.01])
    np.testing.assert_allclose(load(builder, tmp_path).pose(0.0).bounds()[1], [1, 1, 0], atol=1e-6)


def test_material_extensions_are_read(tmp_path):
    builder = GlbBuilder()
    texture = builder.texture(np.zeros((2, 2, 3), np.uint8))
    transform = {"offset": [0.1, 0.2], "scale": [2, 3], "rotation": math.pi / 2, "texCoord": 1}
    info = {"index": texture, "extensions": {"KHR_texture_transform": transform}}
    material = {
        "pbrMetallicRoughness": {"baseColorTexture": info},
        "emissiveFactor": [1, 0.5, 0],
        "extensions": {
            "KHR_materials_emissive_strength": {"emissiveStrength": 4},
            "KHR_materials_unlit": {},
            "KHR_materials_ior": {"ior": 1.0},
        },
    }
    builder.node(mesh=builder.mesh(material=builder.add("materials", material)))
    read = load(builder, tmp_path).pose(0.0).meshes[0].geometry.material
    assert (read.emissive, read.unlit, read.f0) == ((4, 2, 0), True, (0, 0, 0))
    rows = np.array(read.base_color_texture.transform)
    # Scaled by (2, 3), turned by 90 degrees: u' = 3 v + 0.1, v' = -2 u + 0.2.
    np.testing.assert_allclose(rows, [[0, 3, 0.1], [-2, 0, 0.2]], atol=1e-9)
    assert read.base_color_texture.uv_set == 1


def test_shadow_of_glass_lacks_what_it_holds_back(tmp_path):
    builder = GlbBuilder()
    half = builder.texture(np.full((2, 2, 3), 128, np.uint8))
    volume = {"thicknessFactor": 1, "attenuationDistance": 1, "attenuationColor": [0.5] * 3}
    clear = {"transmissionFactor": 0.8, "transmissionTexture": {"index": half}}
    material = {
        "pbrMetallicRoughness": {"baseColorFactor": [0.9, 0.6, 0.3, 0.2], "metallicFactor": 0.5},
        "extensions": {"KHR_materials_transmission": clear, "KHR_materials_volume": volume},
    }
    builder.node(mesh=builder.mesh(material=builder.add("materials", material)))
    read = load(builder, tmp_path).pose(0.0).meshes[0].geometry.material
    through = 0.8 * 128 / 255 * 0.5 * 0.96 * 0.6 * 0.5
    assert read.opacity == pytest.approx(1.0 - through)


@pytest.mark.parametrize(
    "role, picture, through",
    [
        ("base", (188, 188, 188), 0.5),  # sRGB codes, not light
        ("base", (255, 0, 0), 1 / 3),
        ("base", (0, 255, 0), 1 / 3),
        ("metallic_roughness", (0, 255, 0), 1.0),  # packed: no metal by its blue
        ("metallic_roughness", (255, 255, 255), 0.0),
        ("thickness", (0, 0, 0), 1.0),
        ("thickness", (0, 255, 0), 0.5),
        ("transmission", (51, 0, 0), 0.2),
    ],
)
def test_shadow_of_textured_glass_is_the_mean_of_what_comes_through(
    tmp_path, role, picture, through
):
    builder = GlbBuilder()
    texture = {"index": builder.texture(np.full((4, 4, 3), picture, np.uint8))}
    factors = {"metallicFactor": 1.0 if role == "metallic_roughness" else 0.0}
    clear, volume = {"transmissionFactor": 1}, {}
    if role == "base":
        factors["baseColorTexture"] = texture
    elif role == "metallic_roughness":
        factors["metallicRoughnessTexture"] = texture
    elif role == "transmission":
        clear["transmissionTexture"] = texture
    else:
        volume = {
            "thicknessFactor": 1, "attenuationDistance": 1, "attenuationColor": [0.5] * 3,
            "thicknessTexture": texture,
        }  # fmt: skip
    extensions = {
        "KHR_materials_transmission": clear, "KHR_materials_volume": volume,
        "KHR_materials_ior": {"ior": 1.0},
    }  # fmt: skip
    material = {"pbrMetallicRoughness": factors, "extensions": extensions}
    builder.node(mesh=builder.mesh(material=builder.add("materials", material)))
    read = load(builder, tmp_path).pose(0.0).meshes[0].geometry.material
    assert read.opacity == pytest.approx(1.0 - through, abs=0.005)


def test_shadow_of_glass_takes_the_colours_of_its_vertices(tmp_path):
    builder = GlbBuilder()
    extensions = {"KHR_materials_transmission": {"transmissionFactor": 1}}
    material = {
        "pbrMetallicRoughness": {"metallicFactor": 0},
        "extensions": {**extensions, "KHR_materials_ior": {"ior": 1.0}},
    }
    builder.node(mesh=builder.mesh(material=builder.add("materials", material)))
    read = load(builder, tmp_path).pose(0.0).meshes[0].geometry.material
    colors = [[0.2, 0.2, 0.2, 1.0], [0.6, 0.3, 0.0, 0.5], [1.0, 1.0, 1.0, 1.0]]
    assert read.opacities(colors) == pytest.approx([0.8, 0.7, 0.0])


def test_what_the_file_asks_for_and_is_not_drawn_is_said_in_a_line_each(tmp_path):
    builder = minimal()
    variants = {"variants": [{"name": "Midnight"}, {"name": "Beach"}]}
    builder.document["extensions"] = {"KHR_materials_variants": variants}
    used = [
        "KHR_materials_variants",
        "KHR_materials_unlit",
        "X_new",
        "KHR_materials_pbrSpecularGlossiness",
    ]
    builder.document["extensionsUsed"] = used
    builder.document["extensionsRequired"] = used[:2]
    lines = load(builder, tmp_path).warnings
    assert [line.split(":")[0] for line in lines] == [
        "X_new is not supported",
        "KHR_materials_pbrSpecularGlossiness is not supported",
        "the default materials are drawn, none of the variants (Midnight, Beach)",
    ]
    assert "gltf-transform metalrough" in lines[1]


def test_gltf_reads_data_uris_and_files_in_its_folder(tmp_path):
    builder = minimal()
    encoded = base64.b64encode(builder.binary).decode()
    inline = as_gltf(builder, tmp_path, f"data:application/octet-stream;base64,{encoded}")
    assert len(Scene.load(inline).pose(0.0).meshes) == 1
    (tmp_path / "a b.bin").write_bytes(builder.binary)
    assert len(Scene.load(as_gltf(builder, tmp_path, "a%20b.bin")).pose(0.0).meshes) == 1


@pytest.mark.parametrize("uri", ["../x.bin", "sub/../../x.bin", "/etc/hostname", "file:///x.bin"])
def test_gltf_cannot_read_files_outside_its_folder(tmp_path, uri):
    folder = tmp_path / "folder"
    (folder / "sub").mkdir(parents=True)
    (tmp_path / "x.bin").write_bytes(bytes(1000))
    with pytest.raises(SceneError, match=r"leaves the scene's folder|file beside the scene"):
        Scene.load(as_gltf(minimal(), folder, uri))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            {"extensionsRequired": ["KHR_materials_pbrSpecularGlossiness"]},
            "KHR_materials_pbrSpecularGlossiness.*metalrough",
        ),
        ({"extensionsRequired": ["X_unknown"]}, "X_unknown.*export"),
        ({"asset": {"version": "1.0"}}, "glTF 1.0, expected 2.0"),
        ({"asset": {}}, "asset.version is missing"),
        ({"nodes": [{"mesh": 4}]}, r"nodes\[0\].mesh is 4, expected an index below 1"),
        ({"nodes": [{"mesh": 0, "translation": [0, 0]}]}, "expected 3 finite numbers"),
        ({"nodes": [{"mesh": 0, "scale": [1, 1, 1e999]}]}, "Infinity is no JSON number"),
        ({"nodes": [{"mesh": 0, "scale": [1, 1, 10**400]}]}, "3 finite numbers"),
        ({"nodes": [{"mesh": 0, "children": [0]}]}, "parents or is its own"),
        ({"nodes": [{"children": [1]}, {"children": [0], "mesh": 0}]}, "cycle"),
        ({"nodes": [{}]}, "no triangles"),
        ({"nodes": "x"}, "list of objects"),
        ({"meshes": [{"primitives": [{"attributes": {"POSITION": 1}}]}]}, "3 components"),
        ({"scene": 3}, "index below 1"),
    ],
)
def test_unusable_scene_is_refused_in_one_line_with_file_and_reason(tmp_path, change, message):
    builder = minimal()
    builder.document.update(change)
    with pytest.raises(SceneError, match=message) as raised:
        load(builder, tmp_path)
    assert str(raised.value).startswith(str(tmp_path / "scene.glb"))
    assert "\n" not in str(raised.value)


def test_vertex_index_out_of_range_is_refused(tmp_path):
    builder = GlbBuilder()
    builder.node(mesh=builder.mesh(faces=[0, 1, 4]))
    with pytest.raises(SceneError, match="vertex 4 of 4"):
        load(builder, tmp_path)


def large_mesh_without_normals():
    builder = GlbBuilder()
    places = np.random.default_rng(0).random((2000, 3), np.float32)
    targets = [{"POSITION": places} for _ in range(8)]
    builder.node(mesh=builder.mesh(places, np.arange(1998), targets=targets))
    return builder


def test_memory_may_grow_with_the_files_bytes_before_any_of_them_is_read(tmp_path, monkeypatch):
    monkeypatch.setattr(document, "_FREE_BYTES", 0)
    (mesh,) = load(large_mesh_without_normals(), tmp_path).pose(0.0).meshes
    assert len(mesh.positions) == 1998


def test_mesh_that_is_too_large_without_normals_is_refused_with_that_reason(tmp_path, monkeypatch):
    monkeypatch.setattr(document, "_FREE_BYTES", 0)
    monkeypatch.setattr(document, "_GROWTH", 1)
    with pytest.raises(SceneError, match=r"primitives\[0\] would grow .* export normals too"):
        load(large_mesh_without_normals(), tmp_path)
    monkeypatch.setattr(document, "_GROWTH", 16)
    monkeypatch.setattr(scene_part, "MAX_VERTICES", 1900)
    with pytest.raises(SceneError, match=r"more than 1900 vertices .* or export normals too"):
        load(large_mesh_without_normals(), tmp_path)


def test_mesh_with_too_many_instances_is_refused_before_posing(tmp_path):
    builder = GlbBuilder()
    positions = np.tile(QUAD, (5_000, 1))
    mesh = builder.mesh(positions, np.arange(19_998))
    for _ in range(1001):
        builder.node(mesh=mesh)
    builder.document["meshes"][0]["primitives"][0]["attributes"]["NORMAL"] = 0
    with pytest.raises(SceneError, match="vertices in all its nodes"):
        load(builder, tmp_path)


def test_missing_scene_file_is_named(tmp_path):
    with pytest.raises(SceneError, match=r"none\.glb: cannot be read"):
        Scene.load(tmp_path / "none.glb")


@settings(max_examples=150)
@given(st.data())
def test_damaged_file_raises_nothing_but_a_scene_error(tmp_path_factory, data):
    builder = GlbBuilder()
    texture = builder.texture(np.full((2, 2, 3), 200, np.uint8))
    material = builder.add("materials", {"normalTexture": {"index": texture}})
    node = builder.node(mesh=builder.mesh(material=material))
    builder.animation((node, "translation", [0, 1], [[0, 0, 0], [1, 0, 0]], "LINEAR"))
    damaged = bytearray(builder.bytes())
    for _ in range(data.draw(st.integers(1, 6))):
        damaged[data.draw(st.integers(0, len(damaged) - 1))] = data.draw(st.integers(0, 255))
    del damaged[data.draw(st.integers(len(damaged) // 2, len(damaged))) :]
    path = tmp_path_factory.mktemp("damaged") / "scene.glb"
    path.write_bytes(damaged)
    try:
        scene = Scene.load(path)
    except SceneError as error:
        assert "\n" not in str(error)
    else:
        assert scene.pose(0.5).vertices().shape[1] == 3


@pytest.mark.slow
@pytest.mark.needs_truth
def test_published_invalid_files_load_or_are_refused_in_one_line(shared):
    paths = [p for p in (shared / "data/assets").rglob("*") if p.suffix in (".glb", ".gltf")]
    assert len(paths) > 400
    loaded = 0
    for path in paths:
        try:
            Scene.load(path).pose(0.3)
            loaded += 1
        except SceneError as error:
            assert "\n" not in str(error)
    # one more would load, but its bind matrices put every vertex beyond 1e18
    assert loaded >= 70


@pytest.mark.parametrize("name", ["chair.obj", "chair.FBX", "chair.usdz"])
def test_model_in_another_format_is_refused_with_what_to_do(tmp_path, name):
    (tmp_path / name).write_bytes(b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    with pytest.raises(SceneError, match=r"is not read; convert it to \.glb"):
        Scene.load(tmp_path / name)
