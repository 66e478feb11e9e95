"""Checks of a run before its plate is decoded, and of its result before it gets its name."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from nlens_video.cameras.solved import SolvedCamera
from nlens_video.core.errors import InputError, Note, SceneError, UsageError
from nlens_video.core.settings import ObjectSettings, OutputSettings, Settings, SourceSettings
from nlens_video.effects.planner import EffectRequest
from nlens_video.graph.base.objects_on_ground import load_scene, stage
from nlens_video.graph.base.view import View
from nlens_video.graph.pipeline_file import load_compositing_pipeline
from nlens_video.run.checks.objects_in_view import is_in_view, notes_on_unseen
from nlens_video.run.open_run import view_of
from nlens_video.run.plate_source import no_such_frames
from nlens_video.scene.scene import Scene
from nlens_video.stages.r_lens_track import read_fit
from nlens_video.video.atomic_files import check_folder, check_target_folder
from nlens_video.video.chunk_file import ChunkWriter
from nlens_video.video.chunk_queue import ChunkFeed
from nlens_video.video.info import SourceInfo
from nlens_video.video.interfaces import Sink
from nlens_video.video.named_files import ImageSequence, is_file
from nlens_video.video.output.sink import check_output, notes_on_encoding, open_sink

_ESTIMATE = 0.95
"""Containers that count frames by their length may be off by so much [1]."""


def preflight(settings: Settings, info: SourceInfo) -> None:
    """Check a run that is rendered in chunks and encoded at the end.

    Args:
        settings: the run.
        info: the plate.

    Raises:
        NlensError: as `run.render`.
    """
    check_settings(settings)
    check_shot(settings, info)
    if settings.output is not None:
        with open_result(settings.output, info, settings.source):
            pass  # closed without a commit, it leaves no file


def open_result(
    output: OutputSettings,
    info: SourceInfo,
    source: SourceSettings,
    chunks: ChunkFeed | None = None,
) -> Sink:
    """Open the result under a temporary name.

    Args:
        output: the result and its encoding.
        info: the plate.
        source: its range.
        chunks: where the result is a folder of chunks, those.

    Raises:
        UsageError: codec, quality or pixel format make no sense.
        OutputError: it cannot be written.
    """
    if chunks is not None:
        return ChunkWriter(Path(output.spec), info, chunks)
    return open_sink(
        output.spec, info, codec=output.codec, crf=output.crf, pix_fmt=output.pix_fmt,
        keep_partial=output.keep_partial, one_frame=source.one_frame,
    )  # fmt: skip


def notes_on_result(
    output: OutputSettings | None, info: SourceInfo, source: SourceSettings
) -> tuple[str, ...]:
    """What pictures lose in a result, which is not opened; of none, nothing.

    Args:
        output: as `open_result`.
        info: as `open_result`.
        source: as `open_result`.

    Raises:
        UsageError, OutputError: as `open_result`.
    """
    if output is None:
        return ()
    return notes_on_encoding(
        output.spec, info, codec=output.codec, crf=output.crf, pix_fmt=output.pix_fmt,
        one_frame=source.one_frame,
    )  # fmt: skip


def check_settings(settings: Settings, *, as_chunks: bool = False) -> None:
    """Check what needs no plate: names, folders, lens fit, preset and effects.

    Args:
        settings: the run.
        as_chunks: whether the output is a folder of chunks.

    Raises:
        UsageError: preset, effects, codec, quality or pixel format make no sense.
        LensFitError: the given fit cannot be used.
        OutputError: a file or folder cannot be written.
    """
    output = settings.output
    if output is not None and not as_chunks:
        check_output(output.spec, codec=output.codec, crf=output.crf, pix_fmt=output.pix_fmt)
    for path in (settings.save_fit, settings.timings):
        if path is not None:
            check_folder(path)
    for folder in (settings.report, settings.aov):
        if folder is not None:
            check_target_folder(folder)
    load_compositing_pipeline(settings.preset)
    EffectRequest.parse(settings.effects)
    if settings.fit is not None:
        read_fit(settings.fit)


def check_shot(settings: Settings, info: SourceInfo) -> tuple[Scene, tuple[Note, ...]]:
    """Check that the plate has the range and that the objects are in view.

    Args:
        settings: the run.
        info: the plate.

    Returns:
        The objects' files, from `load_scene`, and notes on those that are on no frame.

    Raises:
        UsageError: the range lies behind the plate's end, or a place makes no sense.
        InputError: a file that is to be read is missing.
        SceneError: the GLB cannot be used, or its object is in view on no frame of the plate.
    """
    first, _ = settings.source.frames
    known = info.frame_count if info.kind in ("video", "sequence", "still") else None
    if known is not None and _surely_missing(first, known):
        raise UsageError(no_such_frames(settings.source, info))
    objects = settings.scene
    if known is not None:
        _check_frames_of_places(objects, known)
    loaded = load_scene(objects)
    view = view_of(settings, info)
    _check_at_frame(objects, view.solved)
    staged = stage(objects, loaded, view)
    scene, view = staged.scene, staged.view
    _check_files(objects)
    if objects.footprint is not None:
        scene.triangles(0.0, objects.footprint)
    if not _is_whole(settings, info) or objects.layers is not None:
        return loaded, ()
    _check_in_view(objects, scene, view, info)
    return loaded, notes_on_unseen(scene, view, info)


def _check_frames_of_places(objects: ObjectSettings, frames: int) -> None:
    named = [("--at-frame", objects.at_frame)]
    named += [(f"{one.glb}: at-frame", one.at_frame) for one in objects.others]
    for name, frame in named:
        if _surely_missing(frame, frames):
            raise UsageError(f"{name} {frame}: the plate has {frames} frames, 0 to {frames - 1}")


def _surely_missing(index: int, frames: int) -> bool:
    """Whether a plate lacks that frame, though its number of frames may be an estimate."""
    return _ESTIMATE * index - 2 > frames


def _check_at_frame(objects: ObjectSettings, camera: SolvedCamera | None) -> None:
    if camera is None or len(camera.keys) == 1 or not objects.at_frame:
        return
    known = [key.index for key in camera.keys]
    if objects.at_frame not in known:
        whole = len(known) == known[-1] - known[0] + 1
        raise UsageError(
            f"--at-frame {objects.at_frame}: the camera file has no such frame; it has "
            f"{'frames' if whole else f'{len(known)} of the frames'} {known[0]} to {known[-1]}"
        )


def _check_files(objects: ObjectSettings) -> None:
    for option, spec in (
        ("--layers", objects.layers),
        ("--holdout", objects.real.holdout),
        ("--env-map", objects.light.env),
    ):
        if spec is not None and not ImageSequence.matches(str(spec)) and not is_file(Path(spec)):
            raise InputError(f"{option} {spec}: no such file")


def check_written(settings: Settings, info: SourceInfo, frames: int, *, changed: bool) -> None:
    """Check the written frames before the result gets its name.

    Args:
        settings: the run.
        info: the plate.
        frames: written [1].
        changed: whether one of them shows the object.

    Raises:
        UsageError: the range holds no frame.
        SceneError: a whole shot does not show the object.
    """
    if not frames:
        raise UsageError(no_such_frames(settings.source, info))
    if not changed and _is_whole(settings, info):
        raise SceneError(
            f"{settings.scene.glb}: the object is in view on none of {frames} frames; check "
            "--camera, --at, --size and --animation, or render a part with --range"
        )


def _is_whole(settings: Settings, info: SourceInfo) -> bool:
    """Whether a run covers a whole file, in which the object must be in view somewhere."""
    return settings.source.frames == (0, None) and info.kind != "stream"


def _check_in_view(objects: ObjectSettings, scene: Scene, view: View, info: SourceInfo) -> None:
    if is_in_view(scene, view, info):
        return
    when = "" if info.kind == "still" else " on all frames"
    placed = objects.placing or objects.on_ground
    raise SceneError(
        f"{objects.glb}: the object is out of view{when}, {_where(scene, view)}; check "
        f"{'--at and --size' if placed else '--camera'}, --animation and --scene, or "
        "render a part with --range"
    )


def _where(scene: Scene, view: View) -> str:
    """Where the object first lies relative to the frame, for a message."""
    camera = view.camera_at(scene, 0.0)
    seen = camera.to_camera(scene.pose(0.0).vertices().astype(np.float64))
    ahead = seen[seen[:, 2] < 0.0]
    if not len(ahead):
        return "behind the camera"
    x, y = np.median(camera.pixels(ahead), axis=0)
    sides = {"left of": -x, "right of": x - view.width, "above": -y, "below": y - view.height}
    side = max(sides, key=lambda name: sides[name])
    return f"{side if sides[side] > 0 else 'beside'} the frame"
