"""Shipped network weights: looked up in the manifest, verified by SHA-256."""

from __future__ import annotations

import hashlib
import tomllib
from dataclasses import dataclass
from importlib import resources
from pathlib import Path

from nlens_video.core.errors import NlensError

MANIFEST = "manifest.toml"
_REPAIR = "install the package anew (in a checkout: git checkout -- models)"


@dataclass(frozen=True, slots=True, kw_only=True)
class Model:
    """A shipped network, as `manifest.toml` describes it.

    Attributes:
        name: what the program calls it.
        path: the weights, verified.
        sha256: their hash, lower-case hexadecimal.
        licence: SPDX identifier of the weights' licence.
        inputs: name of each input and its shape, in words.
        outputs: name of each output and its shape, in words.
    """

    name: str
    path: Path
    sha256: str
    licence: str
    inputs: dict[str, str]
    outputs: dict[str, str]


def models_folder() -> Path:
    """Where the weights lie: in the installed package, or beside it in a checkout."""
    installed = Path(str(resources.files("nlens_video"))) / "data" / "models"
    return installed if installed.is_dir() else Path(__file__).parents[2] / "models"


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
    try:
        entries = tomllib.loads(manifest.read_text(encoding="utf-8"))["model"]
        entry = entries.get(name)
    except (OSError, ValueError, KeyError, AttributeError) as error:
        raise NlensError(f"{manifest}: cannot be read ({error}); {_REPAIR}") from error
    if entry is None:
        known = ", ".join(sorted(entries)) or "none"
        raise NlensError(f"{manifest}: no network named {name!r}, only: {known}")
    try:
        model = Model(
            name=name,
            path=folder / entry["file"],
            sha256=entry["sha256"],
            licence=entry["licence"],
            inputs=dict(entry["inputs"]),
            outputs=dict(entry["outputs"]),
        )
    except (KeyError, TypeError, ValueError) as error:
        raise NlensError(f"{manifest}: [model.{name}] lacks {error}; {_REPAIR}") from error
    _verify(model)
    return model


def _verify(model: Model) -> None:
    try:
        found = hashlib.sha256(model.path.read_bytes()).hexdigest()
    except OSError as error:
        raise NlensError(
            f"{model.path}: weights of {model.name!r} cannot be read ({error.strerror}); {_REPAIR}"
        ) from error
    if found != model.sha256:
        raise NlensError(
            f"{model.path}: sha256 {found[:12]}… is not the {model.sha256[:12]}… that "
            f"{MANIFEST} states, so these are not the shipped weights; {_REPAIR}"
        )
