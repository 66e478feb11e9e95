"""`nlens-video check OUT --plate IN`: reads result and plate once, side by side, and judges."""

from __future__ import annotations

import json
from collections.abc import Generator
from contextlib import closing
from dataclasses import dataclass, field
from fractions import Fraction
from pathlib import Path

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from nlens_video.cameras.files import read_camera
from nlens_video.check.frames import (
    FrameFeatures,
    find_range,
    frame_features,
    open_result,
    pair_frames,
)
from nlens_video.check.judge import (
    PICTURES,
    judge_drift,
    judge_frames,
    judge_plate,
    judge_shape,
    objects_among,
    shadows_among,
)
from nlens_video.check.judge_object import judge_object, median_bends
from nlens_video.check.levels import goes_above_white
from nlens_video.check.measure import Measures
from nlens_video.check.presence import judge_presence
from nlens_video.check.regions import Track
from nlens_video.check.sound import SoundPair, judge_sound, sound_notes
from nlens_video.check.verdict import Kind, Verdict, runs, write_page
from nlens_video.core import signals
from nlens_video.core.errors import InputError, UsageError
from nlens_video.core.settings import SourceSettings
from nlens_video.core.stdio import print_out
from nlens_video.run.frame_range import FrameRange
from nlens_video.video.atomic_files import check_target_folder
from nlens_video.video.info import Packet, SourceFrame
from nlens_video.video.input.source import open_source
from nlens_video.video.interfaces import Source

FINDINGS = 1
"""Exit code of a check that succeeded and found faults."""
_ROUNDING_S = 0.001


class Checked(Struct, frozen=True):
    """A check: the verdict, and the tracks of the objects for its charts."""

    verdict: Verdict
    objects: list[Track]


def check(
    result: str, plate: SourceSettings, *, search_range: bool, objects: int,
    camera_from: Path | None = None, report: Path | None, as_json: bool, quiet: bool,
) -> int:  # fmt: skip
    """Compare a result with its plate, print the findings and write the page.

    Args:
        result: written by `render`.
        plate: its plate, with the same range.
        search_range: whether the range is unknown and found by the pictures.
        objects: number of separate regions that the composite changes.
        camera_from: the camera that the object was rendered with, None where it is not known.
        report: folder of the page with charts.
        as_json: print everything as JSON.
        quiet: print nothing but JSON.

    Returns:
        0 where nothing is wrong, `FINDINGS` otherwise.

    Raises:
        InputError: one of the two cannot be read, or their frames differ in size.
        OutputError: the page cannot be written.
    """
    if report is not None:
        check_target_folder(report)
    checked = compare(
        result, plate, objects=objects, search_range=search_range, camera_from=camera_from
    )
    try:
        if as_json:
            print_out(json.dumps(checked.verdict.as_json(), indent=2) + "\n")
        elif not quiet:
            print_out("\n".join(checked.verdict.as_text()) + "\n")
    finally:  # the page is written even where printing fails
        if report is not None:
            write_page(report, checked.verdict, checked.objects)
    return 0 if checked.verdict.fine else FINDINGS


def compare(
    result: str, plate: SourceSettings, *, objects: int = 1, search_range: bool = False,
    camera_from: Path | None = None,
) -> Checked:  # fmt: skip
    """Read both side by side and judge; arguments as of `check`.

    Raises:
        InputError: one of the two cannot be read, or their frames differ in size.
        UsageError: the plate has no frames in the range.
        SceneError: the camera cannot be used.
    """
    assumed = find_range(result, plate) if search_range else None
    if assumed is not None:
        plate = replace(plate, frames=assumed)
    with (
        open_source(plate.spec, **plate.hints) as given,
        open_result(result, given.info, plate.input_transfer) as made,
    ):
        _check_sizes(given, made)
        bases = (given.info.time_base, made.info.time_base)
        measures = Measures(tick_s=float(sum(bases, Fraction(0))) / 2 + _ROUNDING_S)
        if camera_from is not None:
            size = given.info.width, given.info.height
            measures.drift.solved = read_camera(
                camera_from,
                size,
                given.info.average_rate,
                given.info.time_base,
                pixel_aspect=given.info.pixel_aspect,
            )
        codecs = [
            [one.codec for one in source.info.copied if one.type == "audio"]
            for source in (given, made)
        ]
        sound = [SoundPair(codecs=pair) for pair in zip(*codecs, strict=False)]
        above_white = goes_above_white(given.info.tags)
        readers = (
            _Reader(given, plate.frames, sound, above_white, from_plate=True),
            _Reader(made, (0, None), sound, above_white, from_plate=False),
        )
        frames = (readers[0].features(), readers[1].features())
        with closing(frames[0]), closing(frames[1]):
            for pair in pair_frames(*frames):
                signals.check()
                measures.drift.start_s = readers[0].start_s
                measures.add(pair)
    if not readers[0].count:
        begin, end = plate.frames
        raise UsageError(f"--range {begin}:{end or ''}: {plate.spec} has no such frames")
    tracks = objects_among(measures, objects)
    found = judge_frames(measures)
    noise = float(np.median(measures.noise)) if measures.noise else 0.0
    found += judge_presence(tracks, measures)
    for track in tracks:
        found += judge_object(track, noise)
    found += judge_plate(measures, tracks)
    found += judge_shape(given.info, made.info)
    found += judge_drift(measures.drift)
    heard = len(readers[0].heard)  # a range that a stream does not reach is without it
    missing = 0 if made.info.kind in PICTURES else max(0, heard - len(codecs[1]))
    found += judge_sound(sound, missing)
    largest = max(tracks, key=lambda one: sum(one.area), default=None)
    bends = (0.0, 0.0) if largest is None else median_bends(largest)
    counts = (readers[1].count, readers[0].count)
    range_note = _range_note(assumed, counts, measures) if search_range else ()
    verdict = Verdict(
        result=result,
        plate=plate.spec,
        frames=counts,
        object_frames=len({index for track in tracks for index in track.frames}),
        measures={
            "encoding_level": noise,
            "worst_time_ms": 1e3 * measures.worst_late_s,
            **({} if measures.drift.rms_px is None else {"drift_px": measures.drift.rms_px}),
            "sharpness_bend": bends[0],
            "coverage_bend": bends[1],
            "sound_shift_ms": 1e3
            * max((shift for one in sound for shift in one.shifts_s), default=0.0, key=abs),
        },
        findings=tuple(found),
        notes=(*range_note, *_notes(tracks, measures), *sound_notes(sound)),
        unknown=_unknown(tracks, measures, sound),
    )
    return Checked(verdict=verdict, objects=tracks)


@dataclass(slots=True)
class _Reader:
    """Reads one source: yields the features of its frames, passes its audio to `sound`.

    `heard` holds the numbers of the audio streams that have packets in the range.
    """

    source: Source
    frames: tuple[int, int | None]
    sound: list[SoundPair]
    above_white: bool
    from_plate: bool
    count: int = 0
    start_s: float = 0.0
    first_pts: int | None = None
    streams: list[int] = field(default_factory=list)
    heard: set[int] = field(default_factory=set)

    def features(self) -> Generator[FrameFeatures]:
        """The frames, numbered from 0."""
        self.streams = [one.index for one in self.source.info.copied if one.type == "audio"]
        early: list[Packet] = []
        first_s = 0.0
        for item in FrameRange(self.source, self.frames).items():
            if not isinstance(item, SourceFrame):
                early.append(item)
                continue
            if self.first_pts is None:
                self.first_pts, self.start_s = item.pts, item.time_s
                first_s = float(item.pts * item.time_base)
            for packet in early:
                self._add_sound(packet, first_s)
            early.clear()
            features = frame_features(item, self.first_pts, above_white=self.above_white)
            self.count += 1
            yield features
        for packet in early:
            self._add_sound(packet, first_s)

    def _add_sound(self, packet: Packet, first_s: float) -> None:
        number = packet.stream_index
        if number not in self.streams:
            return
        self.heard.add(number)
        place = self.streams.index(number)
        if place < len(self.sound):
            self.sound[place].add(packet, first_s, from_plate=self.from_plate)


def _notes(objects: list[Track], measures: Measures) -> list[str]:
    notes = [] if objects else ["no object was found: the result shows the plate alone"]
    for shadow in shadows_among(measures, objects):
        x, y, width, height = shadow.box_px
        notes.append(
            f"frames {shadow.first} to {shadow.last}: {width}x{height} px at {x},{y} are the plate "
            "with less light: taken for the object's shadow"
        )
    for first, last in runs(sorted(set[int]().union(*(track.disturbed for track in objects)))):
        notes.append(
            f"frames {first} to {last}: something moves in the plate at the object; its jumps, "
            "gaps and freezes are not judged there"
        )
    for track in objects:
        cropped = np.array(track.frames)[~track.whole]
        if len(cropped):
            notes.append(
                f"the object, or what it casts, reaches the frame's edge on {len(cropped)} "
                f"frame(s) of {cropped[0]} to {cropped[-1]}: its coverage and light are not judged "
                "there"
            )
    if objects and measures.drift.rms_px is None:
        notes.append(
            "the plate moves, and the object by itself: give the camera that it was rendered with "
            "(--camera-from CAMERA) to measure whether it slides over the ground"
        )
    if measures.tracks.crowded:
        notes.append("more than 64 regions differ; only the first 64 are listed")
    return notes


def _unknown(objects: list[Track], measures: Measures, sound: list[SoundPair]) -> tuple[Kind, ...]:
    """Kinds that could not be judged."""
    drift: tuple[Kind, ...] = ("drift",) if objects and measures.drift.rms_px is None else ()
    return drift if all(pair.copied for pair in sound) else (*drift, "sound")


def _range_note(
    assumed: tuple[int, int] | None, counts: tuple[int, int], measures: Measures
) -> tuple[str, ...]:
    """The range that was assumed, or that would explain a result which ends early."""
    made, given = counts
    if assumed is not None:
        first, end = assumed
        why = (
            f"its first frame shows the plate's frame {first}; --range A:B says otherwise"
            if first
            else "it ends before the middle of the plate; --range 0: is for all of that"
        )
        return (f"taken for the result of --range {first}:{end}, for {why}",)
    if made and measures.dropped and measures.dropped[-1] == given - 1:
        return (f"if the result is of a part of its plate, say which: --range 0:{made}",)
    return ()


def _check_sizes(given: Source, made: Source) -> None:
    plate, result = given.info, made.info
    if (plate.width, plate.height) != (result.width, result.height):
        raise InputError(
            f"{result.name} has {result.width}x{result.height} pixels, {plate.name} has "
            f"{plate.width}x{plate.height}; give the plate that the result was made from"
        )
