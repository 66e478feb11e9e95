"""The object renderer: light, coverage, depth and place against hand-worked values."""

import io
import math

import numpy as np
import PIL.Image
import pytest
from support.glb_builder import QUAD, QUAD_FACES, QUAD_UV, GlbBuilder
from support.quads import LAMBERT, NORMALS, camera_at, material, quad, unlit
from support.quads import draw as draw_with

from nlens_video.core.errors import NlensError
from nlens_video.core.layers import Box
from nlens_video.render.opengl.object_renderer import PyrenderObjectRenderer
from nlens_video.render.software.renderer import SoftwareObjectRenderer
from nlens_video.scene import Camera, Scene
from nlens_video.scene.illumination import Illumination, hemispheres
from nlens_video.scene.scene_light import SceneLight

RENDERERS = {"opengl": PyrenderObjectRenderer, "software": SoftwareObjectRenderer}


@pytest.fixture(
    autouse=True, params=[pytest.param("opengl", marks=pytest.mark.needs_gl), "software"]
)
def renderer_class(request, monkeypatch):
    """Every test of this file is one of each renderer."""
    monkeypatch.setattr(f"{__name__}.ObjectRenderer", RENDERERS[request.param])
    return RENDERERS[request.param]


ObjectRenderer = PyrenderObjectRenderer


def draw(builder, tmp_path, *view, **options):
    return draw_with(ObjectRenderer, builder, tmp_path, *view, **options)


def centre(layer):
    x, y = 32 - layer.box.x0, 32 - layer.box.y0
    return layer.rgba[y, x], layer.depth[y, x]


def test_lambert_surface_has_radiance_albedo_over_pi_times_irradiance(tmp_path):
    builder = GlbBuilder()
    quad(builder, number=material(builder, (0.8, 0.4, 0.2, 1)))
    tilt = [math.sin(math.radians(30)), 0, 0, math.cos(math.radians(30))]  # 60 degrees about x
    builder.light(intensity=5.0, color=[1, 0.5, 0.25], node={"rotation": tilt})
    rgba, _ = centre(draw(builder, tmp_path))
    expected = np.array([0.8, 0.4, 0.2]) * [1, 0.5, 0.25] / math.pi * 5.0 * 0.5
    np.testing.assert_allclose(rgba, [*expected, 1.0], rtol=2e-3)


def test_a_point_light_falls_off_with_the_square_of_its_distance(tmp_path):
    builder = GlbBuilder()
    quad(builder, number=material(builder, (0.5, 0.5, 0.5, 1)))
    place = {"translation": [0.025, -0.025, 3]}  # above the centre of pixel (32, 32)
    builder.light("point", intensity=18.0, node=place)
    rgba, _ = centre(draw(builder, tmp_path))
    np.testing.assert_allclose(rgba[:3], 0.5 / math.pi * 18.0 / 9.0, rtol=2e-3)


def test_a_spot_is_full_inside_its_inner_cone_and_dark_outside_its_outer_cone(tmp_path):
    builder = GlbBuilder()
    quad(builder, number=material(builder))
    cone = {"innerConeAngle": 0.1, "outerConeAngle": 0.2}
    builder.light("spot", intensity=math.pi * 4, spot=cone, node={"translation": [0, 0, 2]})
    layer = draw(builder, tmp_path)
    rgba, _ = centre(layer)
    assert rgba[0] == pytest.approx(1.0, rel=3e-3)
    assert layer.rgba[32 - layer.box.y0, 32 + 15 - layer.box.x0, 0] == 0.0  # 0.75 / 2 > tan(0.2)


def test_a_range_ends_a_point_light(tmp_path):
    builder = GlbBuilder()
    quad(builder, number=material(builder))
    builder.light("point", intensity=9.0, range=2.9, node={"translation": [0, 0, 3]})
    assert centre(draw(builder, tmp_path))[0][0] == 0.0


def test_a_rough_metal_under_a_head_on_light_has_the_ggx_value(tmp_path):
    builder = GlbBuilder()
    number = material(
        builder, (0.9, 0.6, 0.3, 1), {}, pbr={"metallicFactor": 1, "roughnessFactor": 0.5}
    )
    quad(builder, number=number)
    builder.light(intensity=2.0)
    rgba, _ = centre(draw(builder, tmp_path, camera_at(1000.0)))
    # All directions coincide: D = 1 / (pi a^2), V = 1 / 4, F = base colour, a = 0.5^2.
    expected = 2.0 * np.array([0.9, 0.6, 0.3]) / (math.pi * 0.25**2) / 4.0
    np.testing.assert_allclose(rgba[:3], expected, rtol=5e-3)


def test_highlights_above_one_are_kept(tmp_path):
    builder = GlbBuilder()
    quad(builder, number=unlit(builder, (37.5, 2.0, 0.0, 1)))
    np.testing.assert_allclose(centre(draw(builder, tmp_path))[0], [37.5, 2, 0, 1], rtol=1e-3)


def test_emission_is_added_once(tmp_path):
    builder = GlbBuilder()
    strong = {"KHR_materials_emissive_strength": {"emissiveStrength": 3}, **LAMBERT}
    quad(builder, number=material(builder, (0, 0, 0, 1), strong, emissiveFactor=[0.5, 0.2, 1]))
    builder.light(intensity=1.0)
    np.testing.assert_allclose(centre(draw(builder, tmp_path))[0][:3], [1.5, 0.6, 3], rtol=1e-3)


def test_textures_are_decoded_from_srgb_and_row_zero_lies_at_v_zero(tmp_path):
    builder = GlbBuilder()
    rows = np.array([[[188, 0, 0]], [[0, 188, 0]]])
    info = {"index": builder.texture(rows)}
    number = unlit(builder, pbr={"baseColorTexture": info})
    quad(builder, number=number, TEXCOORD_0=QUAD_UV)
    layer = draw(builder, tmp_path)
    column = 32 - layer.box.x0
    upper, lower = layer.rgba[20 - layer.box.y0, column], layer.rgba[44 - layer.box.y0, column]
    linear = ((188 / 255 + 0.055) / 1.055) ** 2.4
    np.testing.assert_allclose(upper, [linear, 0, 0, 1], rtol=2e-3)
    np.testing.assert_allclose(lower, [0, linear, 0, 1], rtol=2e-3)


@pytest.mark.parametrize("least", [9728, 9729, 9984, 9985, 9986, 9987])
def test_a_texture_that_is_smooth_when_enlarged_is_smooth_when_shrunk(tmp_path, least):
    """Texels far smaller than pixels show as their mean, whatever the file's filter saves."""
    builder = GlbBuilder()
    board = np.uint8(255 * (np.indices((512, 512)).sum(axis=0) % 2))[..., None].repeat(3, axis=2)
    info = {"index": builder.texture(board, magFilter=9729, minFilter=least)}
    quad(builder, number=unlit(builder, pbr={"baseColorTexture": info}), TEXCOORD_0=QUAD_UV)
    layer = draw(builder, tmp_path)
    rows, columns = (
        slice(26 - layer.box.y0, 38 - layer.box.y0),
        slice(26 - layer.box.x0, 38 - layer.box.x0),
    )
    np.testing.assert_allclose(layer.rgba[rows, columns, :3], 0.5, atol=0.01)


def test_normal_map_tilts_towards_u_and_up_the_picture(tmp_path):
    tilted = {}
    for name, texel in (("right", [218, 128, 218]), ("up", [128, 218, 218])):
        builder = GlbBuilder()
        info = {"index": builder.texture(np.array([[texel]]))}
        quad(builder, number=material(builder, normalTexture=info), TEXCOORD_0=QUAD_UV)
        half = math.radians(45) / 2
        turn = [0, math.sin(half), 0, math.cos(half)]  # light from +x and +z
        if name == "up":
            turn = [-math.sin(half), 0, 0, math.cos(half)]  # light from +y and +z
        builder.light(intensity=math.pi, node={"rotation": turn})
        tilted[name] = centre(draw(builder, tmp_path))[0][0]
    # The map tilts by 45 degrees: it faces the light.
    assert tilted == {"right": pytest.approx(1, abs=0.01), "up": pytest.approx(1, abs=0.01)}


FOUR = np.array([[[255, 0, 0], [0, 255, 0]], [[0, 0, 255], [255, 255, 255]]])  # a texel a quarter


@pytest.mark.parametrize(
    ("texture", "corner"),
    [
        ({"texCoord": 1}, [0, 0, 1]),  # there all four corners lie in the lower left texel
        ({"extensions": {"KHR_texture_transform": {"offset": [0.5, 0]}}}, [0, 1, 0]),
        # (u, v) becomes (v, -u), which repeats from below.
        ({"extensions": {"KHR_texture_transform": {"rotation": math.pi / 2}}}, [0, 0, 1]),
        ({"extensions": {"KHR_texture_transform": {"scale": [1, 2]}}}, [1, 0, 0]),
        ({"extensions": {"KHR_texture_transform": {"texCoord": 1}}}, [0, 0, 1]),
        ({}, [1, 0, 0]),
    ],
)
def test_texture_coordinates_use_their_set_and_transform(tmp_path, texture, corner):
    builder = GlbBuilder()
    info = {"index": builder.texture(FOUR), **texture}
    second = np.full((4, 2), [0.25, 0.75], np.float32)
    number = unlit(builder, pbr={"baseColorTexture": info})
    quad(builder, number=number, TEXCOORD_0=QUAD_UV, TEXCOORD_1=second)
    layer = draw(builder, tmp_path)
    # Column 14 and row 14 of the frame lie at u = v = 0.06.
    pixel = layer.rgba[14 - layer.box.y0, 14 - layer.box.x0]
    np.testing.assert_allclose(pixel, [*corner, 1], atol=1e-3)


def test_normal_map_scale_is_applied(tmp_path):
    builder = GlbBuilder()
    info = {"index": builder.texture(np.array([[[218, 128, 218]]])), "scale": 0.5}
    quad(builder, number=material(builder, normalTexture=info), TEXCOORD_0=QUAD_UV)
    builder.light(intensity=math.pi)
    rgba, _ = centre(draw(builder, tmp_path))
    assert rgba[0] == pytest.approx(1.0 / math.sqrt(1.0 + 0.5**2), abs=0.01)


def test_ambient_occlusion_darkens_only_ambient_light(tmp_path):
    def around(texel):
        builder = GlbBuilder()
        info = {"index": builder.texture(np.full((1, 1, 3), texel)), "strength": 0.5}
        quad(builder, number=material(builder, occlusionTexture=info), TEXCOORD_0=QUAD_UV)
        scene = Scene.load(builder.write(tmp_path / f"{texel}.glb"))
        light = Illumination((), hemispheres(np.full(3, 0.8), np.full(3, 0.8)))
        with ObjectRenderer(scene, SceneLight(0, light)) as renderer:
            return centre(renderer.render(0.0, camera_at(4.0)))[0][0]

    assert around(255) == pytest.approx(0.8, rel=3e-3)
    assert around(0) == pytest.approx(0.4, rel=3e-3)


@pytest.mark.parametrize(
    ("base", "metallic"),
    [(1.0, 1.0), (0.5, 1.0), (0.0, 0.0)],  # white metal returns all light
)
@pytest.mark.parametrize("roughness", [0.1, 0.2, 0.4, 0.6, 1.0])
@pytest.mark.parametrize("tilt_deg", [0.0, 50.0, 75.0])
def test_surface_in_even_light_reflects_the_integral_of_its_lobe(
    tmp_path, base, metallic, roughness, tilt_deg
):
    builder = GlbBuilder()
    pbr = {"metallicFactor": metallic, "roughnessFactor": roughness}
    half = math.radians(0.5 * tilt_deg)
    node = {"rotation": [0.0, math.sin(half), 0.0, math.cos(half)]}
    quad(builder, number=material(builder, (base, base, base, 1), {}, pbr=pbr), node=node)
    scene = Scene.load(builder.write(tmp_path / "scene.glb"))
    light = Illumination((), hemispheres(np.ones(3), np.ones(3)))
    with ObjectRenderer(scene, SceneLight(0, light)) as renderer:
        rgba, _ = centre(renderer.render(0.0, camera_at(4.0)))
    scale, bias = lobe_integral(math.cos(math.radians(tilt_deg)), roughness)
    f0 = base if metallic else 0.04
    once = f0 * scale + bias
    assert rgba[0] == pytest.approx(once * (1.0 + f0 * (1.0 / (scale + bias) - 1.0)), rel=0.06)


def lobe_integral(view, roughness, count=200):
    """The GGX lobe with Smith's masking over all light: what F0 is multiplied by, what is added."""
    a2 = roughness**4
    u, v = (np.indices((count, count)) + 0.5) / count
    cosine = np.sqrt((1 - u) / (1 + (a2 - 1) * u))  # half vectors, as often as facets face them
    sine = np.sqrt(1 - cosine**2)
    to_half = math.sqrt(1 - view**2) * sine * np.cos(2 * math.pi * v) + view * cosine
    light = 2 * to_half * cosine - view
    seen = (light > 0) & (to_half > 0)
    light = np.where(seen, light, 1.0)
    masked = light * np.sqrt(view**2 * (1 - a2) + a2) + view * np.sqrt(light**2 * (1 - a2) + a2)
    weight = np.where(seen, 2 * light * to_half / (cosine * masked), 0.0)
    edge = (1 - np.clip(to_half, 0, 1)) ** 5
    return ((1 - edge) * weight).mean(), (edge * weight).mean()


@pytest.mark.parametrize("cutoff", [0.3, 0.5, 1.0])
@pytest.mark.parametrize("vertex", [False, True])
def test_surface_whose_alpha_is_that_of_its_cutoff_is_whole(tmp_path, cutoff, vertex):
    builder = GlbBuilder()
    alpha = {"COLOR_0": np.tile(np.float32([1, 1, 1, cutoff]), (4, 1))} if vertex else {}
    color = (1, 1, 1, 1.0 if vertex else cutoff)
    quad(builder, number=unlit(builder, color, alphaMode="MASK", alphaCutoff=cutoff), **alpha)
    layer = draw(builder, tmp_path)
    inner = layer.rgba[4:-4, 4:-4]
    assert inner.size and (inner[..., 3] == 1.0).all()


def test_texture_whose_alpha_is_that_of_the_cutoff_is_whole(tmp_path):
    builder = GlbBuilder()
    texel = np.full((4, 4, 4), (255, 255, 255, 128), np.uint8)
    told = {"pbr": {"baseColorTexture": {"index": builder.texture(texel)}}}
    cut = unlit(builder, alphaMode="MASK", alphaCutoff=128 / 255, **told)
    quad(builder, number=cut, TEXCOORD_0=QUAD_UV)
    layer = draw(builder, tmp_path)
    assert layer is not None and (layer.rgba[4:-4, 4:-4, 3] == 1.0).all()


def test_morph_targets_may_turn_normals_alone(tmp_path):
    def lit(**places):
        builder = GlbBuilder()
        turn = np.tile(np.float32([1, 0, -0.5]), (4, 1))
        mesh = builder.mesh(
            QUAD, QUAD_FACES, material=material(builder), NORMAL=NORMALS,
            targets=[{"NORMAL": turn, **places}], weights=[0.5],
        )  # fmt: skip
        builder.node(mesh=mesh)
        builder.light(intensity=math.pi)
        return centre(draw(builder, tmp_path))[0][0]

    assert lit() == pytest.approx(0.75 / math.hypot(0.5, 0.75), rel=3e-3)
    assert lit(POSITION=np.zeros((4, 3), np.float32)) == lit()


def test_more_than_four_lights_of_a_kind_add_up(tmp_path):
    builder = GlbBuilder()
    quad(builder, number=material(builder))
    for _ in range(6):
        builder.light(intensity=0.1 * math.pi)
        builder.light("point", intensity=0.9 * math.pi, node={"translation": [0.025, -0.025, 3]})
    assert centre(draw(builder, tmp_path))[0][0] == pytest.approx(6 * (0.1 + 0.1), rel=3e-3)


def test_webp_texture_is_drawn(tmp_path):
    builder = GlbBuilder()
    file = io.BytesIO()
    PIL.Image.fromarray(np.full((4, 4, 3), 188, np.uint8)).save(file, "WEBP", lossless=True)
    view = builder.view(file.getvalue())
    image = builder.add("images", {"bufferView": view, "mimeType": "image/webp"})
    texture = builder.add("textures", {"extensions": {"EXT_texture_webp": {"source": image}}})
    builder.document["extensionsRequired"] = ["EXT_texture_webp"]
    number = unlit(builder, pbr={"baseColorTexture": {"index": texture}})
    quad(builder, number=number, TEXCOORD_0=QUAD_UV)
    linear = ((188 / 255 + 0.055) / 1.055) ** 2.4
    np.testing.assert_allclose(centre(draw(builder, tmp_path))[0][:3], linear, rtol=2e-3)


def test_alpha_mode_opaque_ignores_alpha_and_blend_keeps_it(tmp_path):
    for mode, alpha in (("OPAQUE", 1.0), ("BLEND", 0.5)):
        builder = GlbBuilder()
        quad(builder, number=unlit(builder, (0.8, 0.4, 0.2, 0.5), alphaMode=mode))
        rgba, depth = centre(draw(builder, tmp_path))
        expected = np.array([0.8, 0.4, 0.2, 1.0]) * alpha
        np.testing.assert_allclose(rgba, expected, rtol=1e-3)
        assert depth == pytest.approx(4.0, rel=1e-4)


@pytest.mark.parametrize("order", [1, -1])
def test_blended_layers_are_composited_back_to_front_whatever_their_order(tmp_path, order):
    builder = GlbBuilder()
    layers = [((1, 0, 0, 0.5), 1.0), ((0, 1, 0, 0.5), 0.0), ((0, 0, 1, 1.0), -1.0)]
    for color, z in layers[::order]:
        mode = "BLEND" if color[3] < 1 else "OPAQUE"
        quad(builder, number=unlit(builder, color, alphaMode=mode), node={"translation": [0, 0, z]})
    rgba, depth = centre(draw(builder, tmp_path))
    np.testing.assert_allclose(rgba, [0.5, 0.25, 0.25, 1.0], rtol=1e-3)
    assert depth == pytest.approx(3.0, rel=1e-4)


@pytest.mark.parametrize(("alpha", "drawn"), [(0.39, False), (0.4, True), (0.41, True)])
def test_alpha_mode_mask_is_opaque_at_and_above_the_cutoff(tmp_path, alpha, drawn):
    builder = GlbBuilder()
    quad(builder, number=unlit(builder, (1, 1, 1, alpha), alphaMode="MASK", alphaCutoff=0.4))
    rgba, depth = centre(draw(builder, tmp_path))
    assert rgba.tolist() == [float(drawn)] * 4
    assert np.isfinite(depth) == drawn


def test_back_faces_are_culled_unless_double_sided_and_then_lit_from_behind(tmp_path):
    for double_sided in (False, True):
        builder = GlbBuilder()
        number = material(builder, doubleSided=double_sided)
        quad(builder, number=number, node={"rotation": [0, 1, 0, 0]})
        builder.light(intensity=math.pi)
        rgba, _ = centre(draw(builder, tmp_path))
        np.testing.assert_allclose(rgba, [float(double_sided)] * 4, atol=2e-3)


@pytest.mark.parametrize("behind", [False, True])
def test_far_things_do_not_cut_near_ones_away(tmp_path, behind):
    builder = GlbBuilder()
    number = unlit(builder, (0.5, 0.25, 0.75, 1))
    quad(builder, number=number)
    near_rgba, near_depth = centre(draw(builder, tmp_path))
    quad(builder, number=number, node={"translation": [900.0, 0.0, -9000.0]})
    if behind:
        quad(builder, number=number, node={"translation": [0.0, 0.0, 50.0]})
    rgba, depth = centre(draw(builder, tmp_path))
    np.testing.assert_allclose(rgba, near_rgba, atol=2e-3)
    assert depth == pytest.approx(near_depth, rel=1e-3)


def test_mirrored_node_shows_its_front_faces(tmp_path):
    builder = GlbBuilder()
    quad(builder, number=material(builder), node={"scale": [-1, 1, 1]})
    builder.light(intensity=math.pi)
    np.testing.assert_allclose(centre(draw(builder, tmp_path))[0], 1.0, atol=2e-3)


def turned(degrees):
    half = math.radians(degrees) / 2
    return {"rotation": [0, 0, math.sin(half), math.cos(half)]}


def test_edge_pixels_are_premultiplied_and_have_depth(tmp_path):
    builder = GlbBuilder()
    quad(builder, number=unlit(builder, (3.0, 1.0, 0.5, 1)), node=turned(17))
    layer = draw(builder, tmp_path)
    alpha = layer.rgba[..., 3]
    assert ((alpha > 0) & (alpha < 1)).sum() > 40
    np.testing.assert_allclose(layer.rgba[..., :3], alpha[..., None] * [3, 1, 0.5], rtol=2e-3)
    np.testing.assert_array_equal(np.isfinite(layer.depth), alpha > 0)
    np.testing.assert_allclose(layer.depth[alpha > 0], 4.0, rtol=1e-4)


@pytest.mark.parametrize("shift", [0.0, 0.13, 0.37, 0.5])
def test_rendered_vertices_lie_where_the_camera_projects_them(tmp_path, shift):
    builder = GlbBuilder()
    place = {"translation": [(3 + shift) / 20, -(5 + shift) / 20, 0], **turned(17)}
    quad(builder, number=unlit(builder), node=place)
    layer = draw(builder, tmp_path)
    alpha = layer.rgba[..., 3].astype(float)
    rows, columns = np.indices(alpha.shape) + 0.5
    x = (alpha * columns).sum() / alpha.sum() + layer.box.x0
    y = (alpha * rows).sum() / alpha.sum() + layer.box.y0
    assert (x, y) == pytest.approx((32 + 3 + shift, 32 + 5 + shift), abs=0.05)
    assert alpha.sum() == pytest.approx(1600.0, rel=2e-3)


def test_depth_of_a_slanted_surface_is_taken_at_the_pixel_centre(tmp_path):
    builder = GlbBuilder()
    slanted = QUAD * [1, 1, 0] + np.array([[0, 0, 0.4]]) * QUAD[:, :1]
    quad(builder, slanted, number=unlit(builder, doubleSided=True))
    layer = draw(builder, tmp_path)
    columns = np.arange(layer.box.x0, layer.box.x1) + 0.5 - 32
    # z = 0.4 x and x = (4 - z) c / 80 for column c: depth = 4 / (1 + 0.4 c / 80).
    expected = np.broadcast_to(4 / (1 + 0.4 * columns / 80), layer.depth.shape)
    inside = layer.rgba[..., 3] == 1
    assert inside.sum() > 1000
    np.testing.assert_allclose(layer.depth[inside], expected[inside], rtol=1e-4)


def test_edge_pixel_of_a_near_surface_has_its_depth_and_not_an_average(tmp_path):
    builder = GlbBuilder()
    white = unlit(builder)
    quad(builder, number=white, node={"scale": [9, 9, 1], "translation": [0, 0, -4]})
    quad(builder, number=white, node=turned(17))
    layer = draw(builder, tmp_path)
    assert {4.0, 8.0} == set(np.round(layer.depth[layer.rgba[..., 3] > 0], 3).tolist())


@pytest.mark.parametrize("scale", [1e-6, 1e6])
def test_picture_does_not_depend_on_the_scenes_unit(tmp_path, scale):
    def at(size):
        builder = GlbBuilder()
        ramp = QUAD * [1, 1, 0] + np.array([[0, 0, 0.4]]) * QUAD[:, :1]
        quad(builder, ramp, number=material(builder), node={"scale": [size] * 3})
        builder.light(intensity=math.pi)
        pose = np.eye(4)
        pose[2, 3] = 4 * size
        view = Camera(world_from_camera=pose, fx=80, fy=80, cx=32, cy=32, width=64, height=64)
        return draw(builder, tmp_path, view)

    unit, other = at(1.0), at(scale)
    assert unit.box == other.box
    np.testing.assert_allclose(other.rgba, unit.rgba, atol=1e-3)
    inside = unit.rgba[..., 3] == 1
    np.testing.assert_allclose(other.depth[inside] / scale, unit.depth[inside], rtol=1e-4)


def test_rendered_box_equals_the_same_part_of_the_whole_frame(tmp_path):
    def at(x):
        builder = GlbBuilder()
        number = unlit(builder)
        quad(builder, number=number, node=turned(17))
        if x:  # a far triangle that makes the box larger
            quad(builder, number=number, node={"translation": [x, x, 0], "scale": [0.1, 0.1, 1]})
        return draw(builder, tmp_path)

    small, large = at(0.0), at(1.5)
    assert large.box.width > small.box.width
    np.testing.assert_array_equal(large.rgba[small.box.slices_in(large.box)], small.rgba)


def test_rendered_box_is_the_objects_bounds_plus_one_pixel(tmp_path):
    builder = GlbBuilder()
    quad(builder, number=unlit(builder))
    assert draw(builder, tmp_path).box == Box(11, 11, 53, 53)


def test_object_is_rendered_beyond_the_frame_up_to_the_margin(tmp_path):
    builder = GlbBuilder()
    quad(builder, number=unlit(builder), node={"translation": [-1.6, 0, 0]})
    inside, beyond = draw(builder, tmp_path), draw(builder, tmp_path, margin=12)
    assert (inside.box.x0, beyond.box.x0) == (0, -12)
    np.testing.assert_array_equal(beyond.rgba[inside.box.slices_in(beyond.box)], inside.rgba)
    assert (beyond.rgba[20, :12] == 1).all()


def test_object_out_of_view_or_behind_the_camera_gives_no_layer(tmp_path):
    for place in ([50, 0, 0], [0, 0, 9]):
        builder = GlbBuilder()
        quad(builder, number=unlit(builder), node={"translation": place})
        assert draw(builder, tmp_path) is None


def test_object_around_the_camera_is_clipped(tmp_path):
    builder = GlbBuilder()
    floor = np.array([[-9, -1, 9], [9, -1, 9], [9, -1, -9], [-9, -1, -9]], np.float32)
    quad(builder, floor, number=unlit(builder, doubleSided=True))
    layer = draw(builder, tmp_path)
    assert layer.box == Box(0, 0, 64, 64)
    column = layer.rgba[:, 32, 3]
    assert (column[0], column[63]) == (0, 1)
    # At row centre r the floor, 1 below the eye, is 80 / (r - 32) away.
    assert layer.depth[63, 32] == pytest.approx(80 / 31.5, rel=1e-3)


def test_shifted_eye_and_principal_point_keep_the_focal_plane_in_place(tmp_path):
    builder = GlbBuilder()
    quad(builder, number=unlit(builder), node=turned(17))
    straight = camera_at(4.0)
    pose = straight.world_from_camera.copy()
    pose[0, 3] = 0.3
    sheared = camera_at(4.0, cx=32 + 0.3 * 80 / 4)
    sheared = Camera(
        world_from_camera=pose, fx=80, fy=80, cx=sheared.cx, cy=32, width=64, height=64
    )
    a, b = draw(builder, tmp_path, straight), draw(builder, tmp_path, sheared)
    assert a.box == b.box
    np.testing.assert_allclose(a.rgba, b.rgba, atol=1e-6)  # the focal plane stands still


def test_animated_pictures_repeat_exactly_when_vertices_are_updated(tmp_path):
    builder = GlbBuilder()
    node = quad(builder, number=unlit(builder))
    values = [[0, 0, 0], [0.5, 0, 0]]
    builder.animation((node, "translation", [0, 1], values, "LINEAR"))
    scene = Scene.load(builder.write(tmp_path / "scene.glb"))
    with ObjectRenderer(scene) as renderer:
        first = renderer.render(0.0, camera_at(4.0))
        moved = renderer.render(1.0, camera_at(4.0))
        again = renderer.render(0.0, camera_at(4.0))
    assert (first.box.x0, moved.box.x0) == (11, 21)
    np.testing.assert_array_equal(first.rgba, again.rgba)
    np.testing.assert_array_equal(first.depth, again.depth)


def test_two_renderers_work_side_by_side_even_after_one_is_closed(tmp_path):
    builder = GlbBuilder()
    quad(builder, number=unlit(builder))
    scene = Scene.load(builder.write(tmp_path / "scene.glb"))
    with ObjectRenderer(scene) as one:
        before = one.render(0.0, camera_at(4.0))
        with ObjectRenderer(scene) as two:
            two.render(0.0, camera_at(4.0))
        np.testing.assert_array_equal(one.render(0.0, camera_at(4.0)).rgba, before.rgba)


def test_scene_without_lights_is_lit_by_default_with_a_note(tmp_path):
    builder = GlbBuilder()
    quad(builder, number=material(builder, (0.5, 0.5, 0.5, 1), {}))
    scene = Scene.load(builder.write(tmp_path / "scene.glb"))
    with ObjectRenderer(scene) as renderer:
        rgba, _ = centre(renderer.render(0.0, camera_at(4.0)))
        assert "the plate's own light" in renderer.light_note
    assert 0.05 < rgba[0] < 1.0


def test_closed_renderer_refuses_to_render(tmp_path):
    builder = GlbBuilder()
    quad(builder, number=unlit(builder))
    renderer = ObjectRenderer(Scene.load(builder.write(tmp_path / "scene.glb")))
    renderer.render(0.0, camera_at(4.0))
    renderer.close()
    renderer.close()
    with pytest.raises(NlensError, match="closed"):
        renderer.render(0.0, camera_at(4.0))


def test_unchanged_scene_returns_the_last_layer_and_any_change_renders_again(tmp_path):
    builder = GlbBuilder()
    node = quad(builder, number=material(builder))
    light = builder.light(intensity=2.0)
    keys = np.array([[0, 0, 0], [0, 0, 0], [0.5, 0, 0]], np.float32)
    turns = np.array([[0, 0, 0, 1], [0, 0, 0, 1], [0, 0, 0, 1], [0.6, 0, 0, 0.8]], np.float32)
    builder.animation(
        (node, "translation", [0, 1, 2], keys, "LINEAR"),
        (light, "rotation", [0, 1, 2, 3], turns, "LINEAR"),
    )
    scene = Scene.load(builder.write(tmp_path / "scene.glb"))
    with ObjectRenderer(scene) as renderer:
        first = renderer.render(0.0, camera_at(4.0))
        before = first.rgba.copy()
        assert renderer.render(0.5, camera_at(4.0)) is first
        np.testing.assert_array_equal(first.rgba, before)
        for time_s, camera, margin in (
            (0.5, camera_at(4.5), 0),
            (0.5, camera_at(4.0, cx=33.0), 0),
            (0.5, camera_at(4.0), 3),
            (1.5, camera_at(4.0), 0),
            (2.0, camera_at(4.0), 0),
            (3.0, camera_at(4.0), 0),  # only the light has turned
        ):
            last = first
            first = renderer.render(time_s, camera, margin)
            assert first is not last
    with ObjectRenderer(scene) as fresh:
        again = fresh.render(3.0, camera_at(4.0))
    np.testing.assert_array_equal(again.rgba, first.rgba)
    np.testing.assert_array_equal(again.depth, first.depth)


STILLS = [f"{s}_{f}" for s in ("indoor", "street", "table") for f in ("front", "mid", "back")]


@pytest.mark.needs_truth
@pytest.mark.parametrize("name", STILLS)
def test_alpha_and_depth_agree_with_a_path_tracer(shared, name):
    import OpenEXR

    folder = shared / "data/cycles/dev" / name
    with OpenEXR.File(str(folder / "object.exr"), separate_channels=True) as file:
        channels = {key: channel.pixels for key, channel in file.channels().items()}
    alpha, depth = channels["A"].astype(np.float32), channels["Z"]
    scene = Scene.load(folder / "object.glb")
    with ObjectRenderer(scene) as renderer:
        layer = renderer.render(0.0, scene.camera(0.0, 960, 512))
    place = layer.box.slices_in(Box(0, 0, 960, 512))
    ours = np.zeros_like(alpha)
    ours[place] = layer.rgba[..., 3]
    mine, theirs = ours > 0.5, alpha > 0.5
    assert (mine & theirs).sum() / (mine | theirs).sum() > 0.985
    # Four samples give alpha in quarters: a half is a tie that either side may win.
    decided = ours != 0.5
    assert (mine & theirs & decided).sum() / ((mine | theirs) & decided).sum() > 0.995
    # Away from edges, where the two differ in what a pixel's depth is.
    solid = (layer.rgba[..., 3] == 1) & (alpha[place] > 0.999)
    error = np.abs(layer.depth[solid] / depth[place][solid] - 1)
    assert solid.sum() > 10_000
    assert np.mean(error > 2e-3) < 0.02
    assert np.median(error) < 2e-4
