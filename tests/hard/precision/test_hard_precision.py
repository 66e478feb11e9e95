"""Error of every float32 kernel against float64."""

import copy
import math
import re
from functools import cache
from pathlib import Path

import numpy as np
from hard.catalogue import Outcome, at_most, case, exactly
from hard.drawing import OURS, bars, plot
from hard.objects import folder
from support import shading_block as at
from support.definitions import (
    covariance_by_points,
    edge_parallax_by_pixels,
    marked,
    paper_scatter_by_pixels,
    pull_push,
)
from support.glb_builder import GlbBuilder
from support.light_views import made_maps, made_points
from support.rasteriser import (
    NOTHING_AROUND,
    atlas_of,
    drawn,
    layered_block,
    layered_surface,
    random_block,
    resolved,
    surface,
    truth,
)

import nlens_video
from nlens_video.core.color import ColorTags
from nlens_video.core.layers import Box
from nlens_video.core.lens_fit import LensFit
from nlens_video.core.optics import Aperture
from nlens_video.effects import light_change
from nlens_video.effects.camera.grain import (
    regrain,
    regrain_reference,
    tiled,
    tiled_reference,
    white_noise,
    white_noise_reference,
)
from nlens_video.effects.camera.grain_restore import restore_grain, restore_grain_reference
from nlens_video.effects.shadow.bounce import gather_patches_reference
from nlens_video.effects.shadow.coverage import covered_reference
from nlens_video.effects.shadow.shadow_maps import blocked
from nlens_video.effects.shadow.things_ref import (
    best_slopes_reference,
    blocked_reference,
    first_surfaces_reference,
    lost_light_reference,
)
from nlens_video.effects.shadow.transparency import absorb, absorb_reference, no_absorption
from nlens_video.kernels.aperture_covariance import aperture_covariance, edge_parallax_layer
from nlens_video.kernels.depth_layers import inpaint
from nlens_video.kernels.scatter.paper_scatter import paper_scatter
from nlens_video.kernels.scatter.plane_blur import PlaneCoc, blur_plane
from nlens_video.kernels.scatter.plane_blur_ref import blur_plane_ref
from nlens_video.kernels.scatter.scatter import scatter
from nlens_video.kernels.scatter.scatter_ref import gather_subaperture_ref, scatter_ref
from nlens_video.kernels.scatter.subaperture_gather import gather_subaperture
from nlens_video.native import kernels
from nlens_video.render.base import light_depth, light_depth_ref
from nlens_video.render.base.light_depth import LightDepth
from nlens_video.render.base.shader_inputs import MATERIAL_FLOATS, SLOTS
from nlens_video.render.software import raster, reference_kernels
from nlens_video.render.software.deferred import resolve_depth
from nlens_video.render.software.renderer import SoftwareObjectRenderer
from nlens_video.render.software.shading_inputs import LAYERED
from nlens_video.scene import Camera, Scene, screen_projection
from nlens_video.scene.gltf import animation_kernels
from nlens_video.stages.l_aperture_samples import even_points
from nlens_video.video.pixels import blend, blend_ref
from nlens_video.video.pixels.samples import array_samples

LINEAR = ColorTags(matrix="gbr", transfer="linear", primaries="bt709", full_range=True)
SRGB = ColorTags(matrix="gbr", transfer="iec61966-2-1", primaries="bt709", full_range=True)
COMPARED = {  # modules that call compiled loops, by path within the package
    "scatter, round discs": "kernels/scatter/extend kernels/scatter/levels"
        " kernels/scatter/normalize",
    "scatter, seven blades": "kernels/scatter/extend",
    "scatter, cat's eye, root mean square": "kernels/scatter/scatter",
    "blur of a cell": "kernels/scatter/subaperture_gather",
    "covariance over the aperture": "kernels/aperture_covariance",
    "a half-hidden lens": "kernels/aperture_covariance",
    "the paper's scatter": "kernels/scatter/paper_scatter",
    "blur of a plane": "kernels/scatter/plane_blur",
    "pull-push": "kernels/depth_layers",
    "nodes of a scene": "scene/gltf/animation_kernels",
    "skinned vertices": "scene/posed",
    "projection of vertices": "scene/screen_projection",
    "disparity of samples": "render/software/raster render/software/triangles",
    "depth of pixels": "render/software/deferred",
    "light on a surface": "render/software/deferred",
    "layers of a surface": "render/software/deferred",
    "filtered textures": "render/software/deferred",
    "nearness to a lamp": "render/base/light_depth",
    "share of a lamp that is seen": "render/base/light_depth",
    "a whole picture: colour": "render/software/deferred render/software/alpha",
    "a whole picture: depth": "render/software/deferred",
    "cast triangles": "effects/shadow/coverage",
    "cast veils": "effects/shadow/transparency",
    "points in shadow maps": "effects/shadow/shadow_maps",
    "first surfaces seen from a light": "effects/shadow/light_views",
    "flattest windows": "effects/surfaces",
    "light that things lose": "effects/shadow/seen_lights",
    "light sent to the ground": "effects/shadow/bounce",
    "decoding": "video/pixels/blend",
    "change of exposure": "effects/light_change",
    "compositing": "video/pixels/blend",
    "grain on a layer": "effects/camera/grain",
    "grain of a darkened plate": "effects/camera/grain_restore",
    "tiles of noise": "effects/camera/grain",
    "white noise": "effects/camera/grain",
    "CoC of a depth": "",
}  # fmt: skip
WITHOUT_ARITHMETIC = {  # masks; the constants of kernels
    "kernels/coc_discontinuities", "render/software/shading_inputs",
}  # fmt: skip


def _layer(rng, largest, shape=(36, 40)):
    rgba = np.zeros((*shape, 4), np.float32)
    rgba[8:-8, 8:-8, :3] = rng.random((shape[0] - 16, shape[1] - 16, 3))
    rgba[8:-8, 8:-8, 3] = 1.0
    return rgba, rng.uniform(-largest, largest, shape).astype(np.float32)


@cache
def _blurs() -> dict[str, tuple[float, float]]:
    """Largest difference of each blur to its definition in float64, and its limit."""
    rng = np.random.default_rng(0)
    made = {}
    rgba, coc = _layer(rng, 5.0)
    shapes = {
        "round discs": ({}, 1e-3),
        "seven blades": ({"aperture": Aperture(blades=7)}, 2e-3),
    }
    for name, (words, limit) in shapes.items():
        away = np.abs(scatter(rgba, coc, **words) - scatter_ref(rgba, coc, **words))
        made[f"scatter, {name}"] = (away.max(), limit)
    # a small disc that the barrel cuts stays round, as large as what is left of it: so the mean
    even, eye = np.full((28, 28), -11.0, np.float32), Aperture(cat_eye=0.8)
    small = _layer(rng, 0.0, (28, 28))[0]
    away = scatter(small, even, aperture=eye) - scatter_ref(small, even, aperture=eye)
    made["scatter, cat's eye, root mean square"] = (np.sqrt(np.mean(away**2)), 1e-2)
    part, discs, box = rgba[10:22, 12:24], coc[10:22, 12:24], Box(-3, -2, 15, 14)
    given = rng.random((12, 12)) < 0.8
    cell = gather_subaperture(part, given, discs, box) - gather_subaperture_ref(
        part, given, discs, box
    )
    made["blur of a cell"] = (np.abs(cell).max(), 2e-5)
    cover = np.float32(rng.random((24, 32)) > 0.5)
    near = (cover, np.full((24, 32), 9.0, np.float32))
    back = (rng.random((24, 32, 4), dtype=np.float32), np.full((24, 32), -4.0, np.float32))
    everywhere, points = np.ones((24, 32), np.bool_), even_points(7).astype(np.float32)
    found = aperture_covariance(near, back, everywhere, points)
    away = np.abs(found - covariance_by_points(near, back, points)).max()
    made["covariance over the aperture"] = (away, 1e-5)
    shown, beyond = rng.random((24, 32, 4), dtype=np.float32), rng.random((34, 42, 3))
    behind = beyond.astype(np.float32)
    cocs = rng.uniform(-12.0, 12.0, (2, 24, 32)).astype(np.float32)
    seen = edge_parallax_layer(shown, behind, *cocs, cover, corner=(5, 5))
    away = np.abs(seen - edge_parallax_by_pixels(shown, behind, cocs, cover, 5, 1.0)).max()
    made["a half-hidden lens"] = (away, 2e-5)
    picture = rng.random((21, 24, 3), dtype=np.float32)
    radius = np.float32(rng.choice([0.0, 0.4, 1.7, 6.2], (21, 24)))
    away = np.abs(
        paper_scatter(picture, radius)[0] - paper_scatter_by_pixels(picture, radius)[0]
    ).max()
    made["the paper's scatter"] = (away, 1e-3)
    plane = np.random.default_rng(6).random((12, 20, 3))
    coc, around = PlaneCoc(-1.0, 0.0, 0.4), Box(-2, -2, 22, 14)
    seen = blur_plane(plane.astype(np.float32), coc, around)[..., :3]
    away = np.abs(seen - blur_plane_ref(plane, coc, around)).max()
    made["blur of a plane"] = (away, 1e-4)
    known = rng.random((40, 44)) < 0.1
    values = np.where(known[..., None], rng.random((40, 44, 3)), 0.0)
    single = inpaint(values.astype(np.float32), known, (3, 5))
    exact = pull_push(values, known.astype(float), (3, 5))
    made["pull-push"] = (np.abs(single - exact).max(), 1e-6)
    return made


def _nodes(rng):
    """How far a chain of ten turning nodes comes from its place."""
    count, times = 10, np.array([0.0, 1.0])
    values = rng.normal(size=(2 * count, 3, 4))
    values /= np.linalg.norm(values, axis=2, keepdims=True)
    tracks = [[node, 3, 4, animation_kernels.LINEAR, 1, 0, 2 * node, 2] for node in range(count)]
    local = np.concatenate([rng.normal(size=(count, 7)), np.ones((count, 3))], axis=1)
    expected = local.copy()
    for node in range(count):
        keys = values[2 * node : 2 * node + 2]
        expected[node, 3:7] = animation_kernels.sample_ref(
            0.3, times, keys, animation_kernels.LINEAR, turns=True
        )
    animation_kernels.sample(0.3, np.array(tracks), times, values, local)
    world = np.empty((count, 4, 4))
    parents = np.arange(count) - 1
    order = np.stack([np.arange(count), parents], axis=1)
    animation_kernels.multiply(local, order, world.copy(), np.zeros(count, bool), world)
    own = [animation_kernels.compose_ref(row) for row in expected]
    return np.abs(world[-1] - animation_kernels.world_ref(count - 1, own, parents)).max()


def _skin(rng):
    """How far vertices that two of five joints carry come from their places, and their normals."""
    positions = rng.normal(size=(40, 3)).astype(np.float32)
    joints, share = rng.integers(0, 5, (40, 2), np.int32), rng.random((40, 1), np.float32)
    weights, matrices = np.hstack([share, 1 - share]), rng.normal(size=(5, 12)).astype(np.float32)
    placed, turned = np.empty((2, 40, 3), np.float32)
    kernels.skin(positions, positions, joints, weights, matrices, placed, turned)
    exact = np.einsum("vk,vkij->vij", weights, matrices[joints].reshape(40, 2, 3, 4).astype(float))
    rows = exact[..., :3]
    cofactors = np.cross(rows[:, [1, 2, 0]], rows[:, [2, 0, 1]])
    ways = np.einsum("vij,vj->vi", cofactors, positions)
    ways *= np.sign(np.linalg.det(rows))[:, None]
    ways /= np.linalg.norm(ways, axis=1, keepdims=True)
    exact = np.einsum("vij,vj->vi", exact, np.hstack([positions, np.ones((40, 1))]))
    return max(np.abs(placed - exact).max(), np.abs(turned - ways).max())


@cache
def _geometry() -> dict[str, tuple[float, float]]:
    rng = np.random.default_rng(1)
    made = {}
    made["nodes of a scene"] = (_nodes(rng), 1e-12)
    made["skinned vertices"] = (_skin(np.random.default_rng(2)), 2e-6)
    positions = (rng.normal(0, 2.0, (60, 3)) - [0, 0, 5]).astype(np.float32)
    view = Camera(
        world_from_camera=np.eye(4), fx=20.0, fy=20.0, cx=16.0, cy=12.0, width=32, height=24
    )
    numbers = screen_projection.pinhole_params(view, Box(0, 0, 32, 24), 0.5)
    points = np.empty((60, 3))
    screen_projection.project(positions, numbers, points)
    before = positions[:, 2] < -0.5
    exact = view.pixels(positions[before].astype(np.float64))
    # places are kept to 1 / 256 px, on purpose
    made["projection of vertices"] = (np.abs(points[before, :2] - exact).max(), 0.5 / 256 + 1e-9)
    faces = np.arange(60, dtype=np.int32).reshape(-1, 3)
    ids, disparity, *_ = drawn(positions, faces)
    seen, nearest = truth(positions, faces)
    same = (ids == seen) & (seen >= 0)
    away = np.abs(disparity[same] / nearest[same] - 1).max()
    made["disparity of samples"] = (away, 1e-6)
    samples = np.zeros((80, 30 + raster.PADDING), np.float32)
    samples[:, :30] = rng.uniform(0.5, 0.502, (80, 30))
    depth = np.empty((20, 30), np.float32)
    resolve_depth(samples, 0, 20, 0.4, depth)
    exact = resolved(samples[:, :30].astype(np.float64), 0.4)
    made["depth of pixels"] = (np.abs(depth / exact - 1).max(), 1e-6)
    size, at = (64, 64), (0.3, 0.7)
    corners = rng.normal(size=(9, 3)) * (30, 30, 0.1) + (30, 30, 1.0)
    three = np.arange(9, dtype=np.int32).reshape(3, 3)
    wrong = marked(size, corners, three, at) ^ covered_reference(size, corners, three, at)
    made["cast triangles"] = (wrong.mean(), 2e-3)  # share of the pixels, on edges
    texture = (rng.random((5, 7), np.float32), (0, 1), -1.0)
    where = rng.normal(size=(9, 3)) * (1.5, 1.5, 0.1) + (0, 0, 1.0)
    veiled = no_absorption(*size)
    bits = np.zeros(size, np.uint8)
    absorb(veiled, (bits, 0), corners, where, three, texture, 1, at)
    away = np.abs(veiled.taken - absorb_reference(size, corners, where, three, texture, at))
    made["cast veils"] = (np.quantile(away, 0.995), 1e-6)
    return made | _shadow_maps(rng)


def _shadow_maps(rng) -> dict[str, tuple[float, float]]:
    """Shadows on filmed things: lookups, as shares of the points and cells, and planes."""
    maps, points = made_maps(rng, far=False, transparent=True), made_points(rng)
    share, _ = blocked([maps], points)
    wrong = np.abs(share - blocked_reference(maps, points, None)[0]) > 1e-4
    views = maps.views
    first, _ = first_surfaces_reference(views, views.casters.points)
    across, down, left = rng.normal(size=(3, 30, 40))
    slopes = np.empty((30, 40, 2), np.float32)
    kernels.best_slopes(across, down, left, 3, slopes)
    away = np.abs(slopes - best_slopes_reference(across, down, left, 3))
    return {
        "points in shadow maps": (wrong.mean(), 1e-2),  # on the border of a pixel
        "first surfaces seen from a light": ((np.abs(views.first - first) > 1e-5).mean(), 1e-2),
        "flattest windows": (away.max(), 1e-6),
    }


@cache
def _shading() -> dict[str, tuple[float, float]]:
    rng = np.random.default_rng(3)
    made = {}
    fields = random_block(rng)
    lamps = np.zeros((3, 16), np.float32)
    toward = rng.normal(size=(3, 3))
    lamps[:, 8:11] = toward / np.linalg.norm(toward, axis=1, keepdims=True)
    lamps[:, :3] = rng.random((3, 3))
    red = slice(at.RED, at.RED + 3)
    emitted = fields[red].copy()
    kernels.light_points(fields, (lamps, 3, *NOTHING_AROUND))
    suns = [(row[8:11].astype(float), row[:3].astype(float)) for row in lamps]
    exact = np.array(
        [reference_kernels.lit_by_directional(surface(fields, i), suns) for i in range(at.WIDTH)]
    ).T
    away = np.abs(fields[red] - emitted - exact) / (1e-3 + exact)
    made["light on a surface"] = (away.max(), 2e-4)
    fields = layered_block(rng)
    paint = (
        np.zeros((1, MATERIAL_FLOATS), np.float32), np.full((1, len(SLOTS)), -1, np.int32),
        np.full(1, LAYERED, np.int32), (np.zeros(4, np.uint16), *np.zeros((2, 0, 6), np.int64)),
    )  # fmt: skip
    kernels.light_layers(fields, paint, (lamps, 3, *NOTHING_AROUND))
    exact = np.array([
        sum(reference_kernels.layered(layered_surface(fields, i), way) * part for way, part in suns)
        for i in range(at.WIDTH)
    ]).T  # fmt: skip
    made["layers of a surface"] = (np.abs((fields[red] - exact) / (1e-3 + exact)).max(), 2e-5)
    pixels = rng.integers(0, 256, (12, 20, 4), np.uint8)
    atlas = atlas_of(pixels)
    uv, texels = np.empty((6, 60), np.float32), np.empty((4, 60), np.float32)
    uv[:2], uv[2:] = rng.uniform(-2.5, 3.5, (2, 60)), rng.normal(size=(4, 60)) * 0.05
    kernels.sample_texture(uv, (atlas.texels, atlas.levels, atlas.table), 0, texels)
    worst = 0.0
    for (u, v, *along), texel in zip(uv.T.astype(float), texels.T, strict=True):
        exact = reference_kernels.sample_texture(
            atlas, 0, (u, v), (np.array(along[:2]), np.array(along[2:]))
        )
        worst = max(worst, np.abs(texel - exact).max())
    made["filtered textures"] = (worst, 3e-6)
    made["nearness to a lamp"], made["share of a lamp that is seen"] = _light_depth(rng)
    made["a whole picture: colour"] = (_picture(pane=True)[0], 2e-6)
    made["a whole picture: depth"] = (_picture(pane=False)[1], 2e-6)
    return made


def _light_depth(rng: np.random.Generator) -> tuple[tuple[float, float], tuple[float, float]]:
    """Triangles drawn in a lamp's map, and points looked up in it: errors [px], [1], and limits."""
    side, count = 128, 60
    places = np.empty((3 * count, 3), np.float32)
    places[:, :2], places[:, 2] = rng.uniform(4.0, 124.0, (3 * count, 2)), rng.uniform(0, 60, 180)
    faces = np.arange(3 * count, dtype=np.int32).reshape(-1, 3)
    drawn = np.full((1, side, side), -3e38, np.float32)
    kernels.draw_nearness(places, faces, light_depth.SOLID, 0, side, drawn[0])
    exact = light_depth_ref.nearness(places, faces, side)
    there = np.isfinite(exact) & (drawn[0] > -1e38)
    depth = LightDepth(
        lights=(0,), shares=(1.0,), matrices=np.eye(4)[None], softness=(0.07,), nearness=drawn,
        highest=np.full((1, side // light_depth.CELL, side // light_depth.CELL), drawn.max()),
    )  # fmt: skip
    points = np.column_stack([rng.uniform(8.0, 120.0, (400, 2)), rng.uniform(0.0, 60.0, 400)])
    facets, toward = rng.normal(size=(400, 3)), np.array([0.0, 0.0, 1.0])
    shares = np.empty(400, np.float32)
    rows = (one.astype(np.float32) for one in (points, facets, np.tile(toward, (400, 1))))
    kernels.visible_points(depth.maps(np.zeros(3)), 0, *rows, shares)
    known = [
        light_depth_ref.visible(depth, 0, *one, toward) for one in zip(points, facets, strict=True)
    ]
    away = np.sort(np.abs(drawn[0] - exact)[there])
    return (float(away[-8]), 1e-3), (float(np.abs(shares - known).mean()), 1e-3)


def _picture(*, pane: bool) -> tuple[float, float]:
    """A leaning triangle, colours at its corners, perhaps under a pane of half coverage, by hand.

    Returns:
        Largest error of the colour, and of the depth as a share.
    """
    corners = np.array([[-3.0, -2.0, -3.0], [4.0, -2.5, -9.0], [-0.5, 3.0, -4.0]])
    colours = np.array([[0.9, 0.1, 0.2, 1.0], [0.1, 0.8, 0.3, 1.0], [0.2, 0.3, 0.7, 1.0]])
    builder = GlbBuilder()
    unlit = {"extensions": {"KHR_materials_unlit": {}}, "doubleSided": True}
    paint = builder.add("materials", dict(unlit))
    mesh = builder.mesh(corners.astype(np.float32), np.array([[0, 1, 2]]), material=paint,
                        COLOR_0=colours.astype(np.float32))  # fmt: skip
    builder.node(mesh=mesh)
    if pane:
        glass = {"pbrMetallicRoughness": {"baseColorFactor": [0.25, 0.5, 1.0, 0.5]}}
        tint = builder.add("materials", {**glass, "alphaMode": "BLEND", **unlit})
        large = np.array([[-9, -9, -2.5], [9, -9, -2.5], [9, 9, -2.5], [-9, 9, -2.5]], np.float32)
        builder.node(mesh=builder.mesh(large, np.array([[0, 1, 2], [0, 2, 3]]), material=tint))
    with folder() as place:
        scene = Scene.load(builder.write(place / "two.glb"))
    view = Camera(
        world_from_camera=np.eye(4), fx=90.0, fy=90.0, cx=60.0, cy=45.0, width=120, height=90
    )
    with SoftwareObjectRenderer(scene) as renderer:
        layer = renderer.render(0.0, view)
    x, y = np.meshgrid(np.arange(120) + 0.5, np.arange(90) + 0.5)
    rays = np.stack([(x - 60) / 90, (45 - y) / 90, np.full(x.shape, -1.0)], axis=-1)
    weights = np.linalg.solve(corners.T, rays.reshape(-1, 3).T).T.reshape(90, 120, 3)
    inside = weights.min(axis=-1) > 0.002
    depth = 1.0 / weights.sum(axis=-1, where=np.broadcast_to(inside[..., None], weights.shape),
                              initial=1e-30)  # fmt: skip
    behind = (weights * depth[..., None]) @ colours[:, :3]
    exact = 0.5 * np.array([0.25, 0.5, 1.0]) + 0.5 * behind if pane else behind
    rgba, found = np.zeros((90, 120, 4)), np.zeros((90, 120))
    there = layer.box.slices_in(Box(0, 0, 120, 90))
    rgba[there], found[there] = layer.rgba, layer.depth
    colour = np.abs(rgba[inside][:, :3] - exact[inside]).max()
    return float(colour), float(np.abs(found[inside] / depth[inside] - 1).max())


def _exposure(rng):
    """How far the change of light between two noisy pictures is from float64's [stops]."""
    light = rng.uniform(0.005, 0.9, (2, 24, 40, 3)).astype(np.float32)
    light[1] = light[0] * rng.uniform(1.1, 1.3, (24, 40, 3)).astype(np.float32)
    stops = np.empty_like(light)
    for picture, out in zip(light, stops, strict=True):
        light_change.take_stops(picture, out)
    found = np.empty(3)
    light_change.take_change(stops[0], stops[1], 0.25, 0.2, found)
    before, now = (light_change.stops_reference(picture.astype(np.float64)) for picture in light)
    return np.abs(found - light_change.change_reference(before, now, 0.25, 0.2)).max()


@cache
def _light() -> dict[str, tuple[float, float]]:
    rng = np.random.default_rng(4)
    made = {}
    decoded, laid = 0.0, 0.0
    layer = rng.random((30, 40, 4), dtype=np.float32)
    layer[..., :3] *= layer[..., 3:]
    box = Box(0, 0, 40, 30)
    for tags in (LINEAR, SRGB):
        plate = rng.uniform(0.0, 1.0, (30, 40, 3)).astype(np.float32)
        fast = array_samples(plate, "rgb", tags, associated=False)
        slow = copy.deepcopy(fast)
        decoded = max(decoded, np.abs(blend.linear(fast, box) - blend_ref.linear(slow, box)).max())
        blend.composite_over(fast, box, layer)
        blend_ref.composite_over(slow, box, layer)
        laid = max(
            laid, *(np.abs(a - b).max() for a, b in zip(fast.planes, slow.planes, strict=True))
        )
    made["decoding"], made["compositing"] = (decoded, 2e-5), (laid, 2e-5)
    made["change of exposure"] = (_exposure(rng), 1e-6)
    plate, noise = rng.random((30, 40, 3)), rng.normal(size=(30, 40, 3))
    deviation = rng.uniform(0.0, 0.03, (256, 3))
    singles = [v.astype(np.float32) for v in (layer, plate, noise, deviation)]
    exact = regrain_reference(*(v.astype(np.float64) for v in singles))
    made["grain on a layer"] = (np.abs(regrain(*singles) - exact).max(), 1e-5)
    darkening = np.concatenate([0.2 * layer[..., :3], layer[..., 3:]], axis=2)
    curve = rng.uniform(0.01, 0.03, (3, 256))
    singles = [v.astype(np.float32) for v in (darkening, plate, noise, curve)]
    exact = restore_grain_reference(*(v.astype(np.float64) for v in singles))
    restore_grain(*singles)  # in place
    made["grain of a darkened plate"] = (np.abs(singles[0] - exact).max(), 1e-4)
    away = white_noise((3, 5), (20, 24), 7, 11) - white_noise_reference((3, 5), (20, 24), 7, 11)
    made["white noise"] = (np.abs(away).max(), 1e-5)
    tile, on = rng.normal(size=(16, 16, 3)).astype(np.float32), Box(-5, 3, 35, 40)
    places, weights = [(3, 11), (15, 0), (7, 7)], [0.9, 0.3, 0.1]
    exact = tiled_reference(tile.astype(np.float64), on, places, weights)
    made["tiles of noise"] = (np.abs(tiled(tile, on, places, weights) - exact).max(), 1e-6)
    made["light sent to the ground"] = (_sent_light(rng), 1e-5)
    shares, loss = rng.random((3, 200), np.float32), np.empty((200, 3), np.float32)
    light = rng.random((3, 200, 3)) * (rng.random((200, 3)) > 0.2)
    kernels.lost_light(shares, light, loss)
    made["light that things lose"] = (
        np.abs(loss - lost_light_reference(shares, light)).max(),
        1e-6,
    )
    fit = LensFit(slope=2000.0, intercept=-800.0, width=3840, height=2160)
    disparity = rng.uniform(0.1, 1.0, 1000)
    exact = 2000.0 * disparity - 800.0
    away = np.abs(fit.coc_px(disparity.astype(np.float32)) - exact)
    made["CoC of a depth"] = (away.max(), 3e-4)
    return made


def _sent_light(rng) -> float:
    """Largest error of the light that patches send to the ground."""
    ground = (rng.uniform(-3.0, 3.0, (300, 3)) * (1.0, 0.0, 1.0)).astype(np.float32)
    normals = rng.normal(size=(40, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    places = rng.uniform(-1.0, 1.0, (40, 3)) + (0.0, 1.1, 0.0)
    rest = rng.uniform(0.0, 0.3, (40, 1)), rng.uniform(0.0, 1.0, (40, 3))
    patches = np.column_stack([places, normals, *rest]).astype(np.float32)
    found, exact = np.zeros((300, 3), np.float32), np.zeros((300, 3))
    kernels.gather_patches(ground, patches, found)
    gather_patches_reference(ground, patches.astype(np.float64), exact)
    return float(np.abs(found - exact).max())


def _table(made) -> Outcome:
    figures = {name: float(value) for name, (value, _) in made.items()}
    limits = {name: limit for name, (_, limit) in made.items()}
    return Outcome(
        tuple(at_most(name, figures[name], limits[name]) for name in made),
        lambda: bars(figures, limits, x="largest difference to float64"),
    )


@case
def test_blur_kernels_against_float64():
    """Blurs against their definitions in float64; light is 1 at most. Tables are part of it."""
    return _table(_blurs())


@case
def test_geometry_kernels_against_float64():
    """Projection, visibility, depth and shadows against float64: px, shares, shares of pixels."""
    return _table(_geometry())


@case
def test_shading_kernels_against_float64():
    """Light and textures, and a whole picture of the rasteriser, against float64 by hand."""
    return _table(_shading())


@case
def test_colour_kernels_against_float64():
    """Decoding, compositing and grain against float64, as light; the CoC of a 4K lens in px."""
    return _table(_light())


@case
def test_every_kernel_is_compared():
    """Every kernel that computes with floats is in one of the tables above."""
    loops = re.compile(r"^from nlens_video\.native import kernels\b", re.MULTILINE)
    root = Path(nlens_video.__file__).parent
    found = {
        str(path.relative_to(root).with_suffix(""))
        for path in root.rglob("*.py")
        if loops.search(path.read_text())
    }
    named = {word for words in COMPARED.values() for word in words.split()}
    compared = {name for made in (_blurs(), _geometry(), _shading(), _light()) for name in made}
    counts = {"compared": len(found & named), "without arithmetic": len(found & WITHOUT_ARITHMETIC)}

    def draw(axes):
        axes.barh(list(counts), list(counts.values()), color=OURS)

    return Outcome(
        (
            exactly("kernels that no table names",
                    " ".join(sorted(found - named - WITHOUT_ARITHMETIC)) or "none", "none"),
            exactly("modules named that have no loops",
                    " ".join(sorted((named | WITHOUT_ARITHMETIC) - found)) or "none", "none"),
            exactly("comparisons named but not made",
                    " ".join(sorted(set(COMPARED) - compared)) or "none", "none"),
        ),
        lambda: plot(draw, x="modules with compiled loops", y="", legend=False),
    )  # fmt: skip


@case
def test_bright_highlight_beside_dark_areas():
    """A pixel of 1e4 to 1e8 times white hardly changes dark parts beyond its disc."""
    values, aways = (1e2, 1e4, 1e6, 1e8), []
    for value in values:
        worst = 0.0
        for coc in (2.0, 6.0, 12.0, 20.0):
            rgba = np.zeros((64, 64, 4), np.float32)
            rgba[8:-8, 8:-8] = (0.01, 0.01, 0.01, 1.0)
            lit = rgba.copy()
            lit[32, 20, :3] = value
            plane = np.full((64, 64), coc, np.float32)
            dark, seen = scatter(rgba, plane), scatter(lit, plane)
            far = np.ones((64, 64), bool)
            reach = math.ceil(coc / 2) + 2
            far[32 - reach : 33 + reach, 20 - reach : 21 + reach] = False
            worst = max(worst, float(np.abs(seen - dark)[far].max() / seen.max()))
        aways.append(worst)

    def draw(axes):
        axes.plot(values, aways, "o-", color=OURS, label="by the highlight's own blurred light")

    return Outcome(
        tuple(at_most(f"change of the dark by the highlight's light, {v:g}", a, 2e-7)
              for v, a in zip(values, aways, strict=True)),
        lambda: plot(draw, x="highlight [white]", y="change of the dark", log=("x",)),
    )  # fmt: skip
