"""The words of a command, parsed, as `Settings`."""

from __future__ import annotations

import argparse

from nlens_video.core.aperture import parse_aperture
from nlens_video.core.settings import (
    ObjectSettings,
    OutputSettings,
    PlaceSettings,
    Settings,
    SourceSettings,
)
from nlens_video.options.lens_options import optics
from nlens_video.options.object_options import (
    object_settings,
    placing,
    playback,
)


def settings(words: argparse.Namespace) -> Settings:
    """Settings of `render` and `fit`."""
    output = output_settings(words) if words.command in ("render", "farm") else None
    return Settings(
        source=source_settings(words),
        scene=object_settings(words),
        output=output,
        preset=words.preset,
        effects="defocus" if words.command == "fit" else words.effects,
        budget_ms=getattr(words, "budget_ms", 180.0),
        hold_budget=getattr(words, "hold_budget", False),
        late=getattr(words, "late", "keep"),
        device=words.device,
        aperture=parse_aperture(words.aperture, cat_eye=words.cat_eye),
        shutter_deg=getattr(words, "shutter", None),
        optics=optics(words),
        track_focus=getattr(words, "track_focus", "off"),
        fit=getattr(words, "fit", None),
        save_fit=words.save_fit,
        fallback=words.fallback,
        report=words.report,
        aov=getattr(words, "aov", None),
        timings=getattr(words, "timings", None),
    )


def output_settings(words: argparse.Namespace) -> OutputSettings:
    """The result of `render` and `merge`."""
    return OutputSettings(
        spec=words.output,
        codec=words.codec,
        crf=words.crf,
        pix_fmt=words.pix_fmt,
        keep_partial=words.keep_partial,
    )


def place_settings(words: argparse.Namespace) -> PlaceSettings:
    """Settings of `place`."""
    return PlaceSettings(
        source=source_settings(words),
        scene=ObjectSettings(
            glb=words.glb,
            ground_y=words.ground_y,
            playback=playback(words),
            scene=words.scene,
            fov_deg=words.fov,
        ),
        start=placing(words, at=(0.5, 0.8), size=0.35, horizon=0.4),
        output=words.output,
    )


def source_settings(words: argparse.Namespace) -> SourceSettings:
    """The plate of any command that reads one."""
    return SourceSettings(
        spec=words.input,
        input_format=words.input_format,
        input_size=words.input_size,
        input_rate=words.input_rate,
        input_transfer=words.input_transfer,
        frames=getattr(words, "range", None) or (0, None),
        reconnect_s=getattr(words, "reconnect", 0.0),
    )
