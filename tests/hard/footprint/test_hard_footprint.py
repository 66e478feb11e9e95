"""Footprints of a few pixels, of constant CoC, of invalid confidence, and cut by the frame."""

import numpy as np
from hard.catalogue import Outcome, at_most, case, exactly
from hard.drawing import OTHER, OURS, heat, panels, plot
from support.planes import of_map

from nlens_video.core.errors import LensFitError
from nlens_video.core.layers import CocMap
from nlens_video.graph.nodes.object_and_lens import constant_fit
from nlens_video.scene import Camera
from nlens_video.stages.p_projection import GroundProjection, project_to_ground
from nlens_video.stages.r_regression import FitLens

ROWS, COLUMNS = 128, 240
SLOPE, FOCUS = 30.0, 0.9
THERE = 0.55  # disparity in the middle of the footprint


def _ground(mask: np.ndarray) -> GroundProjection:
    rows = (np.arange(ROWS) - 20) / (ROWS - 20)
    disparity = np.repeat(rows[:, None], COLUMNS, axis=1)
    return GroundProjection(mask=mask, disparity_of=of_map(disparity), ground_y=0.0)


def _mask(pixels: int) -> np.ndarray:
    """A footprint of so many pixels, around row 79."""
    mask = np.zeros((ROWS, COLUMNS), bool)
    for at in range(pixels):
        mask[79 + at // 20, 110 + at % 20] = True
    return mask


def _read(seed: int = 0, sigma: float = 0.5) -> CocMap:
    """What a network may read off the plate: the true CoC with noise."""
    disparity = _ground(_mask(0)).disparity
    noise = np.random.default_rng(seed).normal(0, sigma, disparity.shape)
    coc = np.abs(SLOPE * (disparity - FOCUS) + noise).astype(np.float32)
    return CocMap(coc_px=coc, sigma_px=np.full_like(coc, sigma))


def _off(fit) -> float:
    return abs(float(fit.coc_px(np.float32(THERE))) - SLOPE * (THERE - FOCUS))


def _ends(coc: CocMap, plane: GroundProjection, *, whole: bool) -> tuple[str, float]:
    """How a fit ends: `fit` or the error's name, and how far off the CoC is [px]."""
    try:
        fit = FitLens(whole_plane=whole)(coc, plane).fit
    except LensFitError as error:
        assert len(str(error).splitlines()) == 1 and "--fit" in str(error)
        return "LensFitError", 0.0
    return "fit", _off(fit)


def _by_size(sizes) -> Outcome:
    figures, offs = [], {True: [], False: []}
    for size in sizes:
        plane = _ground(_mask(size))
        for whole in (True, False):
            ended, off = _ends(_read(), plane, whole=whole)
            offs[whole].append(off if ended == "fit" else np.nan)
            where = "the whole plane" if whole else "the footprint alone"
            wanted = "fit" if whole or size >= 48 else "LensFitError"
            figures.append(exactly(f"{size} pixels, on {where}", ended, wanted))
            if wanted == "fit":
                figures.append(at_most(f"CoC there, off by [px], {size} pixels, {where}", off, 0.3))

    def draw(axes):
        axes.plot(sizes, offs[True], "o-", color=OURS, label="whole plane, footprint as anchor")
        axes.plot(sizes, offs[False], "s", color=OTHER, label="footprint alone, where it fits")
        axes.set_xscale("symlog")

    return Outcome(
        tuple(figures), lambda: plot(draw, x="pixels of the footprint", y="CoC off by [px]")
    )


@case
def test_footprint_of_0_to_10_pixels():
    """With 0, 1, 2 or 10 pixels the plane finds the lens; a fit on the footprint alone refuses."""
    return _by_size((0, 1, 2, 10))


@case
def test_footprint_of_48_pixels_and_more():
    """From 48 pixels on the footprint alone is enough, as the paper has it."""
    return _by_size((48, 100, 400))


@case
def test_footprint_of_constant_coc():
    """A footprint read as 12 px everywhere, where 10.5 is true, does not bias the plane's fit."""
    mask = np.zeros((ROWS, COLUMNS), bool)
    mask[70:90, 90:150] = True
    coc = _read()
    coc.coc_px[mask] = 12.0
    ended, off = _ends(coc, _ground(mask), whole=True)
    return Outcome(
        (exactly("ends with", ended, "fit"), at_most("CoC there, off by [px]", off, 0.6)),
        lambda: panels({"CoC as it is read": heat(coc.coc_px, 27.0),
                        "footprint": heat(mask.astype(float), 1.0)}),
    )  # fmt: skip


@case
def test_footprint_with_nan_confidence():
    """NaN confidence excludes the footprint; NaN everywhere is an error of one line."""
    mask = np.zeros((ROWS, COLUMNS), bool)
    mask[70:90, 90:150] = True
    plane, coc = _ground(mask), _read()
    coc.sigma_px[mask] = np.nan
    ended, off = _ends(coc, plane, whole=True)
    alone, _ = _ends(coc, plane, whole=False)
    none = CocMap(coc_px=coc.coc_px, sigma_px=np.full_like(coc.coc_px, np.nan))
    nowhere, _ = _ends(none, plane, whole=True)
    try:
        constant = f"{constant_fit(none, plane).intercept:g}"
    except LensFitError:
        constant = "LensFitError"
    return Outcome(
        (
            exactly("NaN in the footprint, whole plane", ended, "fit"),
            at_most("CoC there, off by [px]", off, 0.3),
            exactly("NaN in the footprint, footprint alone", alone, "LensFitError"),
            exactly("NaN all over", nowhere, "LensFitError"),
            exactly("NaN all over, constant fallback", constant, "LensFitError"),
        ),
        lambda: panels({"confidence, white where NaN": heat(coc.sigma_px, 0.5)}),
    )


@case
def test_footprint_with_extreme_confidence():
    """A sigma of 0, of the smallest float and of infinity does not break the fit."""
    mask = np.zeros((ROWS, COLUMNS), bool)
    mask[70:90, 90:150] = True
    figures, offs = [], {}
    for name, sigma in (("0", 0.0), ("1e-45", 1e-45), ("1e30", 1e30), ("inf", np.inf)):
        coc = _read()
        coc.sigma_px[::3] = sigma
        ended, offs[name] = _ends(coc, _ground(mask), whole=True)
        figures.append(exactly(f"a third of all sigma {name}", ended, "fit"))
        figures.append(at_most(f"CoC, off by [px], sigma {name}", offs[name], 0.3))

    def draw(axes):
        axes.bar(list(offs), list(offs.values()), color=OURS)
        axes.axhline(0.3, color=OTHER, label="limit")

    return Outcome(tuple(figures), lambda: plot(draw, x="sigma of a third", y="off by [px]"))


@case
def test_footprint_cut_by_each_border():
    """A footprint cut by the left, right, upper or lower border is the rest of the whole one."""
    c, s = np.cos(0.5), np.sin(0.5)
    pose = np.eye(4)
    pose[:3, :3], pose[1, 3] = [[1, 0, 0], [0, c, s], [0, -s, c]], 2.0
    large = Camera.from_yfov(pose, 1.0, 240, 180)
    square = np.array([[-0.5, 0.3, -3.5], [0.5, 0.3, -3.5], [0.5, 0.3, -2.5], [-0.5, 0.3, -2.5]])
    triangles = square[[[0, 1, 2], [0, 2, 3]]]
    whole = project_to_ground(triangles, large, 0.0)
    rows, columns = np.flatnonzero(whole.mask.any(1)), np.flatnonzero(whole.mask.any(0))
    middle = (int(rows.mean()), int(columns.mean()))
    cuts = {
        "left": (0, middle[1], 180, 240),
        "right": (0, 0, 180, middle[1]),
        "upper": (middle[0], 0, 180, 240),
        "lower": (0, 0, middle[0], 240),
    }
    figures, shown = [], {"whole": heat(whole.mask.astype(float), 1.0)}
    for name, (top, left, bottom, right) in cuts.items():
        part = Camera(
            world_from_camera=pose, fx=large.fx, fy=large.fy, cx=large.cx - left,
            cy=large.cy - top, width=right - left, height=bottom - top,
        )  # fmt: skip
        seen = project_to_ground(triangles, part, 0.0)
        kept = whole.mask[top:bottom, left:right]
        shown[f"cut by the {name} border"] = heat(seen.mask.astype(float), 1.0)
        figures += [
            at_most(f"pixels of its outline that differ, {name}", (seen.mask ^ kept).sum(), 4),
            at_most(
                f"disparity, off by a share of, {name}",
                np.abs(seen.disparity / whole.disparity[top:bottom, left:right] - 1).max(),
                1e-12,
            ),
        ]
    return Outcome(tuple(figures), lambda: panels(shown, height=130))


@case
def test_footprint_of_a_tenth_of_a_pixel():
    """An object so small that its footprint covers a tenth of a pixel marks that pixel."""
    view = Camera.from_yfov(np.eye(4), 0.7, 240, 128)
    size = 0.1 * 3.0 / view.fy
    corner = np.array([0.013, -1.0, -3.0])
    triangle = corner + size * np.array([[0.0, 0, 0], [1, 0, 0], [0, 0, -9]])
    seen = project_to_ground(triangle[None], view, -1.0)
    row, column = np.argwhere(seen.mask)[0] if seen.mask.any() else (-1, -1)
    place = view.pixels(corner[None])[0]
    return Outcome(
        (
            at_most("pixels marked", seen.mask.sum(), 2),
            exactly("the row of the place itself", int(row), int(place[1])),
            exactly("the column", int(column), int(place[0])),
        ),
        lambda: panels({"footprint": heat(seen.mask.astype(float), 1.0)}),
    )
