"""Shipped network weights: looked up in the manifest, verified by SHA-256."""

from __future__ import annotations

import hashlib
import tomllib
from importlib import resources
from pathlib import Path
from typing import Any

from msgspec import Struct

from nlens_video.core.errors import NlensError

MANIFEST = "manifest.toml"
_REPAIR = "install the package anew (in a checkout: git checkout -- models)"


class Model(Struct, frozen=True):
    """Weights of a shipped network, verified: their file and its SHA-256 in hexadecimal."""

    path: Path
    sha256: str


def models_folder() -> Path:
    """Where the weights lie: in the installed package, or beside it in a checkout."""
    installed = Path(str(resources.files("nlens_video"))) / "data" / "models"
    return installed if installed.is_dir() else Path(__file__).parents[2] / "models"


def model_names() -> tuple[str, ...]:
    """Names of the shipped networks.

    Raises:
        NlensError: there is no manifest.
    """
    return tuple(_entries(models_folder() / MANIFEST))


def _entries(manifest: Path) -> dict[str, Any]:
    try:
        return dict(tomllib.loads(manifest.read_text(encoding="utf-8"))["model"])
    except (OSError, ValueError, KeyError, TypeError) as error:
        raise NlensError(f"{manifest}: cannot be read ({error}); {_REPAIR}") from error


def find_model(name: str, folder: Path | None = None) -> Model:
    """Look a network up and verify its file.

    Args:
        name: its name in the manifest.
        folder: where `manifest.toml` lies; the shipped models where none is given.

    Raises:
        NlensError: no manifest, no such network in it, its file missing or altered.
    """
    folder = models_folder() if folder is None else folder
    manifest = folder / MANIFEST
    entries = _entries(manifest)
    entry = entries.get(name)
    if entry is None:
        known = ", ".join(sorted(entries)) or "none"
        raise NlensError(f"{manifest}: no network named {name!r}, only: {known}")
    try:
        path, stated = folder / entry["file"], entry["sha256"]
    except (KeyError, TypeError) as error:
        raise NlensError(f"{manifest}: [model.{name}] lacks {error}; {_REPAIR}") from error
    try:
        found = hashlib.sha256(path.read_bytes()).hexdigest()
    except OSError as error:
        raise NlensError(
            f"{path}: weights of {name!r} cannot be read ({error.strerror}); {_REPAIR}"
        ) from error
    if found != stated:
        raise NlensError(
            f"{path}: sha256 {found[:12]}… is not the {stated[:12]}… that "
            f"{MANIFEST} states, so these are not the shipped weights; {_REPAIR}"
        )
    return Model(path, found)
