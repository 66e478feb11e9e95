"""The sampled lens from frame to frame: no flicker, and no dependence on the frame's size."""

import numpy as np
import pytest
from msgspec.structs import replace
from support.cards import BLUR, FRAME, NEAR_OVER_FAR, camera, card
from support.glb_builder import GlbBuilder

from nlens_video.core.layers import Box
from nlens_video.core.lens_fit import LensFit
from nlens_video.effects.motion_blur import mean_layer
from nlens_video.kernels.scatter.subaperture_gather import LARGEST_RADIUS_PX
from nlens_video.render.opengl.object_renderer import PyrenderObjectRenderer
from nlens_video.scene import Scene
from nlens_video.stages.l_aperture_samples import bare_points, lens_points
from nlens_video.stages.l_lens_sampling import (
    BlurCell,
    LensSetup,
    SampleLens,
    lens_views,
)
from nlens_video.stages.l_reblur import object_coc

VIEWS = 8
pytestmark = pytest.mark.needs_gl


@pytest.fixture(scope="module")
def drawn(tmp_path_factory):
    builder = GlbBuilder()
    for number, (depth, changes) in enumerate(NEAR_OVER_FAR):
        card(builder, depth, seed=number, **changes)
    scene = Scene.load(builder.write(tmp_path_factory.mktemp("cards") / "cards.glb"))
    with PyrenderObjectRenderer(scene) as renderer:
        yield renderer


def lens(near, far):
    """The lens that gives the cards of `NEAR_OVER_FAR` these CoCs."""
    slope = (near - far) / (1 / 1.4 - 1 / 4.0)
    return LensFit(slope=slope, intercept=far - slope / 4.0, width=FRAME.width, height=FRAME.height)


def seen(drawn, fit, *, slide=0.0, frame=FRAME, views=None):
    """The blurred layer on the whole frame, everything `slide` px further right."""
    middle = camera()
    middle = replace(middle, cx=middle.cx + slide, width=frame.width, height=frame.height)
    shot = LensSetup(time_s=0.0, camera=middle, fit=fit, frame=frame)
    if views is None:
        stage = SampleLens(
            renderer=drawn, whole=BLUR, mean=mean_layer, cell=BlurCell(BLUR), count=VIEWS
        )
        blurred = stage(object_coc(drawn.render(0.0, middle, margin=40), fit), shot)
    else:
        blurred = lens_views(drawn, shot, bare_points(views))
    out = np.zeros((frame.height, frame.width, 4), np.float32)
    out[blurred.box.slices_in(frame)] = blurred.rgba
    return out


def largest_bend(frames):
    """The largest mean second difference from frame to frame: what pops shows there."""
    return float(np.abs(np.diff(np.stack(frames), 2, axis=0)).mean(axis=(1, 2, 3)).max())


def test_sampled_lens_does_not_flicker_while_the_object_slides(drawn):
    # Antialiased edges bend by themselves as they cross pixels: as many bare views say how much.
    fit, slides = lens(9.0, -3.0), np.arange(0.0, 1.2, 0.1)
    frames = [seen(drawn, fit, slide=slide) for slide in slides]
    bare = [seen(drawn, fit, slide=slide, views=VIEWS) for slide in slides]
    sharp = [seen(drawn, fit, slide=slide, views=1) for slide in slides]
    assert largest_bend(frames) < 1.1 * largest_bend(bare)
    assert largest_bend(frames) < 0.67 * largest_bend(sharp)


@pytest.mark.slow
def test_sampled_lens_does_not_flicker_while_passing_through_focus(drawn):
    fits = [lens(coc, coc - 10.0) for coc in np.arange(-3.0, 13.0, 0.5)]
    frames = [seen(drawn, fit) for fit in fits]
    bare = [seen(drawn, fit, views=VIEWS) for fit in fits]
    assert largest_bend(frames) < 1.2 * largest_bend(bare)


def test_sampled_lens_does_not_flicker_where_gather_changes_to_scatter(drawn):
    limit = 2.0 * LARGEST_RADIUS_PX / float(lens_points(VIEWS).radii.max())
    frames = [seen(drawn, lens(limit + step, -4.0)) for step in np.arange(-1.0, 1.0, 0.2)]
    bends = np.abs(np.diff(np.stack(frames), 2, axis=0)).mean(axis=(1, 2, 3))
    across = np.argsort(bends)[-2:]
    assert bends[across].max() < 2e-3  # half a code value, over both cards


def test_sampled_lens_in_a_smaller_frame_agrees_where_both_see_the_object(drawn):
    fit = lens(9.0, -3.0)
    small = Box(0, 0, 97, 71)
    part, whole = seen(drawn, fit, frame=small), seen(drawn, fit)
    # Another box rounds otherwise: here and there one of four samples of one or two of the views.
    difference = np.abs(part - whole[:71, :97])
    assert difference.mean() < 3e-4 and difference.max() < 1.5 * 0.25 / VIEWS


@pytest.mark.parametrize("coc", [0.0, 0.6, 3.0])
def test_edge_of_an_object_without_parallax_goes_by_less_than_a_tenth_of_a_pixel(drawn, coc):
    fit = LensFit(slope=0.0, intercept=coc, width=FRAME.width, height=FRAME.height)
    frames = [seen(drawn, fit, slide=slide)[..., 3] for slide in np.arange(0.0, 1.0, 0.05)]
    # of a width of 0.05 px; a picture of four samples a pixel changes by 0.25 at once
    assert np.abs(np.diff(np.stack(frames), axis=0)).max() < 0.05 + 1.5 / 64
