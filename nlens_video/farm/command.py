"""The commands of a farm, as the command line calls them."""

from __future__ import annotations

import argparse
from pathlib import Path

from nlens_video.arguments import output_settings, source_settings
from nlens_video.errors import UsageError
from nlens_video.farm.chunk import render_chunk
from nlens_video.farm.folder import beside, remove
from nlens_video.farm.here import render_here
from nlens_video.farm.job import run_job
from nlens_video.farm.merge import merge
from nlens_video.farm.paths import absolute
from nlens_video.settings import Settings
from nlens_video.show import Voice

PIECE_S = 2.0
"""Of a result that can be resumed: what a killed run loses at most [s]."""


def run_merge(words: argparse.Namespace, voice: Voice) -> int:
    """`merge`; returns the exit code."""
    with voice.progress_bar() as on_progress:
        merged = merge(source_settings(words), words.chunks, output_settings(words), on_progress)
    voice.merged(merged)
    return 0


def run_farm(words: argparse.Namespace, settings: Settings, voice: Voice) -> int:
    """`farm`; returns the exit code.

    Raises:
        UsageError: Ray is not installed.
        NlensError: as `job.run_job`.
    """
    try:
        from nlens_video.farm.on_ray import Cluster
    except ImportError as error:
        raise UsageError(
            f"farm needs Ray ({error}); pip install nlens-video[farm], or render chunks yourself "
            "with --as-chunk and join them with merge"
        ) from error
    cluster = Cluster(address=words.address, workers=words.workers)
    folder = beside(Path(words.output).absolute()) if words.chunks is None else words.chunks
    with voice.progress_bar() as on_progress:
        merged = run_job(
            absolute(settings), folder.absolute(), words.chunk, cluster.render, on_progress
        )
    if words.chunks is None:
        remove(folder)
    voice.merged(merged)
    return 0


def run_resumable(words: argparse.Namespace, settings: Settings, voice: Voice) -> int:
    """`render --resume`; returns the exit code.

    Raises:
        NlensError: as `job.run_job`.
    """
    folder = beside(Path(words.output))
    try:
        with voice.progress_bar() as on_progress:
            merged = run_job(settings, folder, PIECE_S, render_here, on_progress)
    except BaseException as error:
        if folder.is_dir():
            error.add_note(f"{folder} holds what is done; the same command goes on from there")
        raise
    remove(folder)
    voice.merged(merged)
    return 0


def run_chunk(settings: Settings, folder: Path, voice: Voice) -> int:
    """`render --as-chunk`; returns the exit code."""
    with voice.progress_bar() as on_progress:
        chunk = render_chunk(settings, folder, on_progress)
    voice.chunk(chunk)
    return 0
