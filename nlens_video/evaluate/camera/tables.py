"""The tables of `evaluate camera`."""

from __future__ import annotations

from nlens_video.evaluate.camera.still import WIDTH_PX
from nlens_video.evaluate.report import Column, Table

AREAS_DEG = (1, 5, 10)
CUES_DEG = 5
GOOD_PX = 1.0


def errors_table() -> Table:
    """Errors of still cameras by quantity."""
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


def areas_table() -> Table:
    """Areas under the recall curves of still cameras."""
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


def cues_table() -> Table:
    """What each cue tells of still cameras."""
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
            "The same plates, solved by line segments alone, by the blur of the ground alone, by "
            "the camera network alone, by the first two, and by all as the command `solve` does.",
        ),
    )


def objects_table() -> Table:
    """CoC of the object under still cameras."""
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


def clips_table() -> Table:
    """Moving cameras by kind of motion."""
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


def stills_table() -> Table:
    """Still cameras plate by plate."""
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
