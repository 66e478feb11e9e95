"""`nlens-video evaluate scene`: the rendered object and its shadow against a path tracer's.

The object: mask and depth of the software rasteriser against the plate's layer. The shadow: how
much nearer to the truth it brings the ground.
"""

from __future__ import annotations

import math
from pathlib import Path

import cv2
import numpy as np

from nlens_video.core.layers import Bool, Box, UInt8
from nlens_video.effects.shadow.apply import ApplyShadow
from nlens_video.effects.shadow.cast import CastShadow, Moment
from nlens_video.effects.shadow.casters import Casters
from nlens_video.evaluate.bench.case import plate_case
from nlens_video.evaluate.metrics import psnr
from nlens_video.evaluate.plates import Plate, find_plates, load_plate, read_codes
from nlens_video.evaluate.report import Column, Report, Table, prepare_folder, track
from nlens_video.scene.environment import load_environment
from nlens_video.scene.illumination import Illumination, SceneLight
from nlens_video.stages.l_reblur import ReblurLayer
from nlens_video.video.exr import read_exr
from nlens_video.video.pixels.picture import ArrayPicture

TRUTH, DEPTH, MAP = "gt.png", "bg_depth.exr", "env.hdr"
NONE, GIVEN, BEST, GUESSED = (
    "no shadow", "by the given light", "the same, told its strength", "by a light guessed",
)  # fmt: skip
_HALF = 0.5  # coverage from which a pixel belongs to a mask [1]
_ON_GROUND = 0.02  # share of its distance by which a point of the ground may miss the plane
_SHADED = 0.9  # what is darker in the truth lies in the shadow [1]
_MEAN_PX = 5  # grain of the truth is averaged over so many pixels each way
_CLEAR_PX = 3  # from the outermost pixel that the object's blur reaches
_STRENGTHS = np.arange(0.5, 1.55, 0.1)


def evaluate_scene(folder: Path, out: Path | None, *, as_json: bool, quiet: bool) -> None:
    """Render the object of every plate and cast its shadow.

    `folder` holds a folder for each plate (see `plates`), or is one itself; the shadow is measured
    on those that also hold `gt.png`, `bg_depth.exr`, `gt_noshadow.png` and `object.exr`. `out` gets
    `scene.md` and a CSV for each table.

    Raises:
        InputError: no plate, or one that cannot be read.
        SceneError: a plate's GLB cannot be used.
        OutputError: `out` cannot be written.
    """
    found, _ = find_plates(folder)
    prepare_folder(out, plots=False)
    objects, shadows = _objects_table(), _shadows_table()
    for path in track(found, "drawing objects and shadows", quiet=quiet):
        plate = load_plate(path)
        objects.add("software rasteriser", plate.name, _object_figures(plate))
        for row, figures in _shadow_figures(plate).items():
            shadows.add(row, plate.name, figures)
    names = objects.plates()
    Report(
        name="scene",
        sections=[f"# Objects and shadows of {len(names)} plates\n\n{', '.join(names)}\n"],
        tables=[objects, shadows],
    ).publish(out, as_json=as_json, quiet=quiet)


def _object_figures(plate: Plate) -> dict[str, float]:
    """Mask and depth of the rendered object against those of the plate's layer."""
    from nlens_video.render.software.renderer import SoftwareObjectRenderer

    height, width = plate.alpha.shape
    alpha, depth = np.zeros((height, width), np.float32), np.full((height, width), np.inf)
    with SoftwareObjectRenderer(plate.scene) as renderer:
        layer = renderer.render(0.0, plate.camera)
    if layer is not None:
        frame = Box(0, 0, width, height)
        common = layer.box.intersection(frame)
        inside = common.slices_in(layer.box)
        alpha[common.slices_in(frame)] = layer.rgba[inside][..., 3]
        depth[common.slices_in(frame)] = layer.depth[inside]
    one, other = alpha >= _HALF, plate.alpha >= 255 * _HALF
    both = plate.solid & (alpha >= 1.0 - 1e-4) & np.isfinite(depth)
    error = 100.0 * np.abs(depth[both] / plate.object_depth[both] - 1.0)
    return {
        "iou": float((one & other).sum()) / max(1, int((one | other).sum())),
        "depth_error": float(error.mean()) if error.size else math.nan,
        "depth_error_99": float(np.percentile(error, 99)) if error.size else math.nan,
    }


def _shadow_figures(plate: Plate) -> dict[str, dict[str, float]]:
    """Figures of each row; none where the truth has no shadow, or shows it nowhere.

    Raises:
        InputError: a file that is there cannot be read or does not fit the others.
    """
    from nlens_video.kernels.scatter.scatter import blur_reach, scatter

    folder = plate.folder
    if not ((folder / TRUTH).is_file() and (folder / DEPTH).is_file()):
        return {}
    case = plate_case(plate)
    without, frame = case.truth, case.frame
    truth = np.ascontiguousarray(read_codes(folder / TRUTH, plate.alpha.shape)[..., :3])
    real = read_exr(folder / DEPTH).channels["Z"]
    ground = np.abs(real * plate.camera.plane_disparity(plate.ground_y) - 1.0) < _ON_GROUND
    region = ground & ~_reached(plate) & _darker(truth, without)
    if not region.any():
        return {}

    moment = Moment(Casters.of(plate.scene.pose(0.0), {}), plate.camera)
    darken = ApplyShadow(ReblurLayer(scatter=scatter, reach=blur_reach))
    base = psnr(without[region], truth[region])

    def figures(light: Illumination, strength: float) -> dict[str, float]:
        picture = without.copy()
        shadow = CastShadow(strength=strength)([moment], light, plate.ground_y, case.fit)
        if shadow is not None:
            darken(ArrayPicture(picture, "rgb"), shadow, frame)
        psnr_db = psnr(picture[region], truth[region])
        left = _light(picture, region) / _light(truth, region)
        return {"gain_db": psnr_db - base, "psnr_db": psnr_db, "left": left, "strength": strength}

    environment = load_environment(folder / MAP, 0.0, 0.0) if (folder / MAP).is_file() else None
    lights = plate.scene.pose(0.0).lights
    given = SceneLight(plate.scene.light_count, environment).on_ground(lights)
    plate_light = Illumination.of_plate(ArrayPicture(case.plate, "rgb").linear(frame))
    by_strength = [figures(given, strength) for strength in _STRENGTHS.tolist()]
    return {
        NONE: {"gain_db": 0.0, "psnr_db": base},
        GIVEN: figures(given, 1.0),
        BEST: max(by_strength, key=lambda found: found["psnr_db"]),
        GUESSED: figures(SceneLight(0).on_ground((), plate_light), 1.0),
    }


def _light(picture: UInt8, region: Bool) -> float:
    """Mean light of a region [1]."""
    frame = Box(0, 0, picture.shape[1], picture.shape[0])
    return float(ArrayPicture(picture, "rgb").linear(frame)[region].mean())


def _reached(plate: Plate) -> Bool:
    """Pixels (H, W) to which the lens may spread the object."""
    reach = math.ceil(0.5 * float(np.abs(plate.object_coc_px).max())) + _CLEAR_PX
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * reach + 1, 2 * reach + 1))
    there = (plate.object_coc_px != 0.0) | plate.solid
    return np.asarray(cv2.dilate(there.astype(np.uint8), disc) > 0)


def _darker(truth: UInt8, without: UInt8) -> Bool:
    """Pixels (H, W) that the shadow makes darker."""
    size = (_MEAN_PX, _MEAN_PX)
    one, other = (cv2.blur(p.astype(np.float32), size).sum(axis=2) for p in (truth, without))
    return np.asarray(one < _SHADED * other)


def _objects_table() -> Table:
    return Table(
        name="drawn",
        title="Mask and depth of the rendered object, against its layer",
        columns=(
            Column("iou", "mask, IoU", 4),
            Column("depth_error", "depth, mean error [%]", 4),
            Column("depth_error_99", "99 % below [%]", 4),
            Column("iou", "plates", 0, "count"),
        ),
        detail="iou",
        notes=(
            f"Masks are the pixels covered by {_HALF:g} or more; errors of depth are shares of it, "
            "over the pixels that the object covers wholly in both.",
        ),
    )


def _shadows_table() -> Table:
    return Table(
        name="shadow",
        title="The shadow on the ground, against a path tracer's",
        columns=(
            Column("gain_db", "gain over none [dB]"),
            Column("psnr_db", "PSNR [dB]"),
            Column("left", "light left, of the truth's", 2, "median"),
            Column("strength", "strength", 2, "median"),
            Column("gain_db", "plates", 0, "count"),
        ),
        detail="gain_db",
        notes=(
            "Over the pixels that show the ground (by the plate's true depth), which the blurred "
            f"object does not reach, and which the truth shows darker than {_SHADED:g} of what "
            f"they are without a shadow. {GIVEN}: the lights of the GLB, and {MAP} where it is "
            f"there; without it, how much light comes from around is a guess. {BEST}: with the "
            f"--shadow-strength that suits the truth best. {GUESSED}: the GLB's lights taken away, "
            "the light from around estimated from the plate. The lens is the true one.",
        ),
        empty=f"No plate holds {TRUTH} and {DEPTH}: nothing is said of shadows.\n",
    )
