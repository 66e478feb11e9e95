"""The plate's solved camera: in a section of a run's report, and the page of `solve --report`."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
from msgspec import Struct

from nlens_video.cameras.doubt import doubt
from nlens_video.cameras.solved import SolvedCamera
from nlens_video.core.layers import Float64
from nlens_video.report.camera_charts import error_chart, path_chart
from nlens_video.report.findings import Findings
from nlens_video.report.ground_grid import grid_in_view, over_plate
from nlens_video.report.html import (
    Image,
    document,
    figure,
    file_name,
    key,
    missing,
    picture,
    section,
    table,
)
from nlens_video.report.maps import COC_MAP, Scale
from nlens_video.solve.evidence import CLUTTER, VERTICAL, Reprojection
from nlens_video.solve.points.observations import Ints
from nlens_video.video.atomic_files import replacing

_QUALITY = 86
_PLUS_MINUS = "\N{PLUS-MINUS SIGN}"
_TOP_PX = 3.0  # error of the last colour
_GROUPS = (
    ("node-1", "vertical lines", (230, 159, 0)),
    ("node-2", "lines along the ground", (0, 158, 115)),
    ("node-3", "lines along the ground, another direction", (204, 121, 167)),
    ("node-4", "a third direction", (86, 180, 233)),
    ("node-5", "a fourth direction", (213, 94, 0)),
)
"""Class of the style sheet, name and colour, which is that of the class, of each group of lines."""
_CLUTTER_COLOR = (150, 150, 150)


class PlatePicture(Struct, frozen=True, eq=False):
    """A picture of the plate.

    Attributes:
        index: of its frame.
        time_s: of its frame [s].
        image: sRGB (H, W, 3), at any size.
    """

    index: int
    time_s: float
    image: Image


class CameraFindings(Struct, frozen=True, kw_only=True, eq=False):
    """All that the page of a solved camera is made from.

    Attributes:
        plate: its name.
        output: the camera's file.
        solved: the cameras.
        pictures: some frames, the first one first; at least one.
        lines: ends of the first picture's segments (N, 2, 2), at the plate's size [px].
        groups: of the segments, as of `line_groups`.
        tracked: the points, at the plate's size.
        frames: index in the plate of each solved frame.
    """

    plate: str
    output: str
    solved: SolvedCamera
    pictures: list[PlatePicture]
    lines: Float64
    groups: Ints
    tracked: Reprojection
    frames: list[int]


def ground_section(findings: Findings) -> str:
    """Section of a run's report: the solved ground on the plate; empty where none was solved."""
    solved, main = findings.session.view.solved, findings.main
    if solved is None or main is None:
        return ""
    shown = _on_ground(PlatePicture(main.index, main.time_s, main.before), solved)
    words = "The grid lies on the ground that the object stands on. It should lie flat on the plate"
    words += ", and its far lines close below the horizon."
    return section(
        "ground", "The plate's camera",
        f'<p class="quiet">{words}</p>{shown}{_values(solved)}',
    )  # fmt: skip


def write_camera_page(folder: Path, findings: CameraFindings) -> Path:
    """Write `index.html` into a folder that exists.

    Raises:
        OutputError: it cannot be written.
    """
    target = folder / "index.html"
    with replacing(target) as partial:
        partial.write_text(camera_page(findings), encoding="utf-8", errors="replace")
    return target


def camera_page(findings: CameraFindings) -> str:
    """The page as text; everything that came from outside is escaped."""
    solved = findings.solved
    arrow = "\N{RIGHTWARDS ARROW}"
    uncertain = doubt(solved)
    lead = f"{uncertain[:1].upper()}{uncertain[1:]}." if uncertain else (
        "The ground and the horizon below are those of the solved camera: check that the grid "
        "lies flat on the plate's ground and stays on it."
    )  # fmt: skip
    ground = "".join(_on_ground(one, solved) for one in findings.pictures)
    marks = [("node-4", "ground"), ("node-1", "horizon, shaded: one standard error")]
    sections = [
        section(
            "ground", "The ground on the plate",
            f'{key(marks)}<div class="pair">{ground}</div>',
        ),
        section("values", "What was found", _values(solved)),
        section("evidence", "What it was found from", _evidence(findings)),
        section("errors", "Reprojection error", _errors(findings)),
        section("path", "The path from above", path_chart(solved)),
    ]  # fmt: skip
    return document(
        "solve",
        f"{file_name(findings.plate)} {arrow} {file_name(findings.output)}",
        lead,
        "\n".join(sections),
        footer="Where no scale is known, the first camera stands 1.6 units above the ground.",
    )


def _on_ground(shown: PlatePicture, solved: SolvedCamera) -> str:
    """A picture with the ground's grid and the horizon."""
    grid = grid_in_view(solved.at(solved.keys[0].pts_s), solved.ground_y)
    image = over_plate(shown.image, solved, shown.time_s, grid)
    words = f"Frame {shown.index}, {shown.time_s:.2f} s."
    words += " No ground is in view." if grid is None else f" Squares of {grid.spacing:g} units."
    return figure(picture(image, f"Grid on the ground of frame {shown.index}", _QUALITY), words)


def _values(solved: SolvedCamera) -> str:
    first, errors = solved.keys[0], solved.errors
    frames = "one camera for all frames" if len(solved.keys) == 1 else f"{len(solved.keys)} frames"
    scale = "" if solved.scale == "metres" else "units of its own"
    reprojected = solved.reprojection_px
    rows = [
        ("Field of view", f"{first.fov_x_deg:.1f} {_PLUS_MINUS} {errors.fov_deg:.1f} degrees",
         solved.fov_source),
        ("Pitch", f"{first.pitch_deg:z.1f} {_PLUS_MINUS} {errors.pitch_deg:.1f} degrees",
         solved.horizon),
        ("Roll", f"{first.roll_deg:z.1f} {_PLUS_MINUS} {errors.roll_deg:.1f} degrees",
         solved.horizon),
        ("Path", solved.path, frames),
        ("Scale", solved.scale, scale),
        ("Reprojection", "no points" if reprojected is None else f"{reprojected:.2f} px",
         "median distance of a tracked point from where the camera sees it"),
        ("Method", solved.method, ""),
    ]  # fmt: skip
    head = ("value", "found", "how")
    return table("The camera, angles of the first frame", head, rows, stacked=True)


def _evidence(findings: CameraFindings) -> str:
    first, middle = findings.pictures[0], findings.pictures[len(findings.pictures) // 2]
    figures = ""
    if (findings.groups != CLUTTER).any():
        used = sorted({int(group) for group in findings.groups if group != CLUTTER})
        marks = [_GROUPS[group][:2] for group in used]
        words = f"Line segments of frame {first.index}. Grey ones agree with no direction."
        figures += figure(
            picture(_drawn_lines(findings, first), "Line segments by direction", _QUALITY)
            + key(marks), words, "Lines",
        )  # fmt: skip
    points = _drawn_points(findings, middle)
    if points is not None:
        words = f"Points tracked in frame {middle.index}, by their reprojection error. What moves "
        words += "by itself is far off and does not count."
        shown = picture(points, "Tracked points by reprojection error", _QUALITY)
        legend = Scale(top_px=_TOP_PX, colormap=COC_MAP).legend()
        figures += figure(shown + legend, words, "Points")
    if not figures:
        return missing(
            "Nothing in the plate tells the camera: no line agrees with a direction, and no point "
            "could be tracked. Give --fov and --horizon, or --camera-from."
        )
    return f'<div class="pair">{figures}</div>'


def _errors(findings: CameraFindings) -> str:
    frames, middle, most = findings.tracked.by_frame()
    if len(frames) < 2:
        return missing("No point was tracked over several frames.")
    indices = np.array(findings.frames, np.float64)[frames]
    return error_chart(indices, middle, most)


def _drawn_lines(findings: CameraFindings, shown: PlatePicture) -> Image:
    image = np.ascontiguousarray(shown.image).copy()
    scale = image.shape[1] / findings.solved.width
    thickness = max(1, round(image.shape[1] / 480))
    order = np.argsort(findings.groups, kind="stable")  # clutter first
    for ends, group in zip(findings.lines[order], findings.groups[order], strict=True):
        color = _CLUTTER_COLOR if group == CLUTTER else _GROUPS[int(group) - VERTICAL][2]
        first, last = (tuple(one) for one in np.round(ends * scale).astype(int).tolist())
        cv2.line(image, first, last, color, thickness, cv2.LINE_AA)
    return image


def _drawn_points(findings: CameraFindings, shown: PlatePicture) -> Image | None:
    tracked = findings.tracked
    if shown.index not in findings.frames:
        return None
    here = tracked.frame == findings.frames.index(shown.index)
    if not here.any():
        return None
    image = np.ascontiguousarray(shown.image).copy()
    scale = image.shape[1] / findings.solved.width
    size = max(1, round(image.shape[1] / 400))
    errors = tracked.error_px[here].astype(np.float32)
    colors = Scale(top_px=_TOP_PX, colormap=COC_MAP).colors(errors[None])[0]
    for spot, color in zip(tracked.position[here] * scale, colors.tolist(), strict=True):
        at = (round(float(spot[0])), round(float(spot[1])))
        cv2.circle(image, at, size + 1, (0, 0, 0), -1, cv2.LINE_AA)
        cv2.circle(image, at, size, tuple(color), -1, cv2.LINE_AA)
    return image
