"""The sampled lens: positions and weights of the views, their sum, and its convergence."""

import math

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace
from scipy.spatial import cKDTree
from support.cards import BLUR, FRAME, HEIGHT, NEAR_OVER_FAR, WIDTH, camera, card
from support.glb_builder import GlbBuilder
from support.lens_truth import psnr_over_plate

from nlens_video.core.lens_fit import LensFit
from nlens_video.core.optics import Aperture
from nlens_video.effects.motion_blur import mean_layer
from nlens_video.kernels.scatter.disc import round_coverage
from nlens_video.kernels.scatter.shape import contains
from nlens_video.render.opengl.object_renderer import PyrenderObjectRenderer
from nlens_video.render.software.raster import SAMPLE_X, SAMPLE_Y
from nlens_video.render.software.renderer import SoftwareObjectRenderer
from nlens_video.scene import Scene
from nlens_video.stages.l_aperture_samples import (
    _nearest,
    bare_points,
    lens_points,
    pixel_offsets,
)
from nlens_video.stages.l_lens_sampling import (
    BlurCell,
    LensSetup,
    SampleLens,
    lens_camera,
    lens_views,
    parallax_px,
    view_count,
)
from nlens_video.stages.l_reblur import object_coc

FIT = LensFit(slope=60.0, intercept=-20.0, width=WIDTH, height=HEIGHT)  # in focus at 3


def shot(fit=FIT):
    return LensSetup(time_s=0.0, camera=camera(), fit=fit, frame=FRAME)


@pytest.fixture(scope="module")
def renderer(tmp_path_factory):
    """A function from cards to a renderer of them."""
    opened = []
    folder = tmp_path_factory.mktemp("cards")

    def make(*cards):
        builder = GlbBuilder()
        for number, (depth, changes) in enumerate(cards):
            card(builder, depth, seed=number, **changes)
        scene = Scene.load(builder.write(folder / f"{len(opened)}.glb"))
        opened.append(PyrenderObjectRenderer(scene))
        return opened[-1]

    yield make
    for one in opened:
        one.close()


def centre(drawn, fit=FIT):
    return object_coc(drawn.render(0.0, camera(), margin=40), fit)


def whole(blurred):
    out = np.zeros((HEIGHT, WIDTH, 4), np.float32)
    out[blurred.box.slices_in(FRAME)] = blurred.rgba
    return out


def sampled(drawn, accuracy_db=50.0, fit=FIT, **changes):
    stage = SampleLens(
        renderer=drawn,
        whole=BLUR,
        mean=mean_layer,
        cell=BlurCell(BLUR),
        count=view_count(accuracy_db),
        **changes,
    )
    return whole(stage(centre(drawn, fit), shot(fit)))


def truth(drawn, views, fit=FIT):
    return whole(lens_views(drawn, shot(fit), bare_points(views)))


@pytest.fixture(scope="module")
def near_over_far(renderer):
    """A narrow card before a wide one."""
    return renderer(*NEAR_OVER_FAR)


@pytest.fixture(scope="module")
def near_over_far_truth(near_over_far):
    """What 1024 points of the lens see of it."""
    return truth(near_over_far, views=1024)


@given(
    st.floats(0.1, 5.0), st.floats(-1.0, 1.0), st.floats(-1.0, 1.0), st.floats(0.0, 90.0),
    st.floats(-40.0, 40.0), st.floats(0.5, 2.0),
)  # fmt: skip
def test_surface_point_moves_by_half_its_coc_across_the_aperture(
    disparity, u, v, slope, intercept, aspect
):
    fit = LensFit(slope=slope, intercept=intercept, width=WIDTH, height=HEIGHT)
    turned = np.eye(4)
    turned[:3, :3] = [[0, 0, 1], [1, 0, 0], [0, 1, 0]]
    turned[:3, 3] = [1.0, -2.0, 0.5]
    middle = replace(camera(aspect), world_from_camera=turned)
    world = np.array([[0.2, -0.1, -1.0, 0.0]]) / disparity @ turned.T + turned[:, 3]
    seen = [
        view.pixels(view.to_camera(world[:, :3]))[0]
        for view in (middle, lens_camera(middle, fit, u, v))
    ]
    coc = slope * disparity + intercept
    np.testing.assert_allclose(
        seen[1] - seen[0], [0.5 * coc * u, 0.5 * coc * v * aspect], atol=1e-8
    )


@pytest.mark.parametrize("count", [8, 16, 64])
@pytest.mark.parametrize("aperture", [Aperture(), Aperture(blades=6, rotation_deg=10.0)])
def test_aperture_cells_have_the_apertures_area_centre_and_variance(count, aperture):
    points = lens_points(count, aperture)
    assert points.weights.sum() == pytest.approx(1.0)
    assert np.abs(points.weights @ points.places).max() < 2e-3
    if aperture.round:  # the second moment of a disc is a quarter of its radius squared
        own = 0.25 * points.radii**2
        moments = points.weights @ (points.places**2 + own[:, None])
        np.testing.assert_allclose(moments, 0.25, atol=0.006)
    else:
        assert contains(aperture, *-points.places.T).all()


def test_asymmetric_aperture_is_rotated_as_a_near_highlight():
    triangle = Aperture(blades=3)  # behind the focus a corner points right
    assert lens_points(32, triangle).places[:, 0].min() < -1.0
    assert lens_points(32, triangle).places[:, 0].max() < 0.8


def test_aperture_picture_weights_samples_by_transmitted_light(tmp_path):
    picture = np.zeros((40, 40), np.uint8)
    picture[:, :20], picture[:, 20:] = 255, 85
    assert cv2.imwrite(str(tmp_path / "half.png"), picture)
    points = lens_points(24, Aperture(image=tmp_path / "half.png"))
    left_behind = points.places[:, 0] > 0  # turned by half a turn
    assert points.weights[left_behind].sum() == pytest.approx(0.75, abs=0.05)


def test_aperture_samples_are_deterministic():
    first = lens_points(16)
    lens_points.cache_clear()
    assert np.array_equal(first.places, lens_points(16).places)


@pytest.mark.parametrize("count", [1, 7, 200])
def test_cells_are_of_the_points_nearest_to_their_centre(count):
    rng = np.random.default_rng(count)
    centres, places = rng.normal(size=(count, 2)), rng.normal(size=(3000, 2))
    assert np.array_equal(_nearest(centres, places), cKDTree(centres).query(places)[1])


def test_number_of_aperture_samples_follows_the_requested_accuracy():
    # 35.5 dB + 10 log10 of the count: 50.5 dB take 10^1.5 views
    counts = [view_count(accuracy) for accuracy in (30.0, 45.5, 50.5, 99.0)]
    assert counts == [8, 10, 32, 256]


@pytest.mark.needs_gl
def test_card_facing_the_camera_is_blurred_by_the_exact_disc(renderer):
    drawn = renderer((2.0, {}))  # coc_px = 60 / 2 - 20 = 10
    views = whole(lens_views(drawn, shot(), bare_points(256)))
    layer = drawn.render(0.0, camera())
    sharp = np.zeros((HEIGHT, WIDTH, 4), np.float32)
    sharp[layer.box.slices_in(FRAME)] = layer.rgba
    disc = round_coverage(5.0, 5.0).astype(np.float32)
    assert psnr_over_plate(views, cv2.filter2D(sharp, -1, disc)) > 50.0


@pytest.mark.slow
@pytest.mark.needs_gl
def test_slanted_card_through_focus_agrees_with_the_ground_truth(renderer):
    drawn = renderer((3.0, {"half": (0.35, 0.25), "lean": 1.2}))
    defocused = centre(drawn)
    coc = defocused.coc_px[defocused.layer.rgba[..., 3] > 0]
    assert coc.min() < -4.0 and coc.max() > 8.0
    assert psnr_over_plate(sampled(drawn), truth(drawn, 256)) > 50.0


@pytest.mark.slow
@pytest.mark.needs_gl
def test_self_occlusion_is_correct_where_scatter_is_wrong(near_over_far, near_over_far_truth):
    blurred = whole(BLUR(centre(near_over_far), FRAME))
    scattered = psnr_over_plate(blurred, near_over_far_truth)
    assert psnr_over_plate(sampled(near_over_far), near_over_far_truth) > max(
        50.0, scattered + 12.0
    )


@pytest.mark.slow
@pytest.mark.needs_gl
def test_error_decreases_with_the_number_of_samples_as_predicted(
    near_over_far, near_over_far_truth
):
    reached = []
    for wanted in (44.6, 47.6, 50.6):
        reached.append(psnr_over_plate(sampled(near_over_far, wanted), near_over_far_truth))
        assert reached[-1] > wanted
    assert reached == sorted(reached)


@pytest.mark.slow
@pytest.mark.needs_gl
def test_predicted_error_holds_for_a_narrow_sharp_card_before_a_blurred_one(renderer):
    # in focus at 1.4, so the wide card behind is blurred by 26 px
    fit = LensFit(slope=56.0, intercept=-40.0, width=WIDTH, height=HEIGHT)
    drawn = renderer(*NEAR_OVER_FAR)
    views = truth(drawn, 512, fit)
    for wanted in (44.6, 50.6):
        assert psnr_over_plate(sampled(drawn, wanted, fit=fit), views) > wanted


@pytest.mark.slow
@pytest.mark.needs_gl
def test_discs_too_large_to_gather_are_scattered(near_over_far):
    wide = LensFit(slope=300.0, intercept=-100.0, width=WIDTH, height=HEIGHT)  # 114 px, cells 40
    assert (
        psnr_over_plate(sampled(near_over_far, 40.0, fit=wide), truth(near_over_far, 256, fit=wide))
        > 40.0
    )


@pytest.mark.needs_gl
def test_sampled_alpha_is_one_inside_and_zero_out_of_reach(near_over_far):
    alpha = sampled(near_over_far)[..., 3]
    np.testing.assert_allclose(alpha[50:70, 70:90], 1.0, atol=1e-5)
    # The far card ends 45 px from the middle and reaches 2.5 px more, and a pixel of its edge.
    assert not alpha[:, : 80 - 49].any() and alpha[60, 80 - 44] > 0.0


@pytest.mark.needs_gl
def test_lens_sampling_is_deterministic(near_over_far):
    assert np.array_equal(sampled(near_over_far), sampled(near_over_far))


def cards_scene(folder, *cards):
    builder = GlbBuilder()
    for number, (depth, changes) in enumerate(cards):
        card(builder, depth, seed=number, **changes)
    return Scene.load(builder.write(folder / "cards.glb"))


def test_lens_sampling_is_bit_identical_on_any_number_of_threads(tmp_path):
    scene = cards_scene(tmp_path, *NEAR_OVER_FAR)
    with SoftwareObjectRenderer(scene, threads=1) as one, SoftwareObjectRenderer(scene) as many:
        assert np.array_equal(sampled(one), sampled(many))


def test_views_rendered_in_parallel_equal_those_rendered_in_sequence(tmp_path):
    scene, seen = cards_scene(tmp_path, *NEAR_OVER_FAR), {}
    cameras = [lens_camera(camera(), FIT, u, v) for u, v in lens_points(8).places.tolist()]
    behind = replace(camera(), world_from_camera=np.diag([1.0, 1.0, -1.0, 1.0]))
    with SoftwareObjectRenderer(scene) as drawn:
        drawn.render_views(0.0, [*cameras, behind], 4, seen.__setitem__, nearest=True)
        assert sorted(seen) == list(range(9)) and seen.pop(8) is None
        for at, layer in seen.items():
            alone = drawn.render(0.0, cameras[at], 4, nearest=True)
            assert layer.box == alone.box
            assert np.array_equal(layer.rgba, alone.rgba)
            assert np.array_equal(layer.depth, alone.depth)


def test_views_are_summed_in_order_whichever_finishes_first(tmp_path):
    class Backwards(SoftwareObjectRenderer):
        def render_views(self, time_s, cameras, margin, use, **how):
            views = {}
            super().render_views(time_s, cameras, margin, views.__setitem__, **how)
            for at in sorted(views, reverse=True):
                use(at, views[at])

    scene = cards_scene(tmp_path, *NEAR_OVER_FAR)
    with SoftwareObjectRenderer(scene) as drawn, Backwards(scene) as backwards:
        assert np.array_equal(sampled(drawn), sampled(backwards))


@pytest.mark.parametrize("kind", [SoftwareObjectRenderer, PyrenderObjectRenderer])
@pytest.mark.needs_gl
def test_error_in_a_view_is_raised(tmp_path, kind):
    def fail(at, _):
        if at == 2:
            raise ZeroDivisionError

    with kind(cards_scene(tmp_path, *NEAR_OVER_FAR)) as drawn, pytest.raises(ZeroDivisionError):
        drawn.render_views(0.0, [camera()] * 4, 0, fail)


@pytest.mark.needs_gl
def test_object_without_parallax_is_blurred_at_once_from_shifted_pictures(near_over_far):
    constant = LensFit(slope=0.0, intercept=-9.0, width=WIDTH, height=HEIGHT)
    defocused = centre(near_over_far, constant)
    assert parallax_px(defocused) == 0.0
    seen = sampled(near_over_far, fit=constant)
    views = truth(near_over_far, 256, fit=constant)
    assert psnr_over_plate(seen, views) > psnr_over_plate(whole(BLUR(defocused, FRAME)), views)
    assert psnr_over_plate(seen, views) > 50.0


@pytest.mark.parametrize("count", [16, 28])
def test_shifted_pictures_have_evenly_spaced_columns_and_rows_of_samples(count):
    offsets = pixel_offsets(count)
    assert np.abs(offsets.mean(axis=0)).max() < 1e-12
    every = np.sort((np.array(SAMPLE_X)[:, None] + offsets[:, 0]).ravel())
    np.testing.assert_allclose(np.diff(every), 0.25 / count, atol=1e-12)
    every = np.sort((np.array(SAMPLE_Y)[:, None] + offsets[:, 1]).ravel())
    assert np.diff(every).max() < 0.75 / count


@pytest.mark.needs_gl
def test_object_reaching_behind_the_camera_gives_finite_values(renderer):
    drawn = renderer((1.0, {"half": (0.8, 0.2), "lean": -2.0}))
    rgba = sampled(drawn)
    assert np.isfinite(rgba).all() and rgba[..., 3].max() <= 1.0 + 1e-5
    assert rgba[60, 50, 3] == pytest.approx(1.0, abs=1e-4)


@pytest.mark.needs_gl
def test_cat_eye_narrows_the_blur_at_the_side_and_keeps_light(renderer):
    drawn = renderer(
        (2.0, {"half": (0.013, 0.013), "at": (-0.45, 0.0)}), (2.1, {"half": (0.1, 0.1)})
    )
    wide, cut = (sampled(drawn, aperture=Aperture(cat_eye=e)) for e in (0.0, 0.9))
    np.testing.assert_allclose(cut[60, 80, 3], 1.0, atol=1e-4)  # in the middle nothing is cut
    np.testing.assert_allclose(cut[55:66, 75:86], wide[55:66, 75:86], atol=0.05)
    spreads = []
    for rgba in (wide, cut):
        alpha = rgba[:, :40, 3]
        place = (alpha.sum(axis=0) @ np.arange(40)) / alpha.sum()
        spreads.append((alpha.sum(axis=0) @ (np.arange(40) - place) ** 2) / alpha.sum())
    assert spreads[1] < 0.8 * spreads[0]
    assert math.isclose(cut[:, :40, 3].sum(), wide[:, :40, 3].sum(), rel_tol=0.1)
