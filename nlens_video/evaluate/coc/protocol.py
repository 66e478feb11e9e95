"""`nlens-video evaluate coc`: stages F and R against ground truth, under rough conditions too."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from functools import cache, partial
from pathlib import Path

import cv2
import numpy as np

from nlens_video.core.errors import LensFitError, SceneError
from nlens_video.core.known_lens import UNKNOWN_LENS
from nlens_video.core.layers import CocMap, Float32, Float64
from nlens_video.core.lens_fit import LensFit
from nlens_video.evaluate.coc.baselines import BASELINES, NOTE, SCALED, best_factor, fit_line
from nlens_video.evaluate.coc.conditions import (
    PICTURES,
    YFOV_RATIOS,
    guess_camera,
)
from nlens_video.evaluate.coc.stated import stated_figures, stated_table
from nlens_video.evaluate.metrics import coc_figures, rms_within
from nlens_video.evaluate.plates import Plate, find_plates, load_plate
from nlens_video.evaluate.plots import PlateErrors, error_by_coc, reliability
from nlens_video.evaluate.report import Column, Report, Table, prepare_folder, track
from nlens_video.networks.lazy import lazy_lens_network
from nlens_video.scene.camera import Camera
from nlens_video.stages.f_coc import CocNetwork, estimate_coc
from nlens_video.stages.p_projection import GroundProjection, project_to_ground
from nlens_video.stages.r_regression import FitLens

OURS = "ours (network)"
_SAMPLE_STEP = 4  # the network's own grid: finer samples would tell the plots nothing more

Fit = Callable[[CocMap, GroundProjection], LensFit]


def evaluate_coc(folder: Path, out: Path | None, *, as_json: bool, quiet: bool) -> None:
    """Measure every plate of a folder.

    `folder` holds a folder for each plate (see `plates`), or is one itself; `out` gets `coc.md`, a
    CSV for each table and plots.

    Raises:
        InputError: no plate, or one that cannot be read.
        SceneError: a plate's GLB cannot be used.
        OutputError: `out` cannot be written.
        UsageError: plots are asked for and matplotlib is missing.
    """
    from nlens_video.networks.model_store import find_model
    from nlens_video.networks.onnx_networks import OnnxCocNetwork

    found, passed = find_plates(folder)
    prepare_folder(out, plots=True)
    with OnnxCocNetwork(find_model("coc").path) as network:
        protocol = CocProtocol(network)
        for path in track(found, "measuring plates", quiet=quiet):
            protocol.measure(load_plate(path))
    names = protocol.methods.plates()
    Report(
        name="coc",
        sections=[f"# CoC of {len(names)} plates\n\n{', '.join(names)}\n"],
        remark=f"Passed over, no stills: {', '.join(passed)}\n" if passed else "",
        tables=protocol.tables,
        facts={"plates": names, "passed_over": passed},
        plots={
            "reliability.png": ("reliability", partial(reliability, protocol.errors)),
            "error_by_coc.png": ("error by true CoC", partial(error_by_coc, protocol.errors)),
        },
    ).publish(out, as_json=as_json, quiet=quiet)


class CocProtocol:
    """Measures stages F and R plate by plate; keeps figures and a thin grid of errors only.

    Args:
        network: reads the blur off a picture.

    Attributes:
        methods: estimates of the whole plate's CoC, each against the truth.
        ablations: ways to fit the lens, each by the object's CoC.
        conditions: the shipped estimate and fit on rough plates and with a wrong camera.
        stated: how the errors of those fits compare with what they state.
        errors: of our estimate, one for each plate.
    """

    def __init__(self, network: CocNetwork) -> None:
        self._network = network
        self.methods = _methods_table()
        taken = Column("time_ms", "time, ms", 0, "median")
        self.ablations = _object_table("ablations", "Ways to fit the lens (stage R)", taken)
        self.conditions = _conditions_table()
        self.stated = stated_table()
        self.errors: list[PlateErrors] = []

    @property
    def tables(self) -> tuple[Table, ...]:
        """All tables, in the order in which they are shown."""
        return self.methods, self.ablations, self.conditions, self.stated

    def measure(self, plate: Plate) -> None:
        """Add a plate to all tables."""
        start = time.perf_counter()
        coc = estimate_coc(self._network, plate.rgb)
        self._add_method(plate, OURS, coc.coc_px, start, coc.sigma_px)
        rivals = self._measure_baselines(plate)
        self._measure_fits(plate, coc, rivals)
        self._measure_pictures(plate)
        self._measure_cameras(plate, coc)
        grid = np.s_[_SAMPLE_STEP // 2 :: _SAMPLE_STEP, _SAMPLE_STEP // 2 :: _SAMPLE_STEP]
        known = np.isfinite(plate.true_coc_px[grid])
        truth = plate.true_coc_px[grid][known]
        self.errors.append(
            PlateErrors(
                error_px=coc.coc_px[grid][known] - truth,
                sigma_px=coc.sigma_px[grid][known],
                true_coc_px=truth,
            )
        )

    def _measure_baselines(self, plate: Plate) -> dict[str, Float32]:
        """Measure the published estimates; return those that see the plate alone, by name."""
        alone: dict[str, Float32] = {}
        for baseline in BASELINES:
            start = time.perf_counter()
            coc = baseline.estimate(plate)
            if coc is not None and not baseline.given:
                alone[baseline.name] = coc
            self._add_method(plate, baseline.name, coc, start)
            if baseline.also_scaled:
                scaled = None if coc is None else best_factor(coc, plate.true_coc_px) * coc
                self._add_method(plate, baseline.name + SCALED, scaled, start)
        return alone

    def _add_method(
        self,
        plate: Plate,
        name: str,
        coc: Float32 | None,
        start: float,
        sigma: Float32 | None = None,
    ) -> None:
        time_ms = 1e3 * (time.perf_counter() - start)
        figures = {}
        if coc is not None:
            figures = coc_figures(coc, plate.true_coc_px, sigma) | {"time_ms": time_ms}
        self.methods.add(name, plate.name, figures)

    def _measure_fits(self, plate: Plate, coc: CocMap, rivals: dict[str, Float32]) -> None:
        ground = project_to_ground(plate.triangles, plate.camera, plate.ground_y)
        alike = np.full_like(coc.sigma_px, np.median(coc.sigma_px))
        even = CocMap(coc_px=coc.coc_px, sigma_px=alike)
        ways: dict[str, tuple[CocMap, Fit]] = {
            "shipped": (coc, _shipped(plate.camera)),
            "readings alone": (coc, _shipped(plate.camera, with_whole_ground=False)),
            "no lens network": (coc, _shipped(plate.camera, with_network=False)),
            "no confidence": (even, _shipped(plate.camera)),
            "no V-fit (the paper's line)": (coc, fit_line),
            "footprint only": (coc, lambda c, g: FitLens(whole_plane=False)(c, g).fit),
        }
        for name, read in rivals.items():
            ways[f"no confidence, {name}"] = (
                CocMap(coc_px=read, sigma_px=alike), _shipped(plate.camera),
            )  # fmt: skip
        for name, (estimate, fit) in ways.items():
            start = time.perf_counter()
            found = _attempt(fit, estimate, ground)
            time_ms = 1e3 * (time.perf_counter() - start)
            figures = {"object_rms_px": object_rms(plate, found), "time_ms": time_ms}
            self.ablations.add(name, plate.name, figures)

    def _measure_pictures(self, plate: Plate) -> None:
        truth = plate.true_coc_px
        height, width = truth.shape
        footprint = project_to_ground(plate.triangles, plate.camera, plate.ground_y).mask
        for name, degrade in PICTURES.items():
            coc = estimate_coc(self._network, degrade(plate.rgb))
            camera = plate.camera.resized(coc.coc_px.shape[1], coc.coc_px.shape[0])
            ground = project_to_ground(plate.triangles, camera, plate.ground_y)
            fit = _attempt(_shipped(camera), coc, ground)
            fit = fit and fit.for_width(width, height)
            scale = np.float32(width / coc.coc_px.shape[1])  # to the plate's pixels
            coc_px, sigma_px = (
                scale * cv2.resize(values, (width, height)) for values in (coc.coc_px, coc.sigma_px)
            )
            whole = coc_figures(coc_px, truth, sigma_px)
            figures = {
                "rmse_px": whole["rmse_px"],
                "confident_rmse_px": whole["confident_rmse_px"],
                "footprint_rmse_px": rms_within(coc_px, truth, footprint),
                "object_rms_px": object_rms(plate, fit),
            }
            self.conditions.add(name, plate.name, figures)
            self.stated.add(name, plate.name, stated_figures(plate, fit))

    def _measure_cameras(self, plate: Plate, coc: CocMap) -> None:
        for ratio in YFOV_RATIOS:
            try:
                guess = guess_camera(plate.camera, plate.triangles, plate.ground_y, ratio)
            except SceneError:
                rms = math.nan
            else:
                ground = project_to_ground(
                    guess.moved(plate.triangles), guess.camera, plate.ground_y
                )
                depth = guess.moved_depth(plate.camera, plate.object_depth.astype(np.float64))
                fit = _attempt(_shipped(guess.camera), coc, ground)
                rms = object_rms(plate, fit, depth)
            name = f"field of view {100 * (ratio - 1):+.0f} %"
            self.conditions.add(name, plate.name, {"object_rms_px": rms})


_lens_network = cache(lazy_lens_network)  # one for all plates


def _shipped(camera: Camera, *, with_whole_ground: bool = True, with_network: bool = True) -> Fit:
    """The fit as a run makes it through a camera, in metres."""
    known = UNKNOWN_LENS.prior(camera.fx, camera.width, 1.0)
    fit = FitLens(network=_lens_network() if with_network else None)
    return lambda coc, ground: (
        fit(coc, ground, known=known, with_whole_ground=with_whole_ground).fit
    )


def _attempt(fit: Fit, coc: CocMap, ground: GroundProjection) -> LensFit | None:
    try:
        return fit(coc, ground)
    except LensFitError:
        return None


def object_rms(plate: Plate, fit: LensFit | None, depth: Float64 | None = None) -> float:
    """Error of the CoC that a fit gives the object, nan where there is no fit [px]."""
    if fit is None:
        return math.nan
    known = np.where(plate.solid, plate.object_depth if depth is None else depth, 1.0)
    coc = fit.coc_px(np.asarray(1.0 / known, dtype=np.float32))
    return rms_within(coc, plate.object_coc_px, plate.solid)


def _methods_table() -> Table:
    return Table(
        name="methods",
        title="CoC of the whole plate (stage F)",
        columns=(
            Column("rmse_px", "RMSE, px of diameter"),
            Column("confident_rmse_px", "RMSE of the confident half, px"),
            Column("bias_px", "bias, px"),
            Column("relative_percent", "median relative error, %", 1),
            Column("time_ms", "time, ms", 0, "median"),
            Column("rmse_px", "plates", 0, "count"),
        ),
        detail="rmse_px",
        notes=(
            "Means over the plates; the median for time. The confident half is the half of the "
            "pixels with the smallest sigma. The relative error counts where the true CoC exceeds "
            "2 px.",
            NOTE,
        ),
    )


def _object_table(name: str, title: str, *more: Column) -> Table:
    return Table(
        name=name,
        title=title,
        columns=(
            Column("object_rms_px", "object's CoC, rms px"),
            Column("object_rms_px", "worst plate, px", 2, "worst"),
            Column("object_rms_px", "fits found", 0, "count"),
            *more,
        ),
        detail="object_rms_px",
        notes=(
            "Root mean square error of the signed CoC over the pixels that the object covers "
            "wholly. Mean and worst are over the plates on which a fit was found.",
        ),
    )


def _conditions_table() -> Table:
    table = _object_table(
        "conditions",
        "Rough plates and a wrong camera (stages F and R as shipped)",
        Column("rmse_px", "whole plate, RMSE px"),
        Column("confident_rmse_px", "confident half, px"),
        Column("footprint_rmse_px", "footprint, px"),
    )
    table.notes += (
        "All in px of the plate as rendered. With a wrong field of view the object is moved and "
        "scaled until it covers the same pixels; the plate's CoC map is the one of the first row.",
    )
    return table
