"""`nlens-video evaluate scene`: the rendered object and its shadow against a path tracer's.

The object: mask and depth of the software rasteriser against the plate's layer. The light: how
bright the object is drawn, by the light of a run without hints, with the GLB's lights, and with the
map of the surroundings. The shadow: how much nearer to the truth it brings the ground, and with the
plate's depth what stands on it.
"""

from __future__ import annotations

import math
from pathlib import Path

import cv2
import numpy as np

from nlens_video.core.errors import InputError
from nlens_video.core.layers import Bool, Box, DepthMap, UInt8
from nlens_video.effects.shadow.apply import ApplyShadow, Shadow
from nlens_video.effects.shadow.cast import CastShadow
from nlens_video.effects.shadow.cast_on_things import CastOnThings
from nlens_video.effects.shadow.casters import CasterCache, Casters, Moment
from nlens_video.evaluate.bench.case import plate_case
from nlens_video.evaluate.composite.light_cases import (
    AROUND,
    GUESSED,
    LIGHTS,
    MAP,
    light_cases,
)
from nlens_video.evaluate.metrics import psnr
from nlens_video.evaluate.plates import Plate, find_plates, load_plate, read_codes
from nlens_video.evaluate.report import Column, Report, Table, prepare_folder, track
from nlens_video.scene.illumination import LUMINANCE
from nlens_video.scene.patches import Patches
from nlens_video.scene.scene_light import SceneLight
from nlens_video.stages.l_reblur import ReblurLayer
from nlens_video.video.exr import FAR, read_exr
from nlens_video.video.pixels.picture import ArrayPicture

TRUTH, DEPTH, LAYER = "gt.png", "bg_depth.exr", "object.exr"
NONE = "no shadow"
_HALF = 0.5  # coverage from which a pixel belongs to a mask [1]
_ON_GROUND = 0.02  # share of its distance by which a point of the ground may miss the plane
_SHADED = 0.9  # what is darker in the truth lies in the shadow [1]
_FEWEST = 100  # pixels of a shadow on things from which on it counts
_MEAN_PX = 5  # grain of the truth is averaged over so many pixels each way
_CLEAR_PX = 3  # from the outermost pixel that the object's blur reaches
_DARK = 1e-4  # light below which none is compared [1]
_GAINS = (
    Column("gain_db", "gain over none [dB]"),
    Column("gain_db", "least gain [dB]", 2, "least"),
    Column("psnr_db", "PSNR [dB]"),
    Column("left", "light left, of the truth's", 2, "median"),
    Column("gain_db", "plates", 0, "count"),
)
_Rows = dict[str, dict[str, float]]
"""Figures of each row of a table."""


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
    objects, lit = _objects_table(), _light_table()
    shadows, things = _shadows_table(), _things_table()
    for path in track(found, "drawing objects and shadows", quiet=quiet):
        plate = load_plate(path)
        objects.add("software rasteriser", plate.name, _object_figures(plate))
        for row, figures in _light_figures(plate).items():
            lit.add(row, plate.name, figures)
        on_ground, on_things = _shadow_figures(plate)
        for row, figures in on_ground.items():
            shadows.add(row, plate.name, figures)
        for row, figures in on_things.items():
            things.add(row, plate.name, figures)
    names = objects.plates()
    Report(
        name="scene",
        sections=[f"# Objects and shadows of {len(names)} plates\n\n{', '.join(names)}\n"],
        tables=[objects, lit, shadows, things],
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


def _shadow_figures(plate: Plate) -> tuple[_Rows, _Rows]:
    """Figures of each row on the ground and on things; none where the truth has no shadow there.

    Raises:
        InputError: a file that is there cannot be read or does not fit the others.
    """
    from nlens_video.kernels.scatter.scatter import blur_reach, scatter

    folder = plate.folder
    if not ((folder / TRUTH).is_file() and (folder / DEPTH).is_file()):
        return {}, {}
    case = plate_case(plate)
    without, frame = case.truth, case.frame
    truth = np.ascontiguousarray(read_codes(folder / TRUTH, plate.alpha.shape)[..., :3])
    real = read_exr(folder / DEPTH).channels["Z"]
    ground = np.abs(real * plate.camera.plane_disparity(plate.ground_y) - 1.0) < _ON_GROUND
    dark = ~_reached(plate) & _darker(truth, without)
    posed = plate.scene.pose(0.0)
    moments = [Moment(Casters.of(posed, CasterCache()), plate.camera)]
    patches = Patches.of(posed).at(posed)
    darken = ApplyShadow(ReblurLayer(scatter=scatter, reach=blur_reach))

    def figures(shadow: Shadow | None, region: Bool) -> dict[str, float]:
        picture = without.copy()
        if shadow is not None:
            darken(ArrayPicture(picture, "rgb"), shadow, frame)
        psnr_db, base = (psnr(one[region], truth[region]) for one in (picture, without))
        left = _light(picture, region) / _light(truth, region)
        return {"gain_db": psnr_db - base, "psnr_db": psnr_db, "left": left}

    depth = DepthMap(np.where((real > 0.0) & (real < FAR), real, np.float32(np.inf)))
    found, there = _Rows(), _Rows()
    for row, (_, light) in {NONE: (None, None), **light_cases(plate)}.items():
        plane = None
        if light is not None:
            plane = CastShadow()(moments, light, plate.ground_y, case.fit, patches)
        if (dark & ground).any():
            found[row] = figures(plane, dark & ground)
        if not (dark & ~ground).sum() >= _FEWEST:
            continue
        there[row if light is None else f"{row}, on the plane"] = figures(plane, dark & ~ground)
        if light is not None:
            seen = CastOnThings()(plane, moments, light, plate.ground_y, case.fit, depth)
            there[f"{row}, by the depth"] = figures(seen, dark & ~ground)
    return found, there


def _light_figures(plate: Plate) -> dict[str, dict[str, float]]:
    """How much brighter each case draws the object than its layer is, in stops.

    Raises:
        InputError: the layer cannot be read or does not fit.
    """
    from nlens_video.render.software.renderer import SoftwareObjectRenderer

    path = plate.folder / LAYER
    if not path.is_file():
        return {}
    channels = read_exr(path).channels
    truth = np.stack([channels[name] for name in "RGB"], axis=-1).astype(np.float64) @ LUMINANCE
    if truth.shape != plate.alpha.shape:
        raise InputError(f"{path}: shape {truth.shape}, expected the picture's")
    frame = Box(0, 0, plate.camera.width, plate.camera.height)
    found = {}
    for row, (light, _) in light_cases(plate).items():
        drawn = np.zeros((frame.height, frame.width, 4))
        with SoftwareObjectRenderer(plate.scene, SceneLight(0)) as renderer:
            renderer.shade_itself()
            layer = renderer.render(0.0, plate.camera, plate_light=light)
        if layer is None:
            continue
        common = layer.box.intersection(frame)
        drawn[common.slices_in(frame)] = layer.rgba[common.slices_in(layer.box)]
        inside = plate.solid & (drawn[..., 3] >= 1.0 - 1e-4)
        ratio = np.maximum(drawn[inside][:, :3] @ LUMINANCE, _DARK)
        stops = np.log2(ratio / np.maximum(truth[inside], _DARK))
        if stops.size:
            found[row] = {
                "error_ev": float(np.median(np.abs(stops))),
                "bias_ev": float(np.median(stops)),
            }
    return found


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


def _light_table() -> Table:
    return Table(
        name="light",
        title="Light on the object, against a path tracer's",
        columns=(
            Column("error_ev", "median error [EV]"),
            Column("bias_ev", "median difference [EV]"),
            Column("error_ev", "plates", 0, "count"),
        ),
        detail="error_ev",
        notes=(
            "Over the pixels that the object covers wholly, its luminance by that of its layer. "
            "The cases are those of the table below.",
        ),
        empty=f"No plate holds {LAYER}: nothing is said of light.\n",
    )


def _shadows_table() -> Table:
    return Table(
        name="shadow",
        title="The shadow on the ground, against a path tracer's",
        columns=_GAINS,
        detail="gain_db",
        notes=(
            "Over the pixels that show the ground (by the plate's true depth), which the blurred "
            f"object does not reach, and which the truth shows darker than {_SHADED:g} of what "
            f"they are without a shadow. {GUESSED}: all light estimated from the plate. {LIGHTS}: "
            f"these, and the light around them from the plate. {AROUND}: {MAP} at its own level. "
            "The lens is the true one.",
        ),
        empty=f"No plate holds {TRUTH} and {DEPTH}: nothing is said of shadows.\n",
    )


def _things_table() -> Table:
    return Table(
        name="things",
        title="The shadow on what stands on the ground, against a path tracer's",
        columns=_GAINS,
        detail="gain_db",
        notes=(
            "As above, over the pixels that show no ground. On the plane: the shadow as it falls "
            "on the ground behind. By the depth: the plate's, as `--holdout` gives it.",
        ),
        empty="No plate shows a shadow on things: nothing is said of that.\n",
    )
