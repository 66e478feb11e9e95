"""The sampled lens beside the scatter of the whole aperture: where both must say the same."""

from functools import partial

import numpy as np
import pytest
from support.cards import BLUR, FRAME, camera, card
from support.glb_builder import GlbBuilder

from nlens_video.core.lens_fit import LensFit
from nlens_video.core.optics import Aperture
from nlens_video.effects.motion_blur import mean_layer
from nlens_video.kernels.scatter.scatter import blur_reach, scatter
from nlens_video.render.software.renderer import SoftwareObjectRenderer
from nlens_video.scene import Scene
from nlens_video.stages.l_aperture_samples import lens_points
from nlens_video.stages.l_lens_sampling import (
    NEGLIGIBLE_PARALLAX_PX,
    WHOLE_PARALLAX_PX,
    BlurCell,
    LensSetup,
    SampleLens,
    lens_views,
)
from nlens_video.stages.l_reblur import ReblurLayer, object_coc


@pytest.fixture
def renderer(tmp_path):
    opened = []

    def make(*cards):
        builder = GlbBuilder()
        for number, (depth, changes) in enumerate(cards):
            card(builder, depth, seed=number, **changes)
        opened.append(SoftwareObjectRenderer(Scene.load(builder.write(tmp_path / "cards.glb"))))
        return opened[-1]

    yield make
    for one in opened:
        one.close()


def shot(fit):
    return LensSetup(time_s=0.0, camera=camera(), fit=fit, frame=FRAME)


def whole(blurred):
    out = np.zeros((FRAME.height, FRAME.width, 4), np.float32)
    out[blurred.box.slices_in(FRAME)] = blurred.rgba
    return out


def middle(alpha):
    """Column and row of the mean of a coverage [px]."""
    rows, columns = np.indices(alpha.shape)
    return np.array([(alpha * columns).sum(), (alpha * rows).sum()]) / alpha.sum()


@pytest.mark.parametrize("coc", [10.0, -10.0])
def test_cat_eye_cuts_the_side_of_the_disc_that_the_scatter_cuts(renderer, coc):
    drawn = renderer((2.0, {"half": (0.013, 0.013), "at": (-0.4, 0.25)}))
    fit = LensFit(slope=0.0, intercept=coc, width=FRAME.width, height=FRAME.height)
    eye = Aperture(cat_eye=0.9)
    views = whole(lens_views(drawn, shot(fit), lens_points(128), aperture=eye))
    sharp = object_coc(drawn.render(0.0, camera(), margin=40), fit)
    blur = ReblurLayer(
        scatter=partial(scatter, aperture=eye), reach=partial(blur_reach, aperture=eye)
    )
    spread = whole(blur(sharp, FRAME))
    uncut = whole(BLUR(sharp, FRAME))
    moved = middle(views[..., 3]) - middle(uncut[..., 3])
    assert np.hypot(*moved) > 1.0
    assert moved == pytest.approx(middle(spread[..., 3]) - middle(uncut[..., 3]), abs=0.15)


@pytest.mark.slow
@pytest.mark.parametrize("coc", [4.0, 12.0])
def test_sampled_lens_does_not_pop_where_it_takes_over_from_the_scatter(renderer, coc):
    drawn = renderer((2.0, {"half": (0.2, 0.2)}), (2.2, {"half": (0.16, 0.16), "at": (0.3, 0.0)}))
    stage = SampleLens(renderer=drawn, whole=BLUR, mean=mean_layer, cell=BlurCell(BLUR), count=16)
    frames = []
    for parallax in np.arange(NEGLIGIBLE_PARALLAX_PX - 0.05, WHOLE_PARALLAX_PX + 0.1, 0.02):
        slope = parallax / (1 / 2.0 - 1 / 2.2)
        fit = LensFit(
            slope=slope, intercept=coc - slope / 2.0, width=FRAME.width, height=FRAME.height
        )
        sharp = object_coc(drawn.render(0.0, camera(), margin=40), fit)
        frames.append(whole(stage(sharp, shot(fit))))
    steps = np.sqrt((np.diff(np.stack(frames), axis=0) ** 2).mean(axis=(1, 2, 3)))
    assert steps.max() < 1.2e-3  # 0.7e-3 where edges pass samples; 2.2e-3 and more at once
