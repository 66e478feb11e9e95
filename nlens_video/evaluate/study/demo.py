"""Pictures of a study that the project makes itself: balls on a table, some of them virtual.

The paper's design, 3 positions x 3 apertures x 3 focus distances x 3 methods, on rendered plates
instead of photographs: it shows how a study runs and stands in for no photograph. Real balls are
drawn from many points of the lens together with the table; the virtual one comes by each method.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product
from pathlib import Path

import cv2
import numpy as np
from msgspec import Struct

from nlens_video.core.layers import Box, Float32, UInt8
from nlens_video.core.lens_fit import LensFit
from nlens_video.evaluate.bench.case import Case
from nlens_video.evaluate.bench.glb_writer import TexturedMesh, write_glb
from nlens_video.evaluate.bench.methods import one_frame, opened, preset_rungs, rival_rung
from nlens_video.evaluate.bench.shapes import ball, sheet, woven
from nlens_video.evaluate.coc.baselines import nearest_blur
from nlens_video.evaluate.composite.methods import DEFAULT, BlindAugmentation
from nlens_video.evaluate.report import track
from nlens_video.evaluate.study.page import Stimulus, write_stimuli
from nlens_video.graph.base.profiler import Profiler
from nlens_video.render.select import choose_renderer
from nlens_video.scene import Scene
from nlens_video.stages.l_aperture_samples import bare_points
from nlens_video.stages.l_lens_sampling import LensSetup, lens_views
from nlens_video.video.pixels.picture import ArrayPicture

SIZE, VIEWS = (640, 352), 256
CHOICES = "red,green,yellow,blue,orange,purple"
_YFOV = 0.8
_GROUND, _RADIUS, _WALL, _NEAR, _WIDE, _HIGH = -0.25, 0.07, 3.0, 0.35, 5.0, 3.0
_COLOURS = {
    "red": (190, 30, 30), "green": (25, 140, 60), "yellow": (225, 180, 30),
    "blue": (30, 60, 170), "orange": (230, 110, 25), "purple": (95, 40, 130),
}  # fmt: skip
_REAL = {"blue": (-0.25, 1.0), "orange": (0.55, 1.35), "purple": (0.05, 2.1)}  # x, depth
_VIRTUAL = {"red": (0.15, 0.75), "green": (-0.02, 1.15), "yellow": (-0.15, 1.8)}
_APERTURES = {"f/2": 24.0, "f/4": 12.0, "f/8": 6.0}  # CoC by disparity [px of 640]
_FOCUSES = {"front": 0.75, "middle": 1.15, "back": 1.8}  # depth


class _Plate(Struct, frozen=True, kw_only=True):
    """A plate, its lens, and Blind Augmentation's model of it."""

    aperture: str
    focus: str
    fit: LensFit
    codes: UInt8
    blind: BlindAugmentation


def write_demo(
    folder: Path, size: tuple[int, int] = SIZE, views: int = VIEWS, *, quiet: bool = False
) -> list[Stimulus]:
    """Make the 81 pictures and their list.

    Args:
        folder: gets them; it exists.
        size: columns and rows [px].
        views: points of the lens that a plate is the mean of [1].
        quiet: show no progress.

    Raises:
        NlensError: the renderer cannot run, or a plate does not tell its lens.
    """
    balls = {colour: folder / f"{colour}.glb" for colour in _VIRTUAL}
    for colour, path in balls.items():
        write_glb(path, [_ball(_VIRTUAL[colour], colour)], _YFOV)
    stimuli = []
    for plate in _plates(folder, size, views, quiet=quiet):
        for colour, glb in balls.items():
            for method, picture in _composites(plate, glb):
                parts = (plate.aperture.replace("/", ""), plate.focus, colour, method)
                name = f"{'_'.join(parts)}.jpg"
                _write(folder / name, picture)
                stimuli.append(
                    Stimulus(
                        file=name, position=colour, aperture=plate.aperture, focus=plate.focus,
                        method=method, virtual=colour,
                    )
                )  # fmt: skip
    write_stimuli(folder, stimuli)
    return stimuli


def _plates(folder: Path, size: tuple[int, int], views: int, *, quiet: bool) -> Iterator[_Plate]:
    path = folder / "table.glb"
    write_glb(path, [*_room(), *(_ball(at, colour) for colour, at in _REAL.items())], _YFOV)
    scene, frame = Scene.load(path), Box(0, 0, *size)
    camera = scene.camera(0.0, *size)
    with choose_renderer(scene) as renderer:
        seen = renderer.render(0.0, camera)
        if seen is None or seen.box != frame:
            raise RuntimeError("the room does not fill the frame")
        sharp = _coded(seen.rgba)
        lenses = list(product(_APERTURES.items(), _FOCUSES.items()))
        for (aperture, strength), (focus, at) in track(lenses, "rendering plates", quiet=quiet):
            slope = strength * size[0] / SIZE[0]
            fit = LensFit(
                slope=slope, intercept=-slope / at, width=frame.width, height=frame.height
            )
            shot = LensSetup(time_s=0.0, camera=camera, fit=fit, frame=frame)
            lens = lens_views(renderer, shot, bare_points(views))
            codes = _coded(lens.rgba)
            blur = nearest_blur(*(np.float32(1 / 255) * one for one in (codes, sharp)))
            blind = BlindAugmentation(blur, fit.coc_px(1.0 / seen.depth), fit)
            yield _Plate(aperture=aperture, focus=focus, fit=fit, codes=codes, blind=blind)


def _composites(plate: _Plate, glb: Path) -> Iterator[tuple[str, UInt8]]:
    """The virtual ball on a plate by each method."""
    height, width = plate.codes.shape[:2]
    case = Case(
        name=glb.stem, glb=glb, fit=plate.fit, plate=plate.codes, truth=plate.codes,
        region=Box(0, 0, width, height),
    )  # fmt: skip
    ours = next(rung for rung in preset_rungs() if rung.name == DEFAULT)
    for method, rung, fit, defocus in (
        ("naive", rival_rung("naive"), plate.fit, None),
        ("blind augmentation", rival_rung("layered Gaussian"), plate.fit, plate.blind),
        ("ours", ours, None, None),
    ):
        with opened(rung, case, Profiler(), fit, defocus) as steps:
            yield method, one_frame(steps, case, 0)[0]


def _ball(at: tuple[float, float], colour: str) -> TexturedMesh:
    """A striped ball on the table at some x and depth [scene unit]."""
    pixels = np.full((64, 8, 3), _COLOURS[colour], np.uint8)
    pixels[28:36] = 235
    return ball(np.array([at[0], _GROUND + _RADIUS, -at[1]]), _RADIUS, pixels)


def _room() -> list[TexturedMesh]:
    """The table's cloth and the wall behind it."""
    edge = [(-_WIDE, _GROUND, -_WALL), (_WIDE, _GROUND, -_WALL)]
    table = np.array([(-_WIDE, _GROUND, -_NEAR), (_WIDE, _GROUND, -_NEAR), *edge[::-1]])
    wall = np.array([*edge, (_WIDE, _HIGH, -_WALL), (-_WIDE, _HIGH, -_WALL)])
    return [
        sheet(table, woven((40, 105, 75), 1), 0.5, (0, 2)),
        sheet(wall, woven((150, 130, 110), 2), 0.5),
    ]


def _coded(rgba: Float32) -> UInt8:
    """Code values (H, W, 3) of scene-linear light (H, W, 4)."""
    codes = np.zeros((*rgba.shape[:2], 3), np.uint8)
    ArrayPicture(codes, "rgb").composite_over(Box(0, 0, rgba.shape[1], rgba.shape[0]), rgba)
    return codes


def _write(path: Path, picture: UInt8) -> None:
    quality = [cv2.IMWRITE_JPEG_QUALITY, 95, cv2.IMWRITE_JPEG_SAMPLING_FACTOR]
    full = [*quality, cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444]
    if not cv2.imwrite(str(path), picture[..., ::-1], full):
        raise RuntimeError("OpenCV does not write JPEG")
