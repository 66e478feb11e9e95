"""Patches of the object's surface: they cover it evenly, and move and look as it does."""

import tracemalloc

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace
from support.calls import calls_of
from support.glb_builder import QUAD, QUAD_UV, GlbBuilder

from nlens_video.scene import Scene
from nlens_video.scene.patches import COUNT, Patches, points_by_area

RED = (0.8, 0.1, 0.05, 1.0)


def scene_of(tmp_path, sizes=(1.0,)):
    """Quads beside each other, each so many times as large, of one material."""
    builder = GlbBuilder()
    chosen = {"pbrMetallicRoughness": {"baseColorFactor": list(RED)}}
    mesh = builder.mesh(material=builder.add("materials", chosen))
    for number, size in enumerate(sizes):
        builder.node(mesh=mesh, translation=[3.0 * number, 0, 0], scale=[size, size, 1.0])
    return Scene.load(builder.write(tmp_path / "scene.glb")).pose(0.0)


def test_patches_stand_for_the_whole_area(tmp_path):
    posed = scene_of(tmp_path, sizes=(1.0, 0.5))
    found = Patches.of(posed).at(posed)
    sides = np.ptp(QUAD, axis=0)
    assert found.areas.sum() == pytest.approx(1.25 * sides[0] * sides[1], rel=1e-5)
    assert COUNT <= len(found.points) <= COUNT + 2
    np.testing.assert_allclose(found.colors, np.broadcast_to(RED[:3], found.colors.shape))


def test_larger_part_of_the_surface_has_more_patches(tmp_path):
    posed = scene_of(tmp_path, sizes=(1.0, 0.5))
    found = Patches.of(posed).at(posed)
    second = found.points[:, 0] > 1.5
    assert second.sum() == pytest.approx(0.2 * len(found.points), abs=2)


def test_patches_turn_and_grow_with_their_mesh(tmp_path):
    posed = scene_of(tmp_path)
    patches = Patches.of(posed)
    before = patches.at(posed)
    turn = np.array([[0.0, 0.0, 2.0], [0.0, 2.0, 0.0], [-2.0, 0.0, 0.0]])  # and twice as large
    mesh = posed.meshes[0]
    turned = replace(
        mesh, positions=(mesh.positions @ turn.T + 5.0).astype(np.float32),
        normals=(mesh.normals @ turn.T / 2.0).astype(np.float32),
    )  # fmt: skip
    after = patches.at(replace(posed, meshes=(turned,)))
    np.testing.assert_allclose(after.points, before.points @ turn.T + 5.0, atol=1e-5)
    np.testing.assert_allclose(after.normals, before.normals @ turn.T / 2.0, atol=1e-6)
    np.testing.assert_allclose(after.areas, 4.0 * before.areas, rtol=1e-5)


def test_color_is_that_of_the_texture_where_the_patch_lies(tmp_path):
    builder = GlbBuilder()
    pixels = np.zeros((64, 64, 4), np.uint8)
    pixels[..., 3] = 255
    pixels[:, :32] = (255, 0, 0, 255)
    pixels[:, 32:] = (0, 188, 0, 255)  # half the light
    uv = (QUAD[:, :2] - QUAD[:, :2].min(axis=0)) / np.ptp(QUAD[:, :2], axis=0)
    texture = builder.texture(pixels)
    chosen = {"pbrMetallicRoughness": {"baseColorTexture": {"index": texture}}}
    material = builder.add("materials", chosen)
    builder.node(mesh=builder.mesh(material=material, TEXCOORD_0=uv.astype(np.float32)))
    posed = Scene.load(builder.write(tmp_path / "scene.glb")).pose(0.0)
    found = Patches.of(posed).at(posed)
    left = found.points[:, 0] < QUAD[:, 0].mean()
    assert left.mean() == pytest.approx(0.5, abs=0.05)
    np.testing.assert_allclose(found.colors[left], [[1.0, 0.0, 0.0]] * left.sum(), atol=1e-6)
    np.testing.assert_allclose(found.colors[~left], [[0.0, 0.5, 0.0]] * (~left).sum(), atol=0.01)


def test_half_transparent_surface_sends_half_back(tmp_path):
    builder = GlbBuilder()
    color = {"pbrMetallicRoughness": {"baseColorFactor": [1.0, 1.0, 1.0, 0.5]}}
    material = builder.add("materials", {**color, "alphaMode": "BLEND"})
    builder.node(mesh=builder.mesh(material=material))
    posed = Scene.load(builder.write(tmp_path / "scene.glb")).pose(0.0)
    np.testing.assert_allclose(Patches.of(posed).at(posed).colors, 0.5)


def test_patches_of_a_mesh_that_grows_from_nothing_stand_for_its_area(tmp_path):
    whole = scene_of(tmp_path)
    mesh = whole.meshes[0]
    nothing = replace(whole, meshes=(replace(mesh, positions=np.zeros_like(mesh.positions)),))
    patches = Patches.of(nothing)
    assert patches.at(nothing).areas.sum() == 0.0
    assert patches.at(whole).areas.sum() == pytest.approx(4.0, rel=1e-5)


def test_triangles_of_no_extent_have_no_patches(tmp_path):
    builder = GlbBuilder()
    nowhere = np.zeros_like(QUAD)
    builder.node(mesh=builder.mesh(nowhere, targets=[{"POSITION": nowhere}]))
    posed = Scene.load(builder.write(tmp_path / "scene.glb")).pose(0.0)
    assert Patches.of(posed).at(posed).points.shape == (0, 3)


@given(st.lists(st.sampled_from([0.0, 1e-30, 1e-3, 1.0, 1e12]), min_size=1, max_size=30))
def test_points_lie_on_triangles_that_have_extent_as_often_as_they_are_large(areas):
    areas = np.array(areas)
    chosen, along, aside = points_by_area(areas, 400)
    assert (along >= 0.0).all() and (aside >= 0.0).all() and (along + aside <= 1.0).all()
    if areas.any():
        assert (areas[chosen] > 0.0).all()
        share = np.bincount(chosen, minlength=len(areas)) / 400
        np.testing.assert_allclose(share, areas / areas.sum(), atol=1 / 400 + 1e-9)
    else:
        assert (chosen == 0).all()


def test_color_of_a_large_texture_is_that_around_the_patch(tmp_path):
    """Of a texture of many texels a part is looked at: its memory does not grow with it."""
    builder = GlbBuilder()
    pixels = np.zeros((2048, 2048, 3), np.uint8)
    pixels[1024:] = (255, 128, 0)
    texture = builder.texture(pixels)
    chosen = {"pbrMetallicRoughness": {"baseColorTexture": {"index": texture}}}
    material = builder.add("materials", chosen)
    builder.node(mesh=builder.mesh(material=material, TEXCOORD_0=QUAD_UV))
    posed = Scene.load(builder.write(tmp_path / "scene.glb")).pose(0.0)
    tracemalloc.start()
    found = Patches.of(posed).at(posed)
    _, most = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert most < 8e6
    low = found.points[:, 1] < -0.05  # the lower half of the picture lies there
    np.testing.assert_allclose(found.colors[low][:, 0], 1.0, atol=0.02)
    np.testing.assert_allclose(found.colors[found.points[:, 1] > 0.05], 0.0, atol=0.02)


def test_mesh_more_costs_the_patches_few_calls(tmp_path):
    def calls(count):
        posed = scene_of(tmp_path, sizes=[1.0] * count)
        patches = Patches.of(posed)
        return calls_of(lambda: patches.at(posed))

    assert calls(40) - calls(20) <= 20 * 8
