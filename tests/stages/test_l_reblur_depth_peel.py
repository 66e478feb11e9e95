import numpy as np
import pytest
from msgspec.structs import replace

from nlens_video.core.errors import NlensError
from nlens_video.core.layers import Box
from nlens_video.core.lens_fit import LensFit
from nlens_video.evaluate.bench.glb_writer import TexturedMesh, write_glb
from nlens_video.evaluate.bench.shapes import (
    YFOV,
    Place,
    SceneLens,
    card,
    rectangle,
    tube,
)
from nlens_video.graph.base.node import DEPTH_STEPS
from nlens_video.kernels.scatter.scatter import blur_reach, scatter
from nlens_video.render.opengl.object_renderer import PyrenderObjectRenderer
from nlens_video.render.software.renderer import SoftwareObjectRenderer
from nlens_video.scene import Scene
from nlens_video.stages.l_aperture_samples import bare_points
from nlens_video.stages.l_depth_order import RepairDepthOrder
from nlens_video.stages.l_lens_sampling import LensSetup, lens_views
from nlens_video.stages.l_reblur import ReblurLayer, depth_peel, object_coc

RENDERERS = {"opengl": PyrenderObjectRenderer, "software": SoftwareObjectRenderer}

OPTICS = SceneLens(slope=112.0, intercept=-56.0)
SIZE = (320, 160)
FRAME = Box(0, 0, *SIZE)
FIT = LensFit(slope=OPTICS.slope, intercept=OPTICS.intercept, width=960, height=480).for_width(
    *SIZE
)
RED, BLUE = (230, 20, 20), (0, 60, 220)


def flat(corners, color):
    surface = card(OPTICS, corners, 1)
    return replace(surface, texture=np.full((8, 8, 3), color, np.uint8))


def upright(x, coc, rows, color):
    return flat(rectangle(Place(x[0], 0, coc), Place(x[1], 0, coc), rows), color)


ROD = upright((466, 494), 27.0, (60, 420), BLUE)
HIDDEN = upright((470, 490), 1.0, (120, 360), RED)
WIDE = upright((380, 580), -20.0, (60, 420), RED)


def unasked(geometry):
    raise AssertionError("the network is not asked where it is known what is hidden")


REPAIR = RepairDepthOrder(network=unasked, scatter=scatter, reach=blur_reach)
SCATTER = ReblurLayer(scatter=scatter, reach=blur_reach)


class Seen:
    """An object of some surfaces through the lens."""

    def __init__(self, path, surfaces, kind):
        write_glb(path, surfaces, YFOV)
        self.scene = Scene.load(path)
        self.camera = self.scene.camera(0.0, *SIZE)
        self.renderer = kind(self.scene)

    def peeled(self, camera=None, fit=FIT):
        front = self.renderer.render(0.0, camera or self.camera, 20)
        depth = self.camera.to_camera(self.scene.pose(0.0).vertices().astype(float))[:, 2]
        return depth_peel(object_coc(front, fit), fit, float(-depth.min()), self.renderer)

    def blurred(self, camera=None, fit=FIT):
        """What the scatter and what the repair makes of it, on the frame."""
        sharp = self.peeled(camera, fit)
        scattered = SCATTER(sharp, FRAME)
        return on_frame(scattered), on_frame(REPAIR(sharp, scattered))

    def truth(self, views=400):
        shot = LensSetup(time_s=0.0, camera=self.camera, fit=FIT, frame=FRAME)
        return on_frame(lens_views(self.renderer, shot, bare_points(views)))


def on_frame(layer):
    out = np.zeros((FRAME.height, FRAME.width, 4), np.float32)
    out[layer.box.slices_in(FRAME)] = layer.rgba
    return out


@pytest.fixture(params=[pytest.param("opengl", marks=pytest.mark.needs_gl), "software"])
def see(tmp_path, request):
    opened = []

    def make(*surfaces):
        seen = Seen(tmp_path / f"{len(opened)}.glb", surfaces, RENDERERS[request.param])
        opened.append(seen)
        return seen

    yield make
    for seen in opened:
        seen.renderer.close()


@pytest.mark.slow
def test_hidden_card_shows_through_the_blur_of_a_near_rod_as_by_a_sampled_lens(see):
    seen = see(ROD, HIDDEN)
    truth = seen.truth()
    scattered, repaired = seen.blurred()
    middle = (slice(60, 100), slice(158, 163))
    red = truth[middle][..., 0].mean()
    assert scattered[middle][..., 0].mean() < 0.3 * red
    assert repaired[middle][..., 0].mean() == pytest.approx(red, rel=0.05)
    error, before = (np.abs(found - truth).max(axis=2) for found in (repaired, scattered))
    assert np.sqrt((error**2).mean()) < 0.35 * np.sqrt((before**2).mean())


def test_hidden_layer_does_not_depend_on_pictures_rendered_in_between(see):
    seen, other = see(ROD, HIDDEN), see(WIDE)
    front = seen.renderer.render(0.0, seen.camera, 20)
    alone = seen.renderer.render_behind(front, front.box, 0.05)
    other.peeled()
    seen.renderer.render(0.0, replace(seen.camera, cx=seen.camera.cx + 40.0), 20)
    after = seen.renderer.render_behind(front, front.box, 0.05)
    assert alone.hidden.rgba.any()
    assert np.array_equal(alone.hidden.rgba, after.hidden.rgba)
    assert np.array_equal(alone.hidden.depth, after.hidden.depth)


def test_hidden_layer_behind_a_rod_before_nothing_is_empty(see):
    seen = see(ROD)
    sharp = seen.peeled()
    assert sharp.behind.box.empty
    scattered = SCATTER(sharp, FRAME)
    assert REPAIR(sharp, scattered) is scattered
    assert not DEPTH_STEPS.test(sharp)


def test_surface_that_hides_nothing_keeps_the_scattered_layer(see):
    corners = rectangle(Place(380, 0, 28.0), Place(580, 0, -28.0), (60, 420))
    sharp = see(flat(corners, RED)).peeled()
    assert sharp.behind.box.empty
    scattered = SCATTER(sharp, FRAME)
    assert REPAIR(sharp, scattered) is scattered


def test_hidden_layer_has_its_own_colour_and_coc(see):
    seen = see(WIDE, ROD)
    behind = seen.peeled().behind
    inside = Box(156, 40, 164, 120).slices_in(behind.box)
    light = seen.blurred()[1][5:]
    assert np.isfinite(light).all()
    assert behind.rgba[inside][..., 3].min() == 1.0
    assert behind.coc_px[inside] == pytest.approx(np.full((80, 8), -20.0 / 3.0), abs=0.02)
    assert (behind.rgba[inside][..., 0] > 10 * behind.rgba[inside][..., 2]).all()


def test_antialiased_front_pixel_holds_only_its_own_coverage(see):
    tilted = [
        Place(455, 420, 26.0),
        Place(495, 420, 26.0),
        Place(515, 60, 26.0),
        Place(475, 60, 26.0),
    ]
    seen = see(WIDE, flat(tilted, BLUE))
    sharp = seen.peeled()
    behind, whole = sharp.behind, sharp.layer
    front = behind.front_rgba
    picture = whole.rgba[behind.box.slices_in(whole.box)]
    partly = (front[..., 3] > 0.0) & (front[..., 3] < 1.0) & (picture[..., 3] == 1.0)
    assert partly.sum() > 50
    assert np.isin(front[partly][:, 3], (0.25, 0.5, 0.75)).all()
    again = front + (1.0 - front[..., 3:]) * behind.rgba
    assert again[partly] == pytest.approx(picture[partly], abs=2e-3)


def test_interior_of_a_closed_double_sided_mesh_is_not_a_hidden_layer(see):
    path = np.array([OPTICS.point(Place(480, y, 20.0)) for y in (100, 240, 380)])
    radius = OPTICS.size(Place(480, 240, 20.0), 60)
    assert see(tube(path, [radius] * 3, 3)).peeled().behind.box.empty


def ball(place, radius_px, *, rings=12):
    """A textured ball; as exporters do, two of three corners of a triangle at a pole are one."""
    turn, down = np.meshgrid(
        np.linspace(0.0, 2.0 * np.pi, 2 * rings + 1), np.linspace(0.0, np.pi, rings + 1)
    )
    normals = np.stack([np.sin(down) * np.cos(turn), np.cos(down), np.sin(down) * np.sin(turn)], 2)
    row = 2 * rings + 1
    at = np.arange(rings)[:, None] * row + np.arange(2 * rings)[None, :]
    first = np.stack([at, at + 1, at + row], axis=2).reshape(-1, 3)
    second = np.stack([at + 1, at + row + 1, at + row], axis=2).reshape(-1, 3)
    return TexturedMesh(
        points=OPTICS.point(place) + OPTICS.size(place, radius_px) * normals.reshape(-1, 3),
        uv=np.stack([turn.ravel(), down.ravel()], axis=1),
        faces=np.concatenate([first, second]),
        texture=np.full((8, 8, 3), RED, np.uint8),
    )


def test_triangles_without_area_do_not_open_a_closed_mesh(see):
    assert see(ball(Place(480, 240, 20.0), 60)).peeled().behind.box.empty


def test_inner_side_of_an_open_shell_is_a_hidden_layer(see):
    path = np.array([OPTICS.point(Place(480, y, 20.0)) for y in (100, 240, 380)])
    whole = tube(path, [OPTICS.size(Place(480, 240, 20.0), 60)] * 3, 3)
    behind = see(replace(whole, faces=whole.faces[:-32])).peeled().behind
    assert (behind.rgba[..., 3] > 0.0).any()


def test_hidden_layer_can_be_rendered_for_an_earlier_picture(see):
    seen = see(ROD, WIDE)
    first = seen.renderer.render(0.0, seen.camera, 1)
    at_once = seen.renderer.render_behind(first, first.box, 0.01)
    last = seen.renderer.render(0.0, seen.camera)
    later = seen.renderer.render_behind(first, first.box, 0.01)
    assert np.array_equal(later.hidden.rgba, at_once.hidden.rgba)
    assert np.array_equal(later.hidden.depth, at_once.hidden.depth)
    with pytest.raises(ValueError, match="not rendered by this renderer"):
        seen.renderer.render_behind(replace(last), last.box, 0.01)
    with pytest.raises(ValueError, match="within"):
        seen.renderer.render_behind(last, last.box.expanded(1), 0.01)
    assert seen.renderer.render_behind(last, last.box, 0.01) is not None
    seen.renderer.close()
    with pytest.raises(NlensError):
        seen.renderer.render_behind(last, last.box, 0.01)


def test_rendering_the_hidden_layer_changes_no_later_picture(see):
    seen = see(WIDE, ROD)
    before = seen.renderer.render(0.0, seen.camera)
    seen.renderer.render_behind(before, before.box, 0.01)
    assert seen.renderer.render(0.0, seen.camera, 1) is not before  # else at rest
    after = seen.renderer.render(0.0, seen.camera)
    assert np.array_equal(before.rgba, after.rgba)
    assert np.array_equal(before.depth, after.depth)


def rough(frames):
    return np.abs(np.diff(frames, n=2, axis=0))


def test_blur_with_hidden_layer_does_not_flicker_while_the_object_slides(see):
    seen = see(WIDE, ROD)
    pairs = [
        seen.blurred(replace(seen.camera, cx=seen.camera.cx + 0.1 * step)) for step in range(15)
    ]
    scattered, repaired = (rough([pair[kind] for pair in pairs]) for kind in (0, 1))
    assert repaired.max() < 1.5 * scattered.max()
    assert np.quantile(repaired, 0.999) < 1.5 * np.quantile(scattered, 0.999)


def test_blur_with_hidden_layer_does_not_flicker_during_a_focus_pull(see):
    seen = see(WIDE, ROD)
    frames = [
        seen.blurred(fit=replace(FIT, intercept=FIT.intercept + 0.25 * step))[1]
        for step in range(-10, 11)
    ]
    assert rough(frames).max() < 0.03


@pytest.mark.slow
def test_hidden_layer_fades_in_with_its_distance(see):
    frames = []
    for coc in np.linspace(27.0, 12.0, 31):  # from no step at all to one of 5 px
        seen = see(ROD, upright((470, 490), coc - 0.5, (120, 360), RED))
        frames.append(seen.blurred()[1])
    assert rough(frames).max() < 0.05
