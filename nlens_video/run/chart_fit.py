"""The lens of a plate that shows a chart of markers: `fit --chart`."""

from __future__ import annotations

import cv2
import numpy as np

from nlens_video.core import signals
from nlens_video.core.box import Box
from nlens_video.core.errors import LensFitError, UsageError
from nlens_video.core.layers import Float64, Picture
from nlens_video.core.lens_fit import LensFit
from nlens_video.core.settings import Settings
from nlens_video.graph.base.profiler import Profiler
from nlens_video.graph.executor import FrameState
from nlens_video.graph.nodes.known_lens_fit import fit_with_known
from nlens_video.run.checks.interlaced import notes_on_fields
from nlens_video.run.open_run import open_run
from nlens_video.scene.camera import Camera
from nlens_video.scene.illumination import LUMINANCE
from nlens_video.solve.edge_blur import PARTS, edge_blurs
from nlens_video.solve.marker_edges import refine
from nlens_video.solve.markers import MarkerFinder
from nlens_video.stages.r_regression import FitLens
from nlens_video.stages.r_samples import FitSamples

_FRAMES = 8  # of a clip that are measured: more of them add little
_SEARCHED = 240  # frames within which a marker is expected
_FEWEST = 8  # parts of edges
_MOST_ERROR_PX = 3.0  # of the CoC at infinity, where the markers show no slope
_ONE_DISTANCE = 1.1  # largest by smallest disparity: up to it there is about one [1]
_DISTANCES = 3  # at two, one lens has its focus between them and another one beside them
_SQUARE = np.array([(-0.5, 0.5), (0.5, 0.5), (0.5, -0.5), (-0.5, -0.5)])  # as OpenCV orders it


def chart_fit(settings: Settings, side_m: float) -> tuple[LensFit, tuple[str, ...]]:
    """Fit the lens on the edges of markers of known size, which may stand anywhere.

    Args:
        settings: the run; its camera tells the focal length in pixels.
        side_m: side of the markers [m].

    Returns:
        The lens, and notes for the user.

    Raises:
        UsageError: the camera's scale is not known, so that a distance in metres tells nothing, or
            an option that only the fit on the ground can honour.
        LensFitError: no marker, too few edges that are not blurred over, or none that tell how the
            blur changes with the distance.
    """
    _refuse_options_of_the_ground(settings)
    with open_run(settings, Profiler(settings.budget_ms)) as run_input:
        view, objects = run_input.session.view, run_input.session.context.objects
        if view.unit_m is None:
            raise UsageError(
                "--chart: the camera's scale is not known; give a GLB with its camera, or "
                "--camera-from with one in metres"
            )
        finder, first, searched = MarkerFinder(), 0, 0
        parts: list[Float64] = []
        for state in run_input.items([]):
            if not isinstance(state, FrameState):
                continue
            signals.check()
            searched += 1
            if not parts:
                first = state.frame.index
            camera = objects.camera(state.frame.time_s)
            parts += _measured(finder, state.picture, camera, side_m / view.unit_m)
            if len(finder.sightings()[0]) >= _FRAMES or searched >= _SEARCHED:
                break
    rows = np.concatenate(parts) if parts else np.zeros((0, 3))
    if len(rows) < _FEWEST:
        raise LensFitError(
            f"--chart: {len(rows)} parts of markers' edges can be measured, {_FEWEST} are needed; "
            "expected markers of OpenCV's dictionaries with white borders, large in the frame, "
            "their black borders wider than the blur"
        )
    number = np.arange(len(rows))
    samples = FitSamples(
        disparity=rows[:, 0], coc_px=rows[:, 1], sigma_px=rows[:, 2],
        anchor=np.zeros(len(rows), bool), weight=np.ones(len(rows)), cluster=number,
    )  # fmt: skip
    lens = settings.known_lens.across(camera.width / camera.fx, camera.height / camera.fy)
    known = lens.prior(camera.fx, camera.width, view.unit_m)
    size = camera.width, camera.height
    where = f"{len(rows)} parts of markers' edges"
    edges = len(rows) / PARTS
    found = fit_with_known(
        lambda lens: FitLens().of_samples(samples, size, where, first, lens, independent=edges),
        known, known, size, first,
    )  # fmt: skip
    distances = _distances(rows[:, 0])
    enough = distances >= _DISTANCES
    if not (enough or known.in_numbers) or not _told(found.fit):
        raise _not_told(distances, sum(len(part) == 0 for part in parts), len(parts))
    # markers at fewer distances tell no lens by themselves that another one could contradict
    warning = (found.warning,) if found.warning and (enough or found.regression is None) else ()
    return found.fit, (*notes_on_fields(run_input.info), *warning)


def _refuse_options_of_the_ground(settings: Settings) -> None:
    """Refuse options that have no meaning for a chart.

    Raises:
        UsageError: one of them is given.
    """
    given = {
        "--fit-region": settings.fit_region is not None,
        "--report": settings.report is not None,
    }
    for option, is_given in given.items():
        if is_given:
            raise UsageError(
                f"{option}: --chart measures the lens on markers, not on the ground; leave one of "
                "them out"
            )


def _distances(disparity: Float64) -> int:
    """How many distances the disparities (N,) of parts are of; like ones count as one."""
    count, first = 0, 0.0
    for value in np.sort(disparity):
        if value > _ONE_DISTANCE * first:
            count, first = count + 1, float(value)
    return count


def _told(fit: LensFit) -> bool:
    """Whether a lens holds at other distances than those of the markers."""
    return fit.depends_on_depth or fit.intercept_stderr <= _MOST_ERROR_PX


def _not_told(distances: int, left_out: int, found: int) -> LensFitError:
    """Why markers tell no lens.

    Args:
        distances: how many they stand at.
        left_out: markers of which no edge could be measured.
        found: markers, counted anew in each picture.
    """
    where = "do not tell how the blur changes with the distance"
    if distances < _DISTANCES:
        where = "lie at one or two distances only, whose blur more than one lens explains"
    others = f" ({left_out} of {found} are left out: blurred beyond their border)"
    return LensFitError(
        f"--chart: the markers that can be measured {where}{others if left_out else ''}; put "
        "markers at three or more distances, larger in the frame, or give the lens by --lens"
    )


def _measured(finder: MarkerFinder, picture: Picture, camera: Camera, side: float) -> list[Float64]:
    """Disparity, CoC and error (N, 3) of the edges of each marker of a picture."""
    light: Float64 = picture.linear(Box(0, 0, picture.width, picture.height)) @ LUMINANCE
    coded = np.clip(light, 0.0, 1.0) ** (1.0 / 2.2)
    before = len(finder.sightings()[0])
    finder.add(np.asarray(255.0 * coded, np.uint8))
    bright = np.asarray(255.0 * light, np.float32)  # coded, an edge's middle would lie off it
    return [
        row
        for sighting in finder.sightings()[0][before:]
        for corners in sighting.corners
        if (row := _of_marker(light, refine(bright, corners), camera, side)) is not None
    ]


def _of_marker(light: Float64, corners: Float64, camera: Camera, side: float) -> Float64 | None:
    """Disparity [1 / scene unit], CoC and error [px] (N, 3) of a marker; None without a pose."""
    matrix = np.array([[camera.fx, 0.0, camera.cx], [0.0, camera.fy, camera.cy], [0.0, 0.0, 1.0]])
    points = np.column_stack([side * _SQUARE, np.zeros(4)])
    solved, turn, shift = cv2.solvePnP(
        points, corners, matrix, None, flags=cv2.SOLVEPNP_IPPE_SQUARE
    )
    if not solved:
        return None
    # of a square that faces the camera, the closed form may be many degrees off
    turn, shift = cv2.solvePnPRefineLM(points, corners, matrix, None, turn, shift)
    blurs = edge_blurs(np.ascontiguousarray(light, np.float32), corners)
    across, down = blurs.share[:, 0] - 0.5, 0.5 - blurs.share[:, 1]
    axes = cv2.Rodrigues(turn)[0]
    depth = shift[2, 0] + side * (across * axes[2, 0] + down * axes[2, 1])
    if not (depth > 0.0).all():
        return None
    return np.column_stack([1.0 / depth, blurs.coc_px, blurs.error_px])
