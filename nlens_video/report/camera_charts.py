"""Charts of a solved camera: reprojection error over the frames, and the path from above."""

from __future__ import annotations

import math

import numpy as np

from nlens_video.cameras.solved import SolvedCamera
from nlens_video.core.layers import Float64
from nlens_video.report.html import figure, key, scrolled
from nlens_video.report.svg import Axes, dots, path

_WIDTH, _HEIGHT = 900.0, 260.0
_MOST_POINTS = 1500  # a line of more is no clearer
_ABOVE = (560.0, 420.0)
_MARGINS = (58.0, 14.0, 14.0, 52.0)
_VIEWS = 5  # fields of view that are drawn, evenly over the shot


def error_chart(frames: Float64, middle_px: Float64, most_px: Float64) -> str:
    """Median and 90th percentile of the reprojection error on each frame.

    Args:
        frames: their indices (F,), at least two.
        middle_px: medians (F,) [px].
        most_px: 90th percentiles (F,) [px].
    """
    every = -(-len(frames) // _MOST_POINTS)
    top = max(1.1 * float(np.quantile(most_px, 0.98)), 0.5)
    axes = Axes(width=_WIDTH, height=_HEIGHT, x=(float(frames[0]), float(frames[-1])), y=(0.0, top))
    body = axes.frame("frame", "error (px)")
    for values, kind in ((most_px, "slowest"), (middle_px, "fit")):
        drawn = np.minimum(values[::every], top)
        body += path(axes.points(frames[::every], drawn), kind)
    usual, worst = float(np.median(middle_px)), float(middle_px.max())
    words = f"Median of the points: {usual:.2f} px on the usual frame, {worst:.2f} px on the worst."
    chart = axes.drawing("Reprojection error over the frames", words, body)
    marks = [("fit", "median"), ("slowest", "90 % of the points are below")]
    return figure(key(marks) + scrolled(chart, "Reprojection error over the frames"), words)


def path_chart(solved: SolvedCamera) -> str:
    """Camera positions from above, with the field of view of some frames."""
    eyes = np.array([key.world_from_camera[:3, 3] for key in solved.keys])
    places = np.column_stack([eyes[:, 0], -eyes[:, 2]])  # away from the viewer is up
    chosen = np.unique(np.linspace(0, len(eyes) - 1, _VIEWS).round().astype(int))
    reach = max(0.35 * float(np.ptp(places, axis=0).max()), 0.25 * _height(solved))
    views = [_view(solved, int(place), places[place], reach) for place in chosen]
    axes = _equal_axes(np.concatenate([places, *views]))
    body = axes.frame("to the right (units)", "forward (units)")
    body += "".join(path(axes.points(one[:, 0], one[:, 1]), "band", closed=True) for one in views)
    if len(places) > 1:
        every = -(-len(places) // _MOST_POINTS)
        body += path(axes.points(places[::every, 0], places[::every, 1]), "fit")
    body += dots(axes.points(places[chosen, 0], places[chosen, 1]), "anchor w3")
    length = float(np.linalg.norm(np.diff(eyes, axis=0), axis=1).sum())
    words = {
        "still": "The camera stands still.",
        "rotation": "The camera turns on the spot.",
        "assumed": "The path is assumed.",
    }.get(solved.path, f"The camera moves {length:.3g} units.")
    marks = [("anchor w3", "camera"), ("fit", "path"), ("band", "field of view")]
    drawing = axes.drawing("Camera path from above", words, body)
    beside = f'{key(marks)}<p class="quiet">{words}</p>'
    return f'<div class="pair">{figure(drawing, "")}<div>{beside}</div></div>'


def _height(solved: SolvedCamera) -> float:
    """Of the first camera above the ground [scene unit]."""
    return max(abs(float(solved.keys[0].world_from_camera[1, 3]) - solved.ground_y), 1e-6)


def _view(solved: SolvedCamera, number: int, place: Float64, reach: float) -> Float64:
    """Corners (3, 2) of a frame's field of view from above."""
    key = solved.keys[number]
    half = math.tan(0.5 * math.radians(key.fov_x_deg))
    corners = [place]
    for side in (-half, half):
        ray = key.world_from_camera[:3, :3] @ np.array([side, 0.0, -1.0])
        flat = np.array([ray[0], -ray[2]])
        corners.append(place + reach * flat / max(float(np.linalg.norm(flat)), 1e-9))
    return np.array(corners)


def _equal_axes(points: Float64) -> Axes:
    """Axes of one scale in both directions that hold the points."""
    low, high = points.min(axis=0), points.max(axis=0)
    middle = 0.5 * (low + high)
    width = _ABOVE[0] - _MARGINS[0] - _MARGINS[2]
    height = _ABOVE[1] - _MARGINS[1] - _MARGINS[3]
    unit = 1.15 * max(float((high - low)[0]) / width, float((high - low)[1]) / height, 1e-9)
    across, up = 0.5 * unit * width, 0.5 * unit * height
    return Axes(
        width=_ABOVE[0], height=_ABOVE[1], margins=_MARGINS,
        x=(float(middle[0] - across), float(middle[0] + across)),
        y=(float(middle[1] - up), float(middle[1] + up)),
    )  # fmt: skip
