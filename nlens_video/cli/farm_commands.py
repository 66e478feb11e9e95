"""The commands `farm` and `merge`, `render --resume` and `render --chunk-out`."""

from __future__ import annotations

from argparse import Namespace
from contextlib import ExitStack
from pathlib import Path

from nlens_video.cli.console import Console
from nlens_video.cli.output_files import check_outputs
from nlens_video.core.errors import NlensError, OutputError, UsageError
from nlens_video.core.settings import Settings
from nlens_video.farm.chunk import check_chunk, check_plate, render_chunk
from nlens_video.farm.job import PIECE_S, absolute, check_chunkable, run_job
from nlens_video.farm.merge import Merged, merge
from nlens_video.farm.store import Folder, FolderInUse, store_of
from nlens_video.farm.tasks import Progress, Shot, plan
from nlens_video.options import to_settings
from nlens_video.options.files import chunks_beside
from nlens_video.options.parser import parse
from nlens_video.options.to_settings import output_settings, source_settings
from nlens_video.options.toml_words import read_toml
from nlens_video.run.observers import check_sidecars
from nlens_video.run.preflight import check_settings


def run_merge(args: Namespace, console: Console) -> int:
    """`merge`; returns the exit code."""
    with console.progress_bar("merging") as on_progress:
        merged = merge(source_settings(args), args.chunks, output_settings(args), on_progress)
    console.merged(merged)
    return 0


def check_in_chunks(args: Namespace, settings: Settings) -> None:
    """Check what is rendered in chunks before anything is made.

    Raises:
        UsageError: an option is given that needs a single run, the plate is a stream, or a chunk
            alone has no lens or another encoding.
        NlensError: as `preflight.check_settings`.
    """
    alone = args.command == "render" and args.as_chunk
    check_plate(settings.source.spec)
    if alone:
        check_chunk(settings)
    else:
        check_chunkable(settings)
    check_settings(settings, as_chunks=alone)


def run_in_chunks(args: Namespace, settings: Settings, console: Console) -> int:
    """`farm` of one shot, `render --resume` or `render --chunk-out`; returns the exit code."""
    if args.command == "farm":
        return _run_farm(args, settings, console)
    if args.resume:
        return _run_resumable(args, settings, console)
    return _run_chunk(settings, Path(args.output), console)


def _run_farm(args: Namespace, settings: Settings, console: Console) -> int:
    """`farm` of one shot that `check_whole` has passed; returns the exit code.

    Raises:
        UsageError: Ray is not installed.
        NlensError: as `run.render` and `merge`.
    """
    store = store_of(args.chunks or str(chunks_beside(Path(args.output))))
    shot = Shot(settings=absolute(settings), store=store, chunk_s=args.chunk)
    (result,) = _run_on_ray([shot], args, console, clear=args.chunks is None)
    if isinstance(result, NlensError):
        raise result
    console.merged(result)
    return 0


def run_jobs(args: Namespace, console: Console) -> int:
    """`farm --jobs`; returns the exit code, of the first shot that failed where one did.

    Raises:
        UsageError: Ray is not installed, or the list is wrong.
    """
    shots = [
        Shot(
            settings=absolute(run),
            store=Folder(chunks_beside(output)),
            chunk_s=args.chunk,
        )
        for run in read_shot_list(args.jobs, overwrite=args.overwrite)
        for output in [Path("" if run.output is None else run.output.spec).absolute()]
    ]
    results = _run_on_ray(shots, args, console, clear=True)
    console.shots(
        [(shot.settings.source.spec, one) for shot, one in zip(shots, results, strict=True)]
    )
    return next((one.exit_code for one in results if isinstance(one, NlensError)), 0)


def _run_on_ray(
    shots: list[Shot], args: Namespace, console: Console, *, clear: bool
) -> list[Merged | NlensError]:
    """Render shots; with `clear`, remove the chunks of those whose results are complete."""
    try:
        from nlens_video.farm.on_ray import Cluster
    except ImportError as error:
        raise UsageError(
            f"farm needs Ray ({error}); pip install nlens-video[farm], or render chunks yourself "
            "with --chunk-out and join them with merge"
        ) from error
    gpus = any(shot.settings.device == "cuda" for shot in shots)
    cluster = Cluster(address=args.address, workers=args.workers, gpus=gpus)
    with ExitStack() as stack:
        for shot in shots:
            stack.enter_context(shot.store.held())
        progress = Progress(len(shots), stack.enter_context(console.progress_bar()))
        results = cluster.run([plan(shot, progress) for shot in shots])
        for shot, result in zip(shots, results, strict=True):
            if clear and not isinstance(result, NlensError):
                shot.store.clear()  # while no other run can have begun in it
    return results


def _run_resumable(args: Namespace, settings: Settings, console: Console) -> int:
    """`render --resume` of what `check_whole` has passed; returns the exit code.

    Raises:
        NlensError: as `job.run_job`.
    """
    folder = chunks_beside(Path(args.output))
    try:
        with console.progress_bar() as on_progress:
            merged = run_job(settings, folder, PIECE_S, on_progress, clear=True)
    except BaseException as error:
        refused = isinstance(error, FolderInUse | UsageError)
        if not refused and Folder(folder).has_any():
            error.add_note(f"{folder} holds what is done; the same command goes on from there")
        raise
    console.merged(merged)
    return 0


def _run_chunk(settings: Settings, folder: Path, console: Console) -> int:
    """`render --chunk-out`; returns the exit code."""
    with console.progress_bar() as on_progress:
        chunk = render_chunk(settings, folder, on_progress)
    console.chunk(chunk)
    if chunk.result is not None:
        check_sidecars(str(chunk.path), chunk.result.missing)
    return 0


_NEEDED = ("in", "object", "out")
_FARMED = {"command": "farm", "jobs": None, "chunks": None, "as_chunk": False}


def read_shot_list(path: Path, *, overwrite: bool = True) -> list[Settings]:
    """The runs of a list of shots.

    Args:
        path: TOML with a `[[shot]]` for each: `in`, `object`, `out`, and `options`, a list of
            options as on the command line; or `shot`, a shot file, in place of the first three.
            Paths are relative to the current folder, those in a shot file to its own.
        overwrite: whether what is there may be replaced without asking.

    Raises:
        UsageError: the file cannot be read, or a shot is wrong.
        OutputError: a shot writes over what one of them reads, or must not replace what is there.
    """
    listed = read_toml(path, f"--jobs {path}: cannot be read as TOML").get("shot")
    if not isinstance(listed, list) or not listed:
        raise UsageError(f"--jobs {path}: lists no [[shot]] with in, object and out")
    shots = [_parsed(entry, f"--jobs {path}: shot {at}") for at, entry in enumerate(listed, 1)]
    runs = [run for _, run in shots]
    written = [run.output.spec for run in runs if run.output is not None]
    twice = next((name for name in written if written.count(name) > 1), None)
    if twice is not None:
        raise UsageError(f"--jobs {path}: two shots write {twice}; give each its own")
    try:
        farmed = [args for args, _ in shots]
        check_outputs(Namespace(command="farm", jobs=path), *farmed, overwrite=overwrite)
    except OutputError as error:
        raise OutputError(f"--jobs {path}: {error}") from error
    return runs


def _parsed(entry: object, where: str) -> tuple[Namespace, Settings]:
    """A shot as `farm` parses it, and its settings."""
    if not isinstance(entry, dict):
        raise UsageError(f"{where} is no table")
    needed = ("shot",) if "shot" in entry else _NEEDED
    unknown = set(entry) - {*needed, "options"}
    if unknown:
        expected = ", ".join((*needed, "options"))
        raise UsageError(f"{where}: no {sorted(unknown)[0]!r} there; expected {expected}")
    named = [entry.get(key) for key in needed]
    options = entry.get("options", [])
    if not isinstance(options, list) or not all(isinstance(w, str) for w in (*named, *options)):
        raise UsageError(f"{where}: {', '.join(needed)} must be texts, options a list of them")
    try:
        args = parse(["render", *map(str, named), *options])
        run = to_settings.settings(args)
        check_chunkable(run)
    except UsageError as error:
        raise UsageError(f"{where}: {error}") from error
    return Namespace(**{**vars(args), **_FARMED}), run
