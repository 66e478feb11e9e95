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
from nlens_video.evaluate.camera.still import coc_rms, subject_of
from nlens_video.evaluate.camera.tables import (
    AREAS_DEG,
    CUES_DEG,
    GOOD_PX,
    areas_table,
    clips_table,
    cues_table,
    errors_table,
    objects_table,
    stills_table,
)
from nlens_video.evaluate.camera.truth import STILL, Known, find_known
from nlens_video.evaluate.report import Report, Table, prepare_folder, track
from nlens_video.run.plate_source import opened
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
SOME: dict[str, tuple[Cue, ...]] = {
    "lines": ("lines",), "blur": ("blur",), "network": ("picture",),
    "lines and blur": ("lines", "blur"),
}  # fmt: skip
"""Cues that a plate is solved by as well, to tell what each is worth."""


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
        self.stills, self._errors, self._areas = stills_table(), errors_table(), areas_table()
        self._objects, self._clips = objects_table(), clips_table()
        self._cues = cues_table()
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
            for row, cues in SOME.items():
                self._add_cues(row, known, self._found(known, cues)[0])
            self._add_cues("all three", known, found)
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
