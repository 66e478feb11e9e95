"""Circles of confusion that are nothing, almost nothing, both signs at once, and enormous."""

import numpy as np
from hard.catalogue import Outcome, at_least, at_most, case, exactly
from hard.drawing import INK, OTHER, OURS, PALE, haze, over_grey, panels, plot
from hard.quality_levels import (
    QUALITIES,
    Card,
    cards,
    drawn,
    lens_at,
    lens_of_coc,
    sharp,
    spread_px,
    through,
)
from support.lens_truth import Slab, lens, pinhole, psnr_over_plate

from nlens_video.core.errors import LensFitError
from nlens_video.core.lens_fit import LensFit
from nlens_video.kernels.scatter.scatter import scatter

COLOURS = dict(zip(QUALITIES, (PALE, OURS, OTHER, INK), strict=True))


@case
def test_coc_of_zero():
    """An object on the focal plane stays as it is drawn, at every quality level: bit for bit, by
    `lens`, which takes the mean of shifted pictures, to a millionth.
    """
    scene = cards(Card(2.0))
    plain = {quality: drawn(quality, scene) for quality in QUALITIES}
    seen = {quality: through(quality, scene, lens_of_coc(0.0, 2.0)) for quality in QUALITIES}
    least = {**dict.fromkeys(QUALITIES, 0.0), "lens": 1e-6}
    changed = {k: np.count_nonzero(np.abs(seen[k] - plain[k]) > least[k]) for k in QUALITIES}
    return Outcome(
        tuple(
            exactly(f"values that {quality} changes", changed[quality], 0) for quality in QUALITIES
        ),
        lambda: panels(
            {"sharp": over_grey(plain["realtime"]), **{k: over_grey(v) for k, v in seen.items()}}
        ),
    )


@case
def test_coc_near_zero_of_either_sign():
    """A CoC close to zero, from the smallest float up, changes nothing, whatever its sign."""
    rgba = sharp(cards(Card(2.0)))
    sizes = [1.4e-45, 1e-38, 1e-12, 1e-6, 1e-3, 1e-2]
    changes = {
        sign: [float(np.abs(scatter(rgba, _plane(rgba, sign * s)) - rgba).max()) for s in sizes]
        for sign in (1.0, -1.0)
    }
    apart = max(abs(a - b) for a, b in zip(*changes.values(), strict=True))

    def draw(axes):
        for (sign, values), mark in zip(changes.items(), ("o-", "x--"), strict=True):
            axes.plot(sizes, np.maximum(values, 1e-9), mark, label=f"CoC {'+-'[sign < 0]} eps")

    return Outcome(
        (
            at_most("change by a CoC up to 1e-6 px", max(changes[1.0][:4]), 1e-6),
            at_most("change by a CoC of 0.01 px", changes[1.0][-1], 4e-3),
            exactly("difference between the two signs", apart, 0.0),
        ),
        lambda: plot(draw, x="|CoC| [px]", y="largest change", log=("x", "y")),
    )


@case
def test_onset_of_blur():
    """From 0 to 1.5 px the picture changes without a jump, at every level.

    `standard` mixes in five views of four samples a pixel: an edge that passes a sample of one
    changes a pixel by a twentieth, a corner by two. At 0.5 px, where blur and views begin, only
    the onset of the blur is visible.
    """
    scene = cards(Card(2.0))
    steps, onset = np.arange(0.0, 1.52, 0.05), np.arange(0.49, 0.55, 0.004)

    def pulled(quality, sizes):
        return np.stack([through(quality, scene, lens_of_coc(c, 2.0)) for c in sizes])

    def jump(seen):
        return float(np.abs(np.diff(seen, axis=0)).max())

    curves = {quality: pulled(quality, steps) for quality in QUALITIES}
    jumps = {quality: jump(seen) for quality, seen in curves.items()}
    begins = {quality: jump(pulled(quality, onset)) for quality in QUALITIES}

    def draw(axes):
        for quality, seen in curves.items():
            away = np.abs(seen - seen[0]).max(axis=(1, 2, 3))
            axes.plot(steps, away, color=COLOURS[quality], label=quality)

    return Outcome(
        (
            *(
                at_most(
                    f"largest step of {r} by 0.05 px", jumps[r], 0.1 if r == "standard" else 0.035
                )
                for r in QUALITIES
            ),
            *(at_most(f"by 0.004 px about 0.5 px, {r}", begins[r], 0.03) for r in QUALITIES),
        ),
        lambda: plot(draw, x="CoC [px]", y="largest change to sharp"),
    )


@case
def test_coc_changing_sign_within_a_triangle():
    """A slab whose CoC runs from -12 through 0 to +20 px stays opaque and close to the lens."""
    slab = Slab(corners=(16, 16.3, 116.4, 86), coc_px=-12.4, slope=(0.05, 0.35))
    layer, coc = pinhole([slab], (102, 132))
    truth, seen = lens([slab], (102, 132), views=300), scatter(layer, coc)
    inside = seen[28:72, 30:96, 3]
    signs = {"negative": (coc < 0).any(), "positive": (coc > 0).any()}
    return Outcome(
        (
            at_least("least alpha well inside", inside.min(), 1.0 - 1e-6),
            at_least("PSNR to 300 points of the lens [dB]", psnr_over_plate(seen, truth), 46.0),
            exactly("signs of the CoC in it", " and ".join(k for k, v in signs.items() if v),
                    "negative and positive"),
        ),
        lambda: panels(
            {"sharp": over_grey(layer), "blurred": over_grey(seen), "the lens": over_grey(truth)}
        ),
    )  # fmt: skip


@case
def test_coc_larger_than_the_object():
    """A card of 6 px under a CoC of 40 px keeps all its light, thin and wide, at every level."""
    scene = cards(Card(2.0, half=(3.0, 3.0)))
    before = {k: drawn(k, scene).sum((0, 1), dtype=np.float64) for k in QUALITIES}
    seen = {quality: through(quality, scene, lens_of_coc(40.0, 2.0)) for quality in QUALITIES}
    after = {k: v.sum((0, 1), dtype=np.float64) for k, v in seen.items()}
    lost = {k: np.abs(after[k] / before[k] - 1).max() for k in QUALITIES}
    disc = np.pi * 20.0**2
    return Outcome(
        (
            *(at_most(f"light that {k} loses or gains, share", lost[k], 1e-3) for k in QUALITIES),
            *(
                at_most(
                    f"alpha in the middle by {k}, off from area / area of the disc",
                    abs(v[44, 56, 3] * disc / before[k][3] - 1),
                    0.1 if k == "draft" else 0.02,
                )
                for k, v in seen.items()
            ),
        ),
        lambda: panels({f"{k}, coverage": haze(v) for k, v in seen.items()}),
    )


@case
def test_coc_larger_than_the_frame():
    """A CoC of three frames and more leaves a thin haze, finite and even."""
    scene = cards(Card(2.0))
    seen = {
        (quality, coc): through(quality, scene, lens_of_coc(coc, 2.0))
        for quality in QUALITIES
        for coc in (300.0, -300.0, 1e6)
    }
    figures = []
    for quality in QUALITIES:
        those = np.stack([v for (name, _), v in seen.items() if name == quality])
        finite = bool(np.isfinite(those).all())
        figures += [
            exactly(f"{quality} is finite", str(finite), "True"),
            at_most(f"greatest alpha of {quality}", those[..., 3].max(), 0.03),
            at_least(f"least value of {quality}", those.min(), 0.0),
        ]
    return Outcome(
        tuple(figures),
        lambda: panels({f"{r}, {c:g} px, coverage": haze(seen[r, c]) for r, c in (
            ("draft", 300.0), ("realtime", 300.0), ("lens", 300.0), ("realtime", 1e6))}),
    )  # fmt: skip


@case
def test_coc_beyond_the_largest_disc():
    """A fit as steep as is accepted gives the largest disc there is, not an overflow."""
    rgba = sharp(cards(Card(2.0)))
    largest = scatter(rgba, _plane(rgba, 512.0))
    seen = {coc: scatter(rgba, _plane(rgba, coc)) for coc in (513.0, 1e9, 3.4e38, -3.4e38)}
    apart = max(float(np.abs(v - largest).max()) for v in seen.values())
    steep = LensFit(slope=1e18, intercept=-1e18, width=8, height=8)
    told = steep.coc_px(np.array([0.0, 1e-30, 0.5, 2.0, 1e38], np.float32))
    try:
        refused = str(LensFit(slope=1e30, intercept=-1e30, width=8, height=8))
    except LensFitError as error:
        refused = type(error).__name__
    return Outcome(
        (
            exactly("difference to a CoC of 512 px", apart, 0.0),
            at_most("CoC by a fit of 1e18, at most [px]", np.abs(told).max(), 1e9),
            exactly("a fit of 1e30 is", refused, "LensFitError"),
        ),
        lambda: panels({f"{c:g} px, coverage": haze(v) for c, v in seen.items()}),
    )


@case
def test_coc_growing_across_resolution_levels():
    """While the CoC grows to 90 px, over every level of coarser pixels, nothing pops."""
    scene = cards(Card(2.0, half=(16.0, 16.0)))
    steps = np.geomspace(0.5, 90.0, 90)
    widths = {
        quality: np.array([spread_px(through(quality, scene, lens_of_coc(c, 2.0))) for c in steps])
        for quality in ("draft", "realtime")
    }
    begin = spread_px(sharp(scene))
    disc = np.sqrt(begin**2 + steps**2 / 8)  # second moments add up; a disc's is r^2 / 2
    seen = steps < 50.0  # beyond it the frame cuts the disc
    off = {quality: np.abs(w / disc - 1.0)[seen].max() for quality, w in widths.items()}
    falls = {quality: float(np.diff(w).min()) for quality, w in widths.items()}

    def draw(axes):
        axes.plot(steps, disc, color=PALE, lw=4, label="an even disc, before the frame cuts it")
        for quality, width in widths.items():
            axes.plot(steps, width, color=COLOURS[quality], lw=1, label=quality)

    return Outcome(
        (
            *(at_most(f"width by {quality}, off from the disc's, share", off[quality], limit)
              for quality, limit in (("draft", 0.02), ("realtime", 0.005))),
            *(at_least(f"least growth of {quality} by a step [px]", falls[quality], 0.0)
              for quality in widths),
        ),
        lambda: plot(draw, x="CoC [px]", y="width of the picture [px]", log=("x",)),
    )  # fmt: skip


@case
def test_coc_step_from_negative_to_positive():
    """A near card in front of a far one, +9 and -9 px: the near one occludes the far one."""
    scene = cards(Card(1.5, half=(7.0, 20.0), seed=1), Card(4.0, half=(28.0, 16.0), seed=2))
    fit = lens_at(2.18, 21.0)
    seen = {quality: through(quality, scene, fit) for quality in QUALITIES}
    near, far = (float(fit.coc_px(np.float32(1 / depth))) for depth in (1.5, 4.0))
    figures = [at_least("CoC of the near card [px]", near, 9), at_most("of the far", far, -9)]
    for quality in QUALITIES:
        figures += [
            exactly(f"{quality} is finite", str(bool(np.isfinite(seen[quality]).all())), "True"),
            at_most(f"greatest alpha of {quality}", seen[quality][..., 3].max(), 1.0),
        ]
    off = np.abs(seen["standard"] - seen["lens"]).mean()
    figures.append(at_most("mean difference of standard and lens", off, 5e-3))
    return Outcome(tuple(figures), lambda: panels({k: over_grey(v) for k, v in seen.items()}))


def _plane(rgba, coc_px):
    return np.full(rgba.shape[:2], coc_px, np.float32)
