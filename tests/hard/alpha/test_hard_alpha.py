"""Coverage of next to nothing, and light without any coverage."""

import numpy as np
from hard.catalogue import Outcome, at_least, at_most, case, exactly
from hard.drawing import over_grey, panels, srgb8

from nlens_video.core.layers import Box, DefocusedLayer, ObjectLayer
from nlens_video.core.lens_fit import LensFit
from nlens_video.graph.base.object_source import covered_part
from nlens_video.kernels.scatter.scatter import (
    DRAFT,
    FINE,
    blur_reach,
    scatter,
)
from nlens_video.kernels.scatter.scatter_ref import scatter_ref
from nlens_video.stages.l_reblur import ReblurLayer, object_coc
from nlens_video.video.pixels.picture import ArrayPicture

SIDE = 64
FRAME = Box(0, 0, SIDE, SIDE)
DETAILS = {"draft": DRAFT, "realtime": FINE}


def _block(alpha: float, colour=(0.8, 0.4, 0.2)) -> np.ndarray:
    """A block of one coverage, premultiplied."""
    rgba = np.zeros((SIDE, SIDE, 4), np.float32)
    rgba[22:42, 22:42] = (*(alpha * c for c in colour), alpha)
    return rgba


def _coc(value: float) -> np.ndarray:
    return np.full((SIDE, SIDE), value, np.float32)


@case
def test_alpha_of_one_code_value():
    """A layer of alpha 1/255 blurs as an opaque one does, times 1/255."""
    figures, shown = [], {}
    for coc in (3.0, 9.0, 30.0):
        for name, detail in DETAILS.items():
            faint = scatter(_block(1 / 255), _coc(coc), detail=detail)
            opaque = scatter(_block(1.0), _coc(coc), detail=detail)
            off = np.abs(255.0 * faint.astype(np.float64) - opaque).max()
            figures.append(at_most(f"off by a share of, CoC {coc:g} px, {name}", off, 2e-5))
        shown[f"CoC {coc:g} px, x 255"] = over_grey(255 * faint)
    return Outcome(tuple(figures), lambda: panels(shown))


@case
def test_subnormal_alpha_and_light():
    """Coverage and light too small for a normal float end close to zero, never as NaN."""
    figures = []
    for alpha in (1e-45, 1e-39, 1e-30, 1e-8):
        for coc in (0.0, 0.7, 9.0, 100.0):
            seen = np.stack([scatter(_block(alpha), _coc(coc), detail=d) for d in DETAILS.values()])
            if not np.isfinite(seen).all() or seen.min() < 0 or seen.max() > 1.01 * alpha:
                figures.append(exactly(f"alpha {alpha:g}, CoC {coc:g}", "wrong", "right"))
    mixed = _block(1.0)
    mixed[:, 32:] *= np.float32(1e-42)
    seen = scatter(mixed, _coc(9.0))
    plate = np.random.default_rng(0).integers(0, 256, (SIDE, SIDE, 3), dtype=np.uint8)
    under = plate.copy()
    ArrayPicture(under).composite_over(FRAME, _block(1e-40))
    return Outcome(
        (
            exactly("wrong combinations of 4 alphas and 4 CoC", len(figures), 0),
            exactly("codes of a plate under alpha 1e-40 that change", (under != plate).sum(), 0),
            at_most("greatest alpha beside a subnormal half", seen[..., 3].max(), 1.0),
        ),
        lambda: panels({"right half of 1e-42, CoC 9 px": over_grey(seen)}),
    )


@case
def test_empty_layer():
    """An empty premultiplied layer stays empty, whatever its depth, and its CoC is not read."""
    rgba = np.zeros((SIDE, SIDE, 4), np.float32)
    coc = _coc(np.nan)
    coc[::2] = np.inf
    seen = [scatter(rgba, coc, detail=detail) for detail in DETAILS.values()]
    layer = ObjectLayer(box=FRAME, rgba=rgba, depth=_coc(2.0))
    return Outcome(
        (
            exactly("values that are not 0", sum(int(np.count_nonzero(v)) for v in seen), 0),
            exactly("what is left of such a layer", str(covered_part(layer)), "None"),
        ),
        lambda: panels({"nothing": over_grey(seen[0])}),
    )


def _glow(radius_px: float = 5.0) -> ObjectLayer:
    """A flame: light of up to 4, no coverage, beside an opaque block at the same depth."""
    rgba = np.zeros((SIDE, SIDE, 4), np.float32)
    rows, columns = np.mgrid[:SIDE, :SIDE]
    near = np.exp(-((rows - 22) ** 2 + (columns - 40) ** 2) / (2 * radius_px**2))
    near[near < 0.01] = 0.0
    rgba[..., :3] = 4.0 * near[..., None] * np.array([1.0, 0.5, 0.1])
    rgba[34:50, 12:34] = (0.3, 0.3, 0.4, 1.0)
    there = rgba.any(axis=2)
    return ObjectLayer(
        box=FRAME, rgba=rgba, depth=np.where(there, np.float32(2.0), np.float32(np.inf))
    )


def _blurred(layer: ObjectLayer, coc_px: float, detail) -> np.ndarray:
    fit = LensFit(slope=2.0 * coc_px, intercept=0.0, width=SIDE, height=SIDE)
    stage = ReblurLayer(
        scatter=lambda *a, **k: scatter(*a, detail=detail, **k),
        reach=lambda *a: blur_reach(*a, detail=detail),
    )
    cut = covered_part(layer)
    defocused: DefocusedLayer = object_coc(cut, fit)
    seen = stage(defocused, FRAME)
    whole = np.zeros((SIDE, SIDE, 4), np.float32)
    whole[seen.box.slices_in(FRAME)] = seen.rgba
    return whole


@case
def test_light_without_alpha():
    """A flame of a rendered layer, light with no coverage, blurs and keeps its light at any CoC."""
    layer = _glow()
    flame = layer.rgba[..., :3].sum((0, 1), dtype=np.float64)
    figures, shown = [], {"sharp": over_grey(layer.rgba)}
    for coc in (0.2, 0.8, 4.0, 10.0):
        for name, detail in DETAILS.items():
            seen = _blurred(layer, coc, detail)
            lost = np.abs(seen[..., :3].sum((0, 1), dtype=np.float64) / flame - 1).max()
            figures.append(at_most(f"light lost or won, CoC {coc:g} px, {name}", lost, 2e-3))
        shown[f"CoC {coc:g} px"] = over_grey(seen)
    alone = np.where(layer.rgba[..., 3:] > 0, np.float32(0), layer.rgba)
    lamp = ObjectLayer(box=FRAME, rgba=alone, depth=layer.depth)
    seen = _blurred(lamp, 6.0, FINE)
    kept = seen[..., :3].sum(dtype=np.float64) / alone.sum(dtype=np.float64)
    plate = np.full((SIDE, SIDE, 3), 90, np.uint8)
    over = plate.copy()
    ArrayPicture(over).composite_over(FRAME, seen)
    figures += [
        at_most("light lost or won by a flame alone", abs(kept - 1), 2e-3),
        at_least("least change of a code under it", (over.astype(int) - plate).min(), 0),
        at_most("coverage that it gets", seen[..., 3].max(), 1e-5),
    ]
    return Outcome(tuple(figures), lambda: panels(shown))


@case
def test_faint_layers_agree_with_the_reference():
    """The fast scatter equals its definition for layers of any opacity."""
    rng = np.random.default_rng(3)
    figures = []
    for alpha in (1e-6, 1e-4, 1 / 255, 1.0):
        rgba = _block(alpha)
        rgba *= rng.uniform(0.2, 1.0, (SIDE, SIDE, 1)).astype(np.float32)
        coc = rng.uniform(-6, 6, (SIDE, SIDE)).astype(np.float32)
        away = np.abs(scatter(rgba, coc) - scatter_ref(rgba, coc)).max() / alpha
        figures.append(at_most(f"difference by alpha, alpha {alpha:.2g}", away, 0.03))
    faint = scatter(_block(1e-4), _coc(7.0))[..., :3]
    return Outcome(tuple(figures), lambda: panels({"alpha 1e-4, x 1e4": srgb8(1e4 * faint)}))
