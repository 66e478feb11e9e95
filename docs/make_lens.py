"""Draw the pictures of docs/how-the-lens-is-found.md from the first frame of the samples.

python docs/make_lens.py
"""

from __future__ import annotations

import json
from pathlib import Path

import matplotlib as mpl

mpl.use("Agg")
import matplotlib.pyplot as plt
import numpy as np
from make_picture import frame_of
from matplotlib.axes import Axes

from nlens_video.core.layers import DefocusedLayer
from nlens_video.core.settings import ObjectSettings
from nlens_video.graph.base.plate_preview import PlatePreview
from nlens_video.graph.base.profiler import Profiler
from nlens_video.graph.base.values import ShotValues
from nlens_video.graph.base.view import View
from nlens_video.graph.effect_plan import LensRequest
from nlens_video.graph.session import open_session
from nlens_video.stages.p_projection import GroundProjection
from nlens_video.stages.r_regression import Regression
from nlens_video.video.info import SourceFrame
from nlens_video.video.pixels.picture import ArrayPicture

ROOT = Path(__file__).parents[1]
OUT = ROOT / "docs" / "lens"
SHOT, FRAME = "in", 0
COC_COLORS, SIGMA_COLORS = "viridis", "cividis"
DRAWN_SAMPLES = 2500
HEADROOM = 1.5  # above the line: discs of which F is unsure may be read several times as large


def first_frame() -> tuple[np.ndarray, ShotValues, DefocusedLayer, np.ndarray]:
    """The plate, what was found on it, the object's CoC, and the composite."""
    plate = np.asarray(frame_of(ROOT / "samples" / f"{SHOT}.mp4", FRAME))
    composite = np.ascontiguousarray(plate[..., ::-1])
    picture = ArrayPicture(composite)
    session = open_session(
        ObjectSettings(glb=ROOT / "samples" / "anim.glb"),
        LensRequest(effects="defocus,shadow"),
        View(width=plate.shape[1], height=plate.shape[0], camera=None),
        Profiler(180.0),
        PlatePreview(lambda: (picture,)),
    )
    with session.render_context():
        state = session.executor.begin_frame(SourceFrame(index=FRAME, picture=picture))
        session.executor.run(state, session.graph.nodes)
        defocused, blurred = state.values.defocused, state.values.blurred
        if defocused is None or blurred is None:
            raise TypeError("the sample's object is out of view")
    return plate, session.executor.shot, defocused, composite[..., ::-1]


def colored(
    axes: Axes, plate: np.ndarray, values: np.ndarray, colors: str, top_px: float, label: str
) -> None:
    """Values over the grey picture, with their scale."""
    axes.imshow(plate.mean(axis=-1), cmap="gray")
    drawn = axes.imshow(values, cmap=colors, vmin=0.0, vmax=top_px, alpha=0.8)
    axes.figure.colorbar(drawn, ax=axes, fraction=0.025, pad=0.01, label=label)


def picture(axes: Axes, title: str) -> None:
    """A panel without ticks."""
    axes.set_title(title, loc="left", fontsize=10)
    axes.set_xticks([])
    axes.set_yticks([])


def footprint(axes: Axes, ground: GroundProjection) -> None:
    """Its outline."""
    axes.contour(ground.mask, levels=[0.5], colors="white", linewidths=1.6)


def draw_maps(
    plate: np.ndarray, shot: ShotValues, defocused: DefocusedLayer, composite: np.ndarray
) -> None:
    """F, P, the object's CoC and L, from the plate to the composite."""
    coc, ground = shot.plate_coc, shot.ground
    if coc is None or ground is None:
        raise TypeError("nothing was estimated")
    object_coc = np.full(plate.shape[:2], np.nan)
    box = defocused.layer.box
    inside = np.where(defocused.layer.rgba[..., 3] > 0, np.abs(defocused.coc_px), np.nan)
    ys, xs = np.mgrid[box.y0 : box.y1, box.x0 : box.x1]
    seen = (ys >= 0) & (ys < plate.shape[0]) & (xs >= 0) & (xs < plate.shape[1])
    object_coc[ys[seen], xs[seen]] = inside[seen]
    top_px = float(np.quantile(coc.coc_px, 0.98))
    figure, grid = plt.subplots(3, 2, figsize=(11, 9), layout="constrained")
    grid[0, 0].imshow(plate)
    picture(grid[0, 0], "the plate: all that is known")
    colored(grid[0, 1], plate, coc.coc_px, COC_COLORS, top_px, "CoC diameter (px)")
    picture(grid[0, 1], "F: its circle of confusion, without sign")
    sigma_top_px = float(np.quantile(coc.sigma_px, 0.98))
    colored(grid[1, 0], plate, coc.sigma_px, SIGMA_COLORS, sigma_top_px, "expected error (px)")
    picture(grid[1, 0], "F: how far it expects to be off")
    disparity = np.where(ground.disparity > 0, ground.disparity, np.nan)
    colored(grid[1, 1], plate, disparity, "magma", np.nanmax(disparity), "disparity (1 / m)")
    footprint(grid[1, 1], ground)
    picture(grid[1, 1], "P: the virtual ground, and the object's footprint on it")
    colored(grid[2, 0], plate, object_coc, COC_COLORS, top_px, "CoC diameter (px)")
    picture(grid[2, 0], "the object's CoC, by the fitted line and its rendered depth")
    grid[2, 1].imshow(composite)
    picture(grid[2, 1], "L: the object through that lens, over the plate")
    figure.savefig(OUT / "stages.jpg", dpi=110, pil_kwargs={"quality": 88})
    plt.close(figure)


def draw_fit(regression: Regression) -> None:
    """R: samples without sign and the V; the line that it stands for, beside the true lens."""
    samples, fit = regression.samples, regression.fit
    truth = json.loads((ROOT / "samples" / f"{SHOT}.json").read_text())
    order = np.random.default_rng(0).permutation(len(samples.disparity))[:DRAWN_SAMPLES]
    sign = np.where(samples.disparity >= fit.focus_disparity, 1.0, -1.0)
    span = np.linspace(0.0, float(samples.disparity.max()) * 1.03, 200)
    figure, (left, right) = plt.subplots(1, 2, figsize=(11, 4.2), layout="constrained")
    for axes, coc, law, label in (
        (left, samples.coc_px, np.abs, "CoC diameter (px), as F sees it"),
        (right, samples.coc_px * sign, np.asarray, "signed CoC diameter (px)"),
    ):
        for anchor, name, color in ((False, "ground", "0.6"), (True, "footprint", "tab:orange")):
            chosen = order[samples.anchor[order] == anchor]
            size = 14 if anchor else 5
            strength = 0.1 + 0.6 * samples.weight[chosen]
            axes.scatter(
                samples.disparity[chosen], coc[chosen], size, color, alpha=strength, linewidths=0
            )
            axes.scatter([], [], s=20, c=color, label=f"{name}, fainter: taken for an outlier")
        axes.plot(
            span, law(truth["slope"] * span + truth["intercept"]), "k--", lw=1, label="true lens"
        )
        axes.plot(span, law(fit.slope * span + fit.intercept), "tab:blue", lw=2, label="fit")
        axes.set(xlabel="disparity (1 / m)", ylabel=label)
        axes.grid(alpha=0.3)
    top = HEADROOM * float(np.abs(fit.slope * span + fit.intercept).max())
    left.set_ylim(0.0, top)
    right.set_ylim(-top, 0.6 * top)
    right.legend(fontsize=8)
    figure.savefig(OUT / "fit.png", dpi=110)
    plt.close(figure)


def main() -> None:
    """Draw both."""
    plate, shot, defocused, composite = first_frame()
    if shot.found_lens is None or shot.found_lens.regression is None:
        raise TypeError("nothing was fitted")
    OUT.mkdir(exist_ok=True)
    draw_maps(plate, shot, defocused, composite)
    draw_fit(shot.found_lens.regression)
    fit = shot.found_lens.fit
    print(
        f"slope {fit.slope:.1f} ± {fit.slope_stderr:.1f}, intercept {fit.intercept:.1f} ± "
        f"{fit.intercept_stderr:.1f}, sign {fit.sign}, margin {fit.sign_margin:.2f}"
    )


if __name__ == "__main__":
    main()
