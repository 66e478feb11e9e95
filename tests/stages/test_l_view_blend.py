import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import replace

from nlens_video.core.layers import Box, DefocusedLayer, ObjectLayer
from nlens_video.core.lens_fit import LensFit
from nlens_video.core.optics import Aperture
from nlens_video.evaluate.bench.glb_writer import write_glb
from nlens_video.evaluate.bench.shapes import (
    YFOV,
    Place,
    SceneLens,
    card,
    rectangle,
    tube,
)
from nlens_video.kernels.scatter.scatter import blur_reach, scatter
from nlens_video.render.opengl.object_renderer import PyrenderObjectRenderer
from nlens_video.render.software.renderer import SoftwareObjectRenderer
from nlens_video.scene import Scene
from nlens_video.stages.l_aperture_samples import bare_points, points_around
from nlens_video.stages.l_lens_sampling import LensSetup, lens_views
from nlens_video.stages.l_reblur import ReblurLayer, object_coc
from nlens_video.stages.l_view_blend import (
    FADE_PX,
    LARGE_COC_PX,
    SMALL_COC_PX,
    SPARE_PX,
    SampleSmallDiscs,
    ViewBlend,
    share_of_views,
)

OPTICS = SceneLens(slope=112.0, intercept=-56.0)
SIZE = (320, 160)
FRAME = Box(0, 0, *SIZE)
FIT = LensFit(slope=OPTICS.slope, intercept=OPTICS.intercept, width=960, height=480).for_width(
    *SIZE
)
RENDERERS = {"opengl": PyrenderObjectRenderer, "software": SoftwareObjectRenderer}
SCATTER = ReblurLayer(scatter=scatter, reach=blur_reach)


class Counted:
    """A renderer that counts its pictures."""

    def __init__(self, renderer):
        self.renderer, self.count = renderer, 0

    def render_views(self, time_s, cameras, *given, **named):
        self.count += len(cameras)
        self.renderer.render_views(time_s, cameras, *given, **named)


class Seen:
    """An object through the lens."""

    def __init__(self, path, surfaces, kind="software", fit=FIT):
        write_glb(path, surfaces, YFOV)
        self.scene, self.fit = Scene.load(path), fit
        self.camera = self.scene.camera(0.0, *SIZE)
        self.renderer = RENDERERS[kind](self.scene)
        self.counted = Counted(self.renderer)
        self.shot = LensSetup(time_s=0.0, camera=self.camera, fit=fit, frame=FRAME)
        self.stage = SampleSmallDiscs(renderer=self.counted)

    def sharp(self):
        return object_coc(self.renderer.render(0.0, self.camera), self.fit)

    def blurred(self):
        sharp = self.sharp()
        scattered = SCATTER(sharp, FRAME)
        views = self.stage(sharp, self.shot)
        return scattered, scattered if views is None else views.blend_into(scattered)

    def truth(self):
        return lens_views(self.renderer, self.shot, bare_points(400))


def whole(layer):
    out = np.zeros((FRAME.height, FRAME.width, 4), np.float32)
    out[layer.box.slices_in(FRAME)] = layer.rgba
    return out


def rms(layer, truth):
    return float(np.sqrt(((whole(layer) - whole(truth)) ** 2).mean()))


def flat(first, second, seed=3):
    """A card whose CoC on the frame of 960 columns goes from one to the other."""
    return card(OPTICS, rectangle(Place(380, 0, first), Place(580, 0, second), (60, 420)), seed)


@pytest.fixture
def see(tmp_path):
    made = []

    def look(*surfaces, kind="software", fit=FIT):
        made.append(Seen(tmp_path / "object.glb", surfaces, kind, fit))
        return made[-1]

    yield look
    for seen in made:
        seen.renderer.close()


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["software", pytest.param("opengl", marks=pytest.mark.needs_gl)])
def test_blended_views_of_small_discs_are_closer_to_the_lens_than_scatter(see, kind):
    path = np.array(
        [OPTICS.point(Place(480 + 40 * math.sin(k), 80 + 40 * k, 5.0)) for k in range(9)]
    )
    radii = [OPTICS.size(Place(480, 240, 5.0), 30)] * 9
    seen = see(tube(path, radii, 4, lit=False), flat(-4.0, -8.0), kind=kind)
    truth = seen.truth()
    scattered, laid = seen.blurred()
    assert rms(laid, truth) < 0.6 * rms(scattered, truth)


def test_object_with_large_discs_only_renders_no_views(see):
    seen = see(flat(20.0, 28.0))
    assert seen.stage(seen.sharp(), seen.shot) is None
    assert seen.counted.count == 0


def test_object_in_focus_renders_no_views(see):
    seen = see(flat(1.0, -1.0))
    assert seen.sharp().largest_coc_px < 0.5
    assert seen.stage(seen.sharp(), seen.shot) is None


def test_static_object_renders_its_views_once(see):
    seen = see(flat(9.0, -9.0))
    first = seen.stage(seen.sharp(), seen.shot)
    drawn = seen.counted.count
    assert drawn == 4
    assert seen.stage(seen.sharp(), replace(seen.shot, time_s=0.5)) is first
    assert seen.counted.count == drawn
    other = replace(seen.shot, fit=replace(FIT, intercept=FIT.intercept + 0.1))
    assert seen.stage(object_coc(seen.sharp().layer, other.fit), other) is not first


def test_view_blend_does_not_flicker_while_focus_passes_through(see):
    seen = see(flat(9.0, -9.0))
    sharp = seen.sharp().layer
    results = []
    for shift in np.arange(-0.5, 0.5, 0.05):
        fit = replace(FIT, intercept=FIT.intercept + float(shift))
        shot, defocused = replace(seen.shot, fit=fit), object_coc(sharp, fit)
        views = seen.stage(defocused, shot)
        results.append(whole(views.blend_into(SCATTER(defocused, FRAME))))
    jumps = np.abs(np.diff(np.stack(results), axis=0)).max(axis=(1, 2, 3))
    second = np.abs(np.diff(np.stack(results), n=2, axis=0))
    assert jumps.max() < 0.15
    assert np.sqrt((second**2).mean(axis=(1, 2, 3))).max() < 3e-3


def test_views_do_not_depend_on_the_frame_around_the_object(see):
    seen = see(flat(9.0, -9.0))
    sharp = seen.sharp()
    views = seen.stage(sharp, seen.shot)
    camera = replace(seen.camera, cx=seen.camera.cx - 40, cy=seen.camera.cy - 8, width=260)
    layer = seen.renderer.render(0.0, camera)
    smaller = Box(0, 0, 260, SIZE[1])
    part = SampleSmallDiscs(renderer=seen.renderer)(
        object_coc(layer, FIT), replace(seen.shot, camera=camera, frame=smaller)
    )
    common = part.box.intersection(views.box.translated(-40, -8))
    there = views.rgba[common.slices_in(views.box.translated(-40, -8))]
    assert common.height > 100
    assert part.rgba[common.slices_in(part.box)] == pytest.approx(there, abs=2e-4)


def layer_of(coc):
    rgba = np.where(np.isfinite(coc)[..., None], np.float32(1.0), np.float32(0.0))
    rgba = np.broadcast_to(rgba, (*coc.shape, 4)).astype(np.float32)
    box = Box(5, 7, 5 + coc.shape[1], 7 + coc.shape[0])
    layer = ObjectLayer(box=box, rgba=rgba, depth=np.ones_like(coc))
    return DefocusedLayer(layer=layer, coc_px=np.nan_to_num(coc))


@pytest.mark.slow
@settings(max_examples=20)
@given(st.integers(0, 10_000))
def test_blend_weight_is_zero_within_reach_of_large_discs(seed):
    rng = np.random.default_rng(seed)
    coc = np.full((18, 22), np.nan, np.float32)
    for _ in range(3):
        y, x = rng.integers(0, 15), rng.integers(0, 18)
        coc[y : y + 5, x : x + 6] = rng.uniform(-20.0, 20.0)
    sharp = layer_of(coc)
    box, share = share_of_views(sharp, Box(0, 0, 60, 60))
    small = np.argwhere(np.abs(coc) < LARGE_COC_PX)
    assert box.empty == (len(small) == 0)
    for y in range(box.y0, box.y1):
        for x in range(box.x0, box.x1):
            taken = 0.0
            for v, u in np.argwhere(np.isfinite(coc)):
                size = abs(float(coc[v, u]))
                part = min(max((size - SMALL_COC_PX) / (LARGE_COC_PX - SMALL_COC_PX), 0.0), 1.0)
                away = math.hypot(v + 7 - y, u + 5 - x)
                taken = max(taken, part * (0.5 * size + SPARE_PX) - away)
            expected = 1.0 - min(taken / FADE_PX, 1.0)
            assert share[y - box.y0, x - box.x0] == pytest.approx(expected, abs=0.1)


@pytest.mark.parametrize("count", [3, 4, 6])
def test_few_aperture_samples_have_the_mean_and_variance_of_the_disc(count):
    points = points_around(count)
    assert points.weights.sum() == pytest.approx(1.0)
    assert points.weights @ points.places == pytest.approx([0.0, 0.0], abs=1e-12)
    spread = points.weights @ (np.sum(points.places**2, axis=1) + 0.5 * points.radii**2)
    assert spread == pytest.approx(0.5, rel=1e-9)
    assert len(np.unique(np.round(points.places[:, 0], 6))) == count + 1


def test_samples_of_an_aperture_picture_lie_where_light_passes(tmp_path):
    import cv2

    ring = np.zeros((64, 64), np.uint8)
    cv2.circle(ring, (32, 32), 28, 255, 6)
    cv2.imwrite(str(tmp_path / "ring.png"), ring)
    points = points_around(4, Aperture(image=tmp_path / "ring.png"))
    assert np.hypot(*points.places.T).min() > 0.5


def test_views_outside_the_blurred_layer_change_nothing():
    sharp = layer_of(np.zeros((4, 4), np.float32))
    blurred = SCATTER(sharp, Box(0, 0, 20, 20))
    views = ViewBlend(
        box=Box(15, 15, 20, 20),
        rgba=np.ones((5, 5, 4), np.float32),
        share=np.ones((5, 5), np.float32),
    )
    assert views.blend_into(blurred) is blurred
