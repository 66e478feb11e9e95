"""Depths that make no range, are infinite, or lie behind the camera."""

import numpy as np
import pytest
from hard.catalogue import Outcome, at_least, at_most, case, exactly
from hard.drawing import INK, OTHER, OURS, PALE, heat, over_grey, panels, plot
from hard.objects import LENS, PRESETS, SIZE, composited, cube, folder, plate_bgr
from hard.quality_levels import QUALITIES, Card, camera, cards, lens_at, sharp, through
from support.glb_builder import GlbBuilder
from support.planes import of_map

from nlens_video.core.errors import LensFitError
from nlens_video.core.layers import Box, CocMap, ObjectLayer
from nlens_video.core.lens_fit import LensFit
from nlens_video.render.opengl.object_renderer import PyrenderObjectRenderer
from nlens_video.render.software.renderer import SoftwareObjectRenderer
from nlens_video.scene import Camera, Scene
from nlens_video.stages.l_lens_sampling import COVERAGE_DRAWS, shifted_cameras
from nlens_video.stages.l_reblur import object_coc
from nlens_video.stages.p_projection import GroundProjection
from nlens_video.stages.r_regression import FitLens

ROWS, COLUMNS = 128, 240
COC = 9.0


def _flat_ground(span: float) -> GroundProjection:
    rows = np.linspace(0.5 - span / 2, 0.5 + span / 2, ROWS)
    disparity = np.repeat(rows[:, None], COLUMNS, axis=1)
    mask = np.zeros((ROWS, COLUMNS), bool)
    mask[70:90, 90:150] = True
    return GroundProjection(mask=mask, disparity_of=of_map(disparity), ground_y=0.0)


def _spans(spans):
    """The CoC that fits give the ground itself, by the span of its disparity, and their signs."""
    found, signs = [], []
    for span in spans:
        rng = np.random.default_rng(5)
        plane = _flat_ground(span)
        coc = np.abs(COC + rng.normal(0, 0.3, plane.disparity.shape)).astype(np.float32)
        fit = FitLens()(CocMap(coc_px=coc, sigma_px=np.full_like(coc, 0.5)), plane).fit
        found.append(abs(float(fit.coc_px(np.float32(0.5)))))
        signs.append(fit.sign)
    return np.array(found), signs


@case
def test_ground_of_a_single_disparity():
    """A ground of one disparity, or of a span of 1e-9, gives its own blur, of ambiguous sign."""
    spans = [0.0, 1e-12, 1e-9, 1e-6, 1e-4, 1e-2]
    found, signs = _spans(spans)

    def draw(axes):
        axes.axhline(COC, color=PALE, lw=4, label="what the plate shows")
        axes.plot(np.maximum(spans, 1e-13), found, "o-", color=OURS, label="what the fit gives it")

    return Outcome(
        (
            at_most("CoC of that ground, off by [px]", np.abs(found - COC).max(), 0.3),
            exactly("sign, for every span", " and ".join(sorted(set(signs))), "ambiguous"),
        ),
        lambda: plot(draw, x="span of the disparity [1 / unit]", y="|CoC| [px]", log=("x",)),
    )


@case
def test_ground_of_negative_disparity():
    """Ground behind the camera and sky beyond the horizon take no part in the fit."""
    rows = (np.arange(ROWS) - 40) / (ROWS - 40)  # negative above row 40
    disparity = np.repeat(rows[:, None], COLUMNS, axis=1)
    mask = np.zeros((ROWS, COLUMNS), bool)
    mask[80:100, 90:150] = True
    plane = GroundProjection(mask=mask, disparity_of=of_map(disparity), ground_y=0.0)
    coc = np.abs(30.0 * (disparity - 0.4)).astype(np.float32)
    fits = []
    for sky in (0.0, 500.0, np.nan):
        seen = np.where(disparity > 0, coc, np.float32(sky)).astype(np.float32)
        fits.append(FitLens()(CocMap(coc_px=seen, sigma_px=np.full_like(coc, 0.5)), plane).fit)
    slopes = np.array([fit.slope for fit in fits])
    return Outcome(
        (
            exactly("slopes by what the sky says", len(set(slopes.tolist())), 1),
            at_most("slope, off by a share of", abs(slopes[0] / 30.0 - 1.0), 0.02),
        ),
        lambda: panels({"disparity, blue below 0": heat(-disparity, 1.0), "CoC": heat(coc, 20.0)}),
    )


@case
def test_object_of_infinite_depth():
    """An object without depth lies at infinity; without depth in places it takes that beside."""
    fit = LensFit(slope=40.0, intercept=-8.0, width=40, height=30)
    rgba = np.ones((30, 40, 4), np.float32)
    depths = {
        "all infinite": np.full((30, 40), np.inf, np.float32),
        "left half infinite": np.where(np.arange(40) < 20, np.inf, 2.0) * np.ones((30, 1)),
        "left half subnormal": np.where(np.arange(40) < 20, 1e-40, 2.0) * np.ones((30, 1)),
        "left half negative": np.where(np.arange(40) < 20, -3.0, 2.0) * np.ones((30, 1)),
        "left half nan": np.where(np.arange(40) < 20, np.nan, 2.0) * np.ones((30, 1)),
    }
    cocs = {}
    for name, depth in depths.items():
        layer = ObjectLayer(box=Box(0, 0, 40, 30), rgba=rgba, depth=depth.astype(np.float32))
        cocs[name] = object_coc(layer, fit).coc_px
    return Outcome(
        tuple(
            exactly(f"CoC, {name} [px]", coc[15, 0], -8.0 if name == "all infinite" else 12.0)
            for name, coc in cocs.items()
        ),
        lambda: panels({name: heat(coc, 12.0) for name, coc in cocs.items()}, height=90),
    )


def _runway(behind: float) -> Scene:
    """A strip on the ground from 6 units before the camera to `behind` units behind it."""
    ends = (behind, behind, -6, -6)
    corners = np.array([[x, -0.4, z] for x, z in zip((-0.5, 0.5, 0.5, -0.5), ends, strict=True)])
    builder = GlbBuilder()
    rng = np.random.default_rng(2)
    tiles = np.kron(rng.integers(40, 236, (24, 4, 3)), np.ones((8, 8, 1)))
    paint = builder.add(
        "materials",
        {
            "pbrMetallicRoughness": {
                "baseColorTexture": {"index": builder.texture(tiles, magFilter=9729)}
            },
            "extensions": {"KHR_materials_unlit": {}},
            "doubleSided": True,
        },
    )
    far = (6 + behind) / 6.0  # texture by place on the ground, whatever the length
    uv = np.array([[0, far], [1, far], [1, 0], [0, 0]], np.float32)
    faces = np.array([[0, 1, 2], [0, 2, 3]])
    mesh = builder.mesh(corners.astype(np.float32), faces, material=paint, TEXCOORD_0=uv)
    builder.node(mesh=mesh)
    with folder() as place:
        return Scene.load(builder.write(place / "runway.glb"))


@case
def test_object_crossing_the_near_plane():
    """A strip that extends behind the camera looks like one that ends just outside the frame."""
    ends_before, runs_through = _runway(-0.6), _runway(40.0)
    fit = lens_at(2.0, 10.0)
    plain = sharp(ends_before)
    figures, shown = [], {"ends before": over_grey(plain)}
    away = np.abs(sharp(runs_through) - plain)[:-4]
    figures.append(at_most("sharp picture, mean difference", away.mean(), 5e-3))
    for quality in QUALITIES:
        seen = through(quality, runs_through, fit)
        shown[f"runs on, {quality}"] = over_grey(seen)
        figures += [
            exactly(f"{quality} is finite", str(bool(np.isfinite(seen).all())), "True"),
            at_most(f"greatest alpha of {quality}", seen[..., 3].max(), 1.0),
            at_least(f"least value of {quality}", seen.min(), -1e-6),
        ]
    return Outcome(tuple(figures), lambda: panels(shown))


@pytest.mark.needs_gl
@case
def test_object_crossing_the_near_plane_in_opengl():
    """OpenGL and the rasteriser draw a strip that extends behind the camera alike."""
    seen = {}
    for kind in (SoftwareObjectRenderer, PyrenderObjectRenderer):
        with kind(_runway(40.0)) as renderer:
            layer = renderer.render(0.0, camera())
        seen[renderer.name] = (layer.rgba, layer.depth)
    (ours, our_depth), (theirs, their_depth) = seen.values()
    both = np.isfinite(our_depth) & np.isfinite(their_depth)
    depth = np.abs(our_depth[both] / their_depth[both] - 1)
    return Outcome(
        (
            at_most("share of pixels that only one of them covers",
                    (np.isfinite(our_depth) != np.isfinite(their_depth)).mean(), 2e-3),
            at_most("depth, mean difference by a share of", depth.mean(), 5e-3),
            at_most("colour, mean difference", np.abs(ours - theirs).mean(), 0.01),
        ),
        lambda: panels({name: over_grey(rgba) for name, (rgba, _) in seen.items()}),
    )  # fmt: skip


@case
def test_object_behind_the_camera():
    """An object behind the camera leaves the plate bit for bit, in every preset."""
    plate = plate_bgr()
    with folder() as place:
        glb = cube(place / "behind.glb", at=(0.0, 0.0, 3.0))
        changed = {p: int((composited(glb, p, LENS)[0] != plate).sum()) for p in PRESETS}
    return Outcome(
        tuple(exactly(f"samples that {name} changes", n, 0) for name, n in changed.items()),
        lambda: panels({"the composite is the plate": plate[..., ::-1]}),
    )


@case
def test_camera_inside_the_object():
    """Inside of a cube the object covers the whole frame: the plate shows through in no preset."""
    fit, plates = LENS.for_width(160, 90), [plate_bgr()[::3, ::3].copy() for _ in range(2)]
    plates[1][:] = 0
    with folder() as place:
        # unlit, since the plate gives light, too
        glb = cube(place / "inside.glb", at=(0.3, 0.7, 0.0), size=1.0, lamp="none")
        seen = {
            preset: [composited(glb, preset, fit, plate, effects="defocus")[0] for plate in plates]
            for preset in PRESETS
        }
    apart = {p: int(np.abs(one.astype(int) - other).max()) for p, (one, other) in seen.items()}
    return Outcome(
        tuple(at_most(f"codes by which the plate shows through, {p}", n, 1)
              for p, n in apart.items()),
        lambda: panels({p: v[0][..., ::-1] for p, v in seen.items()}),
    )  # fmt: skip


@case
def test_depths_over_eight_decades():
    """Cards at depths from 1e-4 to 1e4 units, a decade each, blur as each depth says."""
    fit = lens_at(1.0, 6.0)
    figures = []
    for depth in (1e-4, 1e-2, 1.0, 1e2, 1e4):
        with SoftwareObjectRenderer(cards(Card(depth, half=(10, 8)))) as renderer:
            layer = renderer.render(0.0, camera(), 4)
        coc = object_coc(layer, fit).coc_px[layer.rgba[..., 3] == 1.0]
        true = 6.0 / depth - 6.0
        off = float(np.abs(coc - true).max()) / max(1.0, abs(true))
        figures.append(at_most(f"CoC at a depth of {depth:g}, off by a share of", off, 2e-6))
    depth = np.geomspace(1e-4, 1e4, 200)

    def draw(axes):
        axes.plot(depth, 6.0 / depth - 6.0, color=OURS, label="CoC = slope / depth + intercept")
        axes.set_yscale("symlog")
        axes.axhline(-6.0, color=PALE, label="at infinity")

    return Outcome(tuple(figures), lambda: plot(draw, x="depth [unit]", y="CoC [px]", log=("x",)))


@case
def test_fit_of_constant_coc():
    """A fit of one CoC for all depths, the fallback, blurs near and far alike."""
    fit = LensFit(slope=0.0, intercept=-7.0, width=112, height=88)
    scene = cards(Card(1.5, half=(7.0, 20.0), seed=1), Card(4.0, half=(28.0, 16.0), seed=2))
    seen = {quality: through(quality, scene, fit) for quality in QUALITIES if quality != "standard"}
    shifted = [
        through("realtime", scene, fit, view) for view in shifted_cameras(camera(), COVERAGE_DRAWS)
    ]
    apart = float(np.abs(seen["lens"] - np.mean(shifted, axis=0)).max())
    return Outcome(
        (
            exactly("disparity in focus", str(fit.focus_disparity), "inf"),
            at_most("difference of lens and the mean of realtime, shifted", apart, 1e-5),
            at_most("greatest alpha", seen["realtime"][..., 3].max(), 1.0),
        ),
        lambda: panels({k: over_grey(v) for k, v in seen.items()}),
    )


@case
def test_ground_plane_seen_edge_on():
    """A camera in the ground plane itself, and one that sees no ground, are refused in one line."""
    said = []
    for disparity in (np.zeros((ROWS, COLUMNS)), -np.ones((ROWS, COLUMNS))):
        mask = np.zeros(disparity.shape, bool)
        plane = GroundProjection(mask=mask, disparity_of=of_map(disparity), ground_y=0.0)
        coc = np.full(disparity.shape, 5.0, np.float32)
        try:
            FitLens()(CocMap(coc_px=coc, sigma_px=np.ones_like(coc)), plane)
            said.append("")
        except LensFitError as error:
            said.append(str(error))
    level = Camera.from_yfov(np.eye(4), 0.7, *SIZE)
    rows = level.plane_disparity(-1.2)[:, 0]

    def draw(axes):
        axes.plot(rows, color=OURS, label="ground 1.2 below the camera")
        axes.plot(level.plane_disparity(0.0)[:, 0], color=OTHER, label="ground through the camera")
        axes.axhline(0.0, color=INK, lw=0.5)

    return Outcome(
        (
            exactly("lines of both messages", sum(len(s.splitlines()) for s in said), 2),
            exactly("both name --ground-y", sum("--ground-y" in s for s in said), 2),
        ),
        lambda: plot(draw, x="row of the frame", y="disparity [1 / unit]"),
    )
