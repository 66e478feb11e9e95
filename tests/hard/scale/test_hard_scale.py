"""Scene units from micrometres to megametres give the same picture."""

import numpy as np
import pytest
from hard.catalogue import Outcome, at_most, case, exactly
from hard.drawing import OTHER, OURS, heat, panels, plot
from hard.objects import LENS, PRESETS, SIZE, composited, cube, folder
from support import shots
from support.glb_builder import GlbBuilder

from nlens_video.core.lens_fit import LensFit
from nlens_video.render.base.drawer import closed_bodies
from nlens_video.scene import Scene

TWOS = (2.0**-20, 2.0**-10, 2.0**10, 2.0**20)  # what a float is multiplied by without rounding
TENS = (1e-6, 1e-3, 0.37, 1e3, 1e6)


def _scaled(unit: float, fit: LensFit | None = LENS) -> LensFit | None:
    if fit is None:
        return None
    return LensFit(slope=fit.slope * unit, intercept=fit.intercept, width=SIZE[0], height=SIZE[1])


def _pictures(preset: str, units, *, fit: LensFit | None = LENS, lamp: str = "sun"):
    """The composite in units of 1, and in each of the others."""
    with folder() as place:
        return [
            composited(cube(place / f"{u}.glb", unit=u, lamp=lamp), preset, _scaled(u, fit))
            for u in (1.0, *units)
        ]


def _differing(pictures) -> tuple[int, int]:
    """Samples that differ from the first picture, the most of all; by how many codes at most."""
    away = [np.abs(p.astype(int) - pictures[0]) for p in pictures[1:]]
    return max(int((a > 0).any(axis=2).sum()) for a in away), max(int(a.max()) for a in away)


@case
def test_scene_scaled_by_powers_of_two():
    """A GLB 2^-20 to 2^20 times as large, camera included, makes the same bits in every preset."""
    made = {preset: [p for p, _ in _pictures(preset, TWOS)] for preset in PRESETS}
    return Outcome(
        tuple(exactly(f"pixels that differ, {p}", _differing(made[p])[0], 0) for p in PRESETS),
        lambda: panels({f"x 2^{e}": made["standard"][i][..., ::-1]
                        for i, e in enumerate((0, -20, -10, 10, 20))}, height=120),
    )  # fmt: skip


@case
def test_scene_scaled_by_powers_of_ten():
    """In units of 1e-6 to 1e6 the file's own floats are rounded: a pixel or two are off a code."""
    made = {preset: [p for p, _ in _pictures(preset, TENS)] for preset in PRESETS}
    figures = []
    for preset in PRESETS:
        pixels, codes = _differing(made[preset])
        figures += [
            at_most(f"pixels of 129 600 that differ, {preset}", pixels, 3),
            at_most(f"by how many codes, {preset}", codes, 1),
        ]
    worst = made["draft"]
    return Outcome(
        tuple(figures),
        lambda: panels({f"x {u:g}": p[..., ::-1] for u, p in zip((1.0, *TENS), worst, strict=True)},
                       height=100),
    )  # fmt: skip


@pytest.mark.needs_gl
@case
def test_scene_scaled_by_powers_of_two_in_opengl():
    """Drawn by OpenGL, a GLB 2^-20 or 2^20 times as large makes the same picture to a code."""
    with pytest.MonkeyPatch.context() as changed:
        changed.setenv("NLENS_RENDERER", "opengl")
        made = [picture for picture, _ in _pictures("standard", (2.0**-20, 2.0**20))]
    pixels, codes = _differing(made)
    return Outcome(
        (
            at_most("pixels of 129 600 that differ", pixels, 3),
            at_most("by how many codes", codes, 1),
        ),
        lambda: panels({n: p[..., ::-1] for n, p in zip(("x 1", "x 2^-20", "x 2^20"), made,
                                                        strict=True)}),
    )  # fmt: skip


@case
def test_fit_in_any_scene_unit():
    """The lens found on the plate is the same in any unit; its slope has the unit of the scene."""
    units = (1e-6, 1e-3, 1e3, 1e6)
    found = [fit for _, fit in _pictures("realtime", units, fit=None)]
    slopes = np.array([f.slope / u for f, u in zip(found, (1.0, *units), strict=True)])
    ends = np.array([f.intercept for f in found])

    def draw(axes):
        axes.plot((1.0, *units), slopes, "o", color=OURS, label="slope / unit [px]")
        axes.plot((1.0, *units), ends, "o", color=OTHER, label="intercept [px]")

    return Outcome(
        (
            at_most("slope by unit, off by a share of", np.ptp(slopes) / slopes[0], 1e-9),
            at_most("intercept, off by [px]", float(np.ptp(ends)), 1e-9),
            exactly("signs", " and ".join(sorted({f.sign for f in found})), "resolved"),
        ),
        lambda: plot(draw, x="scene unit", y="", log=("x",)),
    )


@case
def test_point_light_in_any_scene_unit():
    """Light that falls off with the square of the distance does so in any unit."""
    made = [p for p, _ in _pictures("standard", (2.0**-20, 2.0**20), lamp="point")]
    pixels, _ = _differing(made)
    return Outcome(
        (exactly("pixels that differ", pixels, 0),),
        lambda: panels({n: p[..., ::-1] for n, p in zip(("x 1", "x 2^-20", "x 2^20"), made,
                                                        strict=True)}),
    )  # fmt: skip


def _bodies(unit: float) -> list[bool]:
    """Whether a closed cube, a fine one, and a cube without a lid are found closed."""
    found = []
    for corners, faces in (
        (shots.CUBE, shots.CUBE_FACES),
        (1e-3 * shots.CUBE, shots.CUBE_FACES),
        (shots.CUBE, shots.CUBE_FACES[:-2]),
    ):
        soup = (corners[faces].reshape(-1, 3) * np.float32(unit)).astype(np.float32)
        builder = GlbBuilder()
        builder.node(mesh=builder.mesh(soup, np.arange(len(soup)).reshape(-1, 3)))
        with folder() as place:
            scene = Scene.load(builder.write(place / "body.glb"))
        found += closed_bodies(scene.pose(0.0).meshes)
    return found


@case
def test_closed_mesh_of_any_size():
    """Whether a mesh is closed, so that its back faces are hidden, does not depend on its size."""
    units = (1e-9, 1e-6, 1e-3, 1.0, 1e3, 1e6, 1e9, 1e12)
    found = np.array([_bodies(unit) for unit in units])
    wrong = int((found != [True, True, False]).sum())
    return Outcome(
        (exactly(f"wrong answers of {found.size}", wrong, 0),),
        lambda: panels({"closed (blue) by unit (down) and mesh (across)": heat(
            -found.astype(float), 1.0)}, height=120),
    )  # fmt: skip
