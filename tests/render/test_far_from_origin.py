"""Objects at coordinates that float32 holds badly, such as UTM's: drawn as they are elsewhere."""

import numpy as np
import pytest
from support import shots
from support.glb_builder import QUAD, GlbBuilder
from support.quads import NORMALS, camera_at, material, quad

from nlens_video import Compositor
from nlens_video.core.lens_fit import LensFit
from nlens_video.render.opengl.object_renderer import PyrenderObjectRenderer
from nlens_video.render.software.renderer import SoftwareObjectRenderer
from nlens_video.scene import Scene
from nlens_video.scene.screen_projection import extent

UTM = (500_000.3, 120.0, -4_649_776.7)
HERE = (0.0, 0.0, 0.0)
FIT = LensFit(slope=shots.SLOPE, intercept=shots.INTERCEPT, width=shots.WIDTH, height=shots.HEIGHT)


@pytest.fixture(params=[pytest.param("opengl", marks=pytest.mark.needs_gl), "software"])
def renderer_class(request):
    return {"opengl": PyrenderObjectRenderer, "software": SoftwareObjectRenderer}[request.param]


def loaded(builder, tmp_path, at, children):
    """The scene whose nodes all hang on one that stands at a place."""
    builder.node(children=children, translation=list(at))
    root = len(builder.document["nodes"]) - 1
    builder.document["scenes"][0]["nodes"] = [root]
    return Scene.load(builder.write(tmp_path / f"at_{at[0]:.0f}.glb"))


def moving_card(tmp_path, at):
    """A card that goes to the right by 0.5 units a second, under a lamp."""
    builder = GlbBuilder()
    card = quad(builder, number=material(builder, (0.5, 0.5, 0.5, 1)))
    times, ways = np.array([0, 2], np.float32), np.array([[0, 0, 0], [1, 0, 0]], np.float32)
    sampler = {"input": builder.accessor(times), "output": builder.accessor(ways)}
    target = {"node": card, "path": "translation"}
    channel = {"sampler": 0, "target": target}
    builder.document["animations"] = [{"samplers": [sampler], "channels": [channel]}]
    builder.light("point", intensity=18.0, node={"translation": [0, 0, 3]})
    lamp = len(builder.document["nodes"]) - 1
    return loaded(builder, tmp_path, at, [card, lamp])


def seen_from(at):
    """A camera before a place; no border of the card lies between two pixels."""
    return camera_at(4.0, cx=32.3, cy=31.6).about(-np.array(at))


def test_object_is_lit_and_drawn_as_near_the_origin(renderer_class, tmp_path):
    near, far = moving_card(tmp_path, HERE), moving_card(tmp_path, UTM)
    with renderer_class(near) as one, renderer_class(far) as other:
        for time_s in (0.0, 0.04, 0.333, 1.0):
            expected = one.render(time_s, seen_from(HERE))
            found = other.render(time_s, seen_from(UTM))
            assert found.box == expected.box
            np.testing.assert_allclose(found.rgba, expected.rgba, atol=2e-3)
            np.testing.assert_allclose(found.depth, expected.depth, rtol=1e-5)


def test_views_of_a_lens_are_drawn_as_near_the_origin(renderer_class, tmp_path):
    layers = {}
    for at in (HERE, UTM):
        beside = [seen_from((at[0] - shift, *at[1:])) for shift in (-0.1, 0.1)]
        with renderer_class(moving_card(tmp_path, at)) as renderer:
            renderer.render_views(
                0.04, beside, 0, lambda index, layer, at=at: layers.update({(at, index): layer})
            )
    for index in (0, 1):
        found, expected = layers[UTM, index], layers[HERE, index]
        np.testing.assert_allclose(found.rgba, expected.rgba, atol=2e-3)


def test_object_at_rest_is_drawn_once(renderer_class, tmp_path):
    with renderer_class(moving_card(tmp_path, UTM)) as renderer:
        assert renderer.render(3.0, seen_from(UTM)) is renderer.render(4.0, seen_from(UTM))


def test_places_bounds_and_footprint_are_exact(tmp_path):
    near, far = moving_card(tmp_path, HERE), moving_card(tmp_path, UTM)
    posed, there = near.pose(0.04), far.pose(0.04)
    expected = posed.vertices() + np.array(UTM)
    np.testing.assert_allclose(there.vertices(), expected, rtol=0, atol=1e-6)
    moved = near.triangles(0.04) + np.array(UTM)
    np.testing.assert_allclose(far.triangles(0.04), moved, rtol=0, atol=1e-6)
    ours, theirs = extent(there, seen_from(UTM)), extent(posed, seen_from(HERE))
    assert ours.low == pytest.approx(theirs.low, abs=1e-3)
    assert ours.nearest == pytest.approx(theirs.nearest, rel=1e-5)


def test_skinned_mesh_is_placed_exactly(tmp_path):
    found = {}
    for at in (HERE, UTM):
        builder = GlbBuilder()
        joints = np.array([[0, 1, 0, 0]] * 4, np.uint8)
        weights = np.array([[0.25, 0.75, 0, 0]] * 4, np.float32)
        mesh = builder.mesh(QUAD, NORMAL=NORMALS, JOINTS_0=joints, WEIGHTS_0=weights)
        bones = [builder.node(translation=[0.1 * k, 0.2, 0.3]) for k in (1, 2)]
        carried = builder.node(mesh=mesh, skin=builder.skin(bones, np.stack([np.eye(4)] * 2)))
        found[at] = loaded(builder, tmp_path, at, [*bones, carried]).pose(0.0).vertices()
    np.testing.assert_allclose(found[UTM] - np.array(UTM), found[HERE], rtol=0, atol=1e-6)


def test_shadow_far_from_the_origin_is_that_near_it_and_does_not_tremble(tmp_path):
    """A cube slides under a sun on ground that is out of focus."""
    pictures = {}
    for at in (None, UTM):
        glb = shots.cube_glb(
            tmp_path / f"{at is None}.glb", end=(0.05, 0.0, -1.6), seconds=1.0, origin=at
        )
        options = {"preset": "standard", "effects": "defocus,shadow", "shadow_strength": 1.0}
        with Compositor(glb, fit=FIT, fps=25, **options) as lens:
            pictures[at] = [lens.process(shots.plate()) for _ in range(4)]
    for found, expected in zip(pictures[UTM], pictures[None], strict=True):
        difference = np.abs(found.astype(int) - expected)
        assert difference.max() <= 2
        assert (expected != shots.plate()).any(axis=2).mean() > 0.02


@pytest.mark.parametrize("place", [0.0, 40.0, 300.0])
def test_ordinary_coordinates_are_left_as_they_are(tmp_path, place):
    posed = moving_card(tmp_path, (place, 0.0, 0.0)).pose(0.04)
    assert posed.origin is None and posed.about_origin() is posed
    assert posed.vertices().dtype == np.float32


def test_skin_whose_joints_carry_nothing_has_no_origin(tmp_path):
    builder = GlbBuilder()
    joints, weights = np.zeros((4, 4), np.uint8), np.zeros((4, 4), np.float32)
    mesh = builder.mesh(JOINTS_0=joints, WEIGHTS_0=weights, NORMAL=NORMALS)
    builder.node(mesh=mesh, skin=builder.skin([builder.node()], [np.eye(4)]))
    assert Scene.load(builder.write(tmp_path / "a.glb")).pose(0.0).origin is None
