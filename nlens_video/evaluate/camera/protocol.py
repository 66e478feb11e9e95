"""`nlens-video evaluate camera`: solved cameras against known ones, still and moving."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from nlens_video.cameras.solved import SolvedCamera
from nlens_video.core.errors import InputError, UsageError
from nlens_video.core.settings import SourceSettings
from nlens_video.evaluate.camera.angles import UNSOLVED, AngleError, angle_errors
from nlens_video.evaluate.camera.clip import path_figures
from nlens_video.evaluate.camera.plots import error_curves, stated_curves
from nlens_video.evaluate.camera.still import WIDTH_PX, coc_rms, subject_of
from nlens_video.evaluate.camera.truth import STILL, Known, find_known
from nlens_video.evaluate.report import Column, Report, Table, prepare_folder, track
from nlens_video.run.open_run import opened
from nlens_video.solve.shot import CUES, Cue
from nlens_video.stages.f_coc import CocNetwork, estimate_coc

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Solve = Callable[[Path, Sequence[Cue]], SolvedCamera]
"""Solves the camera of a plate by some cues, as the command `solve` does by all of them; raises
`InputError` if it cannot."""

ROWS = {
    "pitch": "pitch [deg]", "roll": "roll [deg]", "fov": "field of view [deg]",
    "fov_share": "field of view [%]", "yfov": "vertical field of view [deg]",
}  # fmt: skip
AREAS = ("pitch", "roll", "yfov")
AREAS_DEG = (1, 5, 10)
CUES_DEG = 5
ALONE: dict[str, tuple[Cue, ...]] = {"lines": ("lines",), "blur": ("blur",)}
GOOD_PX = 1.0


def evaluate_camera(
    folder: Path, out: Path | None, solve: Solve, *, as_json: bool, quiet: bool
) -> None:
    """Solve and measure every plate with a known camera in a folder (see `truth`).

    `out` gets `camera.md`, a CSV for each table and plots.

    Raises:
        InputError: no such plate, or one that cannot be read.
        SceneError: a plate's GLB cannot be used.
        OutputError: `out` cannot be written.
        UsageError: plots are asked for and matplotlib is missing, or a clip and pycolmap is.
    """
    from nlens_video.networks.model_store import find_model
    from nlens_video.networks.onnx_networks import OnnxCocNetwork

    found = find_known(folder)
    prepare_folder(out, plots=True)
    with OnnxCocNetwork(find_model("coc").path) as network:
        protocol = CameraProtocol(solve, network)
        for known in track(found, "solving cameras", quiet=quiet):
            protocol.measure(known)
    stills = len(protocol.stills.rows())
    Report(
        name="camera",
        sections=[f"# Cameras of {stills} still plates and {len(found) - stills} clips\n"],
        remark="".join(f"Not solved: {line}\n" for line in protocol.refusals),
        tables=protocol.tables,
        facts={"plates": [known.name for known in found], "not_solved": protocol.refusals},
        plots=protocol.plots,
    ).publish(out, as_json=as_json, quiet=quiet)


class CameraProtocol:
    """Solves and measures plate by plate; keeps figures only.

    Args:
        solve: solves a plate's camera.
        network: reads the blur off a picture.

    Attributes:
        angles: errors of each still plate by quantity, empty where it was not solved.
        refusals: names of plates that were not solved, and why.
    """

    def __init__(self, solve: Solve, network: CocNetwork) -> None:
        self._solve = solve
        self._network = network
        self.stills, self._errors, self._areas = _stills_table(), _errors_table(), _areas_table()
        self._objects, self._clips = _objects_table(), _clips_table()
        self._cues = _cues_table()
        self.angles: list[dict[str, AngleError]] = []
        self.refusals: list[str] = []

    @property
    def tables(self) -> tuple[Table, ...]:
        """All tables, in the order in which they are shown."""
        return self._errors, self._areas, self._cues, self._objects, self._clips, self.stills

    @property
    def plots(self) -> dict[str, tuple[str, Callable[[], Figure]]]:
        """Caption and drawing of each plot by its file name; none without a still plate."""
        solved = [errors for errors in self.angles if errors]
        if not solved:
            return {}
        return {
            "errors.png": ("share of plates by error", partial(error_curves, self.angles)),
            "stated.png": ("errors by stated errors", partial(stated_curves, solved)),
        }

    def measure(self, known: Known) -> None:
        """Add a plate to the tables."""
        start, spent = time.perf_counter(), time.process_time()
        found, refusal = self._found(known, CUES)
        if refusal:
            self.refusals.append(f"{known.name}: {refusal}")
        took = {"wall_s": time.perf_counter() - start, "cpu_s": time.process_time() - spent}
        if known.kind == STILL:
            self._add_still(known, found, took)
            for row, cues in ALONE.items():
                self._add_cues(row, known, self._found(known, cues)[0])
            self._add_cues("lines and blur", known, found)
        else:
            self._add_clip(known, found, took)

    def _found(self, known: Known, cues: Sequence[Cue]) -> tuple[SolvedCamera | None, str]:
        """The camera by some cues, None and the reason where there is none."""
        try:
            return self._solve(known.plate, cues), ""
        except (InputError, UsageError) as error:
            return None, str(error)

    def _add_cues(self, row: str, known: Known, found: SolvedCamera | None) -> None:
        errors = {} if found is None else angle_errors(known.camera, found)
        pitch, roll, share = (errors.get(key, UNSOLVED) for key in ("pitch", "roll", "fov_share"))
        self._cues.add(row, known.name, pitch.summary() | {
            "auc": pitch.area(CUES_DEG), "roll": abs(roll.error), "fov_share": abs(share.error),
        })  # fmt: skip

    def _add_still(self, known: Known, found: SolvedCamera | None, took: dict[str, float]) -> None:
        figures = took | self._object_figures(known, found)
        errors = {} if found is None else angle_errors(known.camera, found)
        for key, row in ROWS.items():
            error = errors.get(key, UNSOLVED)
            figures |= error.figures(key)
            self._errors.add(row, known.name, error.summary())
            if key in AREAS:
                self._areas.add(row, known.name, {f"auc_{d}": error.area(d) for d in AREAS_DEG})
        self.angles.append(errors)
        self.stills.add(known.name, known.name, figures)

    def _object_figures(self, known: Known, found: SolvedCamera | None) -> dict[str, float]:
        """CoC of the object by the solved camera and by the true one."""
        subject = subject_of(known)
        if subject is None:
            return {}
        with opened(SourceSettings(spec=str(known.plate))) as plate:
            coc = estimate_coc(self._network, next(iter(plate)).picture.srgb())
        true = coc_rms(subject, coc, known.camera.at(0.0), known.camera.ground_y)
        rms = math.inf
        if found is not None:
            rms = coc_rms(subject, coc, found.at(found.keys[0].pts_s), found.ground_y)
        for row, value in (("by the solved camera", rms), ("by the true camera", true)):
            good = 100.0 * (value <= GOOD_PX)
            self._objects.add(row, known.name, {"object_px": value, "good": good})
        return {"object_px": rms, "true_object_px": true}

    def _add_clip(self, known: Known, found: SolvedCamera | None, took: dict[str, float]) -> None:
        frames = len(known.camera.keys)
        figures = {name: value / frames for name, value in took.items()}
        figures["solved"] = 100.0 * (found is not None)
        if found is not None:
            errors = angle_errors(known.camera, found)
            figures |= path_figures(known, found)
            figures |= {key: abs(errors[key].error) for key in ("pitch", "roll")}
            figures["measured"] = 100.0 * errors["fov"].measured
        self._clips.add(known.kind, known.name, figures)


def _errors_table() -> Table:
    return Table(
        name="errors",
        title="Still cameras: errors",
        columns=(
            Column("all", "error, median", 2, "median"),
            Column("sure", "where measured: median", 2, "median"),
            Column("sure", "90th percentile", 2, "p90"),
            Column("measured", "measured, %", 0),
            Column("within", "within one stated error, %", 0),
            Column("sure_within", "the same where measured, %", 0),
        ),
        notes=(
            "Errors without their signs. Measured: what the solved camera says of itself. The "
            "field of view is that across the frame, once in degrees and once as a share of the "
            "true one.",
        ),
    )


def _areas_table() -> Table:
    return Table(
        name="areas",
        title="Still cameras: area under the recall curve",
        columns=tuple(Column(f"auc_{d}", f"AUC at {d} deg, %", 1) for d in AREAS_DEG),
        notes=(
            "Over all plates, whether measured or assumed; what is not solved counts 0. Published "
            "for photographs of LaMAR, another set, so only of a kind: UVP, without weights: roll "
            "73 / 82 / 86, pitch 42 / 60 / 69, vertical field of view 16 / 31 / 44; GeoCalib, "
            "learned: 86 / 93 / 95, 55 / 77 / 86, 19 / 42 / 60.",
        ),
    )


def _cues_table() -> Table:
    return Table(
        name="cues",
        title="Still cameras: what each cue is worth",
        columns=(
            Column("measured", "horizon measured, %", 0),
            Column("sure", "pitch where measured, median, deg", 2, "median"),
            Column("all", "pitch of all, median, deg", 2, "median"),
            Column("auc", f"pitch, AUC at {CUES_DEG} deg, %", 1),
            Column("within", "pitch within one stated error, %", 0),
            Column("roll", "roll of all, median, deg", 2, "median"),
            Column("fov_share", "field of view of all, median, %", 1, "median"),
        ),
        notes=(
            "The same plates, solved by line segments alone, by the blur of the ground alone, and "
            "by both as the command `solve` does.",
        ),
    )


def _objects_table() -> Table:
    return Table(
        name="objects",
        title="Still cameras: CoC of an object that covers the same pixels",
        columns=(
            Column("object_px", "rms, median px", 2, "median"),
            Column("object_px", "90th percentile, px", 2, "p90"),
            Column("object_px", "lens found", 0, "count"),
            Column("good", f"within {GOOD_PX:g} px, % of all", 0),
        ),
        notes=(
            f"Pixels of a frame {WIDTH_PX} px wide. The object is moved, turned and scaled as a "
            "whole until it covers its pixels under the solved camera; the lens is fitted with "
            "that camera's ground. By the true camera: what the lens fit alone misses.",
        ),
        empty="No still plate says its lens: nothing is said of objects.\n",
    )


def _clips_table() -> Table:
    return Table(
        name="clips",
        title="Moving cameras",
        columns=(
            Column("ground_px", "ground point, rms px", 2, "median"),
            Column("worst_px", "worst point of any, px", 2, "most"),
            Column("fov_percent", "field of view, largest error, %", 2, "worst"),
            Column("pitch", "pitch, deg", 2, "median"),
            Column("roll", "roll, deg", 2, "median"),
            Column("cpu_s", "processor time, s a frame", 3, "median"),
            Column("wall_s", "longest time, s a frame", 3, "most"),
            Column("solved", "solved, %", 0),
            Column("measured", "field of view measured, %", 0),
        ),
        notes=(
            "A row for each kind of motion: medians over its clips, the worst where it says so. "
            "Points of the ground are taken at their pixel of the first frame, put on the solved "
            "ground, and followed through all frames that show them; pixels of the plate.",
        ),
        empty="No clip of a camera that moves.\n",
    )


def _stills_table() -> Table:
    names = {"pitch": "pitch", "roll": "roll", "fov": "field of view"}
    return Table(
        name="stills",
        title="Still cameras, plate by plate",
        columns=(
            *(
                Column(f"{key}_{part}", f"{name}{heading}", digits)
                for key, name in names.items()
                for part, heading, digits in (
                    ("true", ", true deg", 1), ("error", ": error", 2), ("stated", ": stated", 2),
                )
            ),
            Column("pitch_measured", "horizon measured", 0),
            Column("fov_measured", "field of view measured", 0),
            Column("object_px", "object's CoC, px"),
            Column("true_object_px", "by the true camera"),
            Column("cpu_s", "processor time, s", 1),
        ),
        notes=("1: measured, 0: assumed. A dash: not solved, or no lens was found.",),
        empty="No still plate.\n",
    )  # fmt: skip
