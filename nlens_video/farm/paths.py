"""Paths that mean the same on another machine, where the same folders are mounted."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from nlens_video.core.settings import Settings


def absolute(settings: Settings) -> Settings:
    """The settings with every file named from the root."""
    scene, light, real = settings.scene, settings.scene.light, settings.scene.real
    own_pipeline = settings.preset.endswith(".toml")
    return replace(
        settings,
        source=replace(settings.source, spec=_word(settings.source.spec)),
        scene=replace(
            scene,
            glb=scene.glb.absolute(),
            layers=None if scene.layers is None else _word(scene.layers),
            light=replace(light, env=_path(light.env)),
            real=replace(real, holdout=None if real.holdout is None else _word(real.holdout)),
        ),
        preset=_word(settings.preset) if own_pipeline else settings.preset,
        aperture=replace(settings.aperture, image=_path(settings.aperture.image)),
        fit=_path(settings.fit),
    )


def _path(path: Path | None) -> Path | None:
    return None if path is None else path.absolute()


def _word(spec: str) -> str:
    return str(Path(spec).absolute())
