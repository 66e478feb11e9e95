"""The commands of a farm, as the command line calls them."""

from __future__ import annotations

import argparse
from pathlib import Path

from nlens_video.arguments import output_settings, source_settings
from nlens_video.farm.chunk import render_chunk
from nlens_video.farm.merge import merge
from nlens_video.settings import Settings
from nlens_video.show import Voice


def run_merge(words: argparse.Namespace, voice: Voice) -> int:
    """`merge`; returns the exit code."""
    with voice.progress_bar() as on_progress:
        merged = merge(source_settings(words), words.chunks, output_settings(words), on_progress)
    voice.merged(merged)
    return 0


def run_chunk(settings: Settings, folder: Path, voice: Voice) -> int:
    """`render --as-chunk`; returns the exit code."""
    with voice.progress_bar() as on_progress:
        chunk = render_chunk(settings, folder, on_progress)
    voice.chunk(chunk)
    return 0
