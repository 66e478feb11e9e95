"""`nlens-video check OUT --against IN`: both read once, side by side."""

from __future__ import annotations

import json
from collections.abc import Generator
from contextlib import closing
from dataclasses import dataclass, field, replace
from fractions import Fraction
from pathlib import Path

import numpy as np

from nlens_video.check.findings import KINDS, Finding, Verdict
from nlens_video.check.frame_features import FrameFeatures, frame_features
from nlens_video.check.frame_pairing import pair_frames
from nlens_video.check.judge import (
    judge_frames,
    judge_object,
    judge_plate,
    judge_sound,
    objects_among,
    restless,
    shadows_among,
)
from nlens_video.check.measure import Measures, Measuring
from nlens_video.check.offset import find_range as range_of
from nlens_video.check.regions import Track
from nlens_video.check.sound import SoundPair
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
"""Exit code of a comparison that went well and found something wrong."""
_SHOWN = 8  # findings of each kind that the table names; JSON and report have all
_ROUNDING_S = 0.001


@dataclass(frozen=True, slots=True)
class Checked:
    """A comparison: the verdict, and the series that it was made from."""

    verdict: Verdict
    objects: list[Track]
    measures: Measures


def check(
    result: str, plate: SourceSettings, *, find_range: bool, objects: int, report: Path | None,
    as_json: bool, quiet: bool,
) -> int:  # fmt: skip
    """Compare a result with its plate, print the findings and write the report.

    Args:
        result: what `render` has written.
        plate: what it was made from, with the same range.
        find_range: whether the range is not known and is to be found by the pictures.
        objects: how many separate regions the composite changes.
        report: folder of the page with plots.
        as_json: print everything as JSON.
        quiet: print nothing but JSON.

    Returns:
        0 where nothing is wrong, 1 where something was found.

    Raises:
        InputError: one of the two cannot be read, or their frames differ in size.
        OutputError: the report cannot be written.
    """
    if report is not None:
        check_target_folder(report)
    checked = compare(result, plate, objects=objects, find_range=find_range)
    try:
        if as_json:
            print_out(json.dumps(checked.verdict.as_json(), indent=2) + "\n")
        elif not quiet:
            print_out("\n".join(table(checked.verdict)) + "\n")
    finally:  # findings and page: each is given whatever becomes of the other
        if report is not None:
            from nlens_video.check.page import write_page

            write_page(report, checked.verdict, checked.objects)
    return 0 if checked.verdict.fine else FINDINGS


def compare(
    result: str, plate: SourceSettings, *, objects: int = 1, find_range: bool = False
) -> Checked:
    """Read both, side by side.

    Args:
        result: what `render` has written.
        plate: what it was made from.
        objects: how many separate regions the composite changes.
        find_range: whether the plate's range is found by the result's first picture.

    Raises:
        InputError: one of the two cannot be read, or their frames differ in size.
        UsageError: the plate has no frames in the range.
    """
    assumed = range_of(result, plate) if find_range else None
    if assumed is not None:
        plate = replace(plate, frames=assumed)
    with open_source(plate.spec, **plate.hints) as given, open_source(result) as made:
        _check_sizes(given, made)
        sound = _sound(given, made)
        read = (
            _Reading(given, plate.frames, sound, from_plate=True),
            _Reading(made, (0, None), sound, from_plate=False),
        )
        measuring = Measuring(_tick_s(given, made))
        looks = (read[0].looks(), read[1].looks())
        with closing(looks[0]), closing(looks[1]):
            for met in pair_frames(*looks):
                signals.check()
                measuring.take(met)
        missing = max(0, _audio_count(given) - _audio_count(made))
    if not read[0].count:
        begin, end = plate.frames
        raise UsageError(f"--range {begin}:{end or ''}: {plate.spec} has no such frames")
    tracks = objects_among(measuring.measures, objects)
    counts = (read[1].count, read[0].count)
    verdict = _verdict(result, plate.spec, counts, measuring.measures, tracks, sound, missing)
    if find_range:
        told = _range_note(assumed, counts, measuring.measures)
        verdict = replace(verdict, notes=(*told, *verdict.notes))
    return Checked(
        verdict=verdict,
        objects=tracks,
        measures=measuring.measures,
    )


@dataclass(slots=True)
class _Reading:
    """One source on its way through: its frames measured, its audio handed on."""

    source: Source
    frames: tuple[int, int | None]
    sound: list[SoundPair]
    from_plate: bool
    count: int = 0
    first_pts: int | None = None
    streams: list[int] = field(default_factory=list)

    def looks(self) -> Generator[FrameFeatures]:
        """The frames, numbered from 0."""
        self.streams = [one.index for one in self.source.info.copied if one.type == "audio"]
        early: list[Packet] = []
        first_s = 0.0
        for item in FrameRange(self.source, self.frames).items():
            if not isinstance(item, SourceFrame):
                early.append(item)
                continue
            if self.first_pts is None:
                self.first_pts = item.pts
                first_s = float(item.pts * item.time_base)
            for packet in early:
                self._take(packet, first_s)
            early.clear()
            look = frame_features(item, self.first_pts)
            self.count += 1
            yield look
        for packet in early:
            self._take(packet, first_s)

    def _take(self, packet: Packet, first_s: float) -> None:
        number = packet.stream_index
        place = self.streams.index(number) if number in self.streams else len(self.sound)
        if place < len(self.sound):
            self.sound[place].take(packet, first_s, from_plate=self.from_plate)


def table(verdict: Verdict) -> list[str]:
    """The verdict in a few lines: one for each kind, then what was found."""
    made, given = verdict.frames
    lines = [
        f"{verdict.result} against {verdict.plate}: {made} frames of {given}, "
        f"{verdict.object_frames} with an object"
    ]
    for kind, words in KINDS.items():
        found = verdict.of(kind)
        lines.append(f"{'ok  ' if not found else f'{len(found):<4d}'}{words}")
        lines += [f"      {one.text}" for one in found[:_SHOWN]]
        if len(found) > _SHOWN:
            lines.append(f"      and {len(found) - _SHOWN} more; --json names all")
    lines += [f"note: {note}" for note in verdict.notes]
    return lines


def _verdict(
    result: str, plate: str, counts: tuple[int, int], measures: Measures, objects: list[Track],
    sound: list[SoundPair], missing: int,
) -> Verdict:  # fmt: skip
    found: list[Finding] = judge_frames(measures)
    for track in objects:
        found += judge_object(track)
    found += judge_plate(measures, objects)
    found += judge_sound(sound, missing)
    seen = {index for track in objects for index in track.frames}
    largest = max(objects, key=lambda one: sum(one.area), default=None)
    calm = restless(largest) if largest is not None else (0.0, 0.0)
    return Verdict(
        result=result,
        plate=plate,
        frames=counts,
        object_frames=len(seen),
        measures={
            "encoding_level": float(np.median(measures.noise)) if measures.noise else 0.0,
            "worst_time_ms": 1e3 * measures.worst_late_s,
            "sharpness_bend": calm[0],
            "coverage_bend": calm[1],
            "sound_shift_ms": 1e3
            * max((max(one.shifts_s, key=abs) for one in sound), default=0.0, key=abs),
        },
        findings=tuple(found),
        notes=_notes(objects, measures),
    )


def _notes(objects: list[Track], measures: Measures) -> tuple[str, ...]:
    notes = []
    if not objects:
        notes.append("no object was found: the result shows the plate alone")
    for shadow in shadows_among(measures, objects):
        x, y, width, height = shadow.box_px
        notes.append(
            f"frames {shadow.first} to {shadow.last}: {width}x{height} px at {x},{y} are the plate "
            "with less light: taken for the object's shadow"
        )
    if measures.tracks.crowded:
        notes.append("so many places differ that only the first 64 are listed")
    return tuple(notes)


def _range_note(
    assumed: tuple[int, int] | None, counts: tuple[int, int], measures: Measures
) -> tuple[str, ...]:
    """What was assumed of the range that nobody gave."""
    made, given = counts
    if assumed is not None:
        first, end = assumed
        return (
            f"taken for the result of --range {first}:{end}, for its first frame shows the "
            f"plate's frame {first}; --range A:B says otherwise",
        )
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


def _tick_s(given: Source, made: Source) -> float:
    bases = (given.info.time_base, made.info.time_base)
    return float(sum(bases, Fraction(0))) / 2 + _ROUNDING_S


def _audio_count(source: Source) -> int:
    return sum(one.type == "audio" for one in source.info.copied)


def _sound(given: Source, made: Source) -> list[SoundPair]:
    codecs = [[one.codec for one in s.info.copied if one.type == "audio"] for s in (given, made)]
    return [SoundPair(codecs=pair) for pair in zip(*codecs, strict=False)]
