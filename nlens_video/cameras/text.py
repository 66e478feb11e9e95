"""Text of camera files, and what a file that is none of them says instead."""

from __future__ import annotations

import json
from pathlib import Path

from nlens_video.core.errors import SceneError

_SOLVE = "solve its camera (nlens-video solve IN camera.json) and give that"
_OTHERS = (
    (0, b"glTF", "a binary glTF file", "name it .glb"),
    (0, b"#usda", "a USD file", "name it .usda"),
    (0, b"PXR-USDC", "a USD file", "name it .usdc"),
    (0, b"PK\x03\x04", "a zip archive", "name it .usdz if it is a USD package, else unpack it"),
    (0, b"fspy", "a project of fSpy", "export its camera: File, Export, Camera parameters as JSON"),
    (0, b"BLENDER", "a Blender file", "export its camera as .glb or .chan"),
    (4, b"ftyp", "a video, no camera file", _SOLVE),  # MP4, MOV
    (0, b"\x1a\x45\xdf\xa3", "a video, no camera file", _SOLVE),  # Matroska, WebM
    (8, b"AVI ", "a video, no camera file", _SOLVE),
    (0, b"\x89PNG", "a picture, no camera file", _SOLVE),
    (0, b"\xff\xd8\xff", "a picture, no camera file", _SOLVE),  # JPEG
)
"""What files of other kinds hold from a byte on, what they are, and what to do."""


def read_text(path: Path, expected: str) -> str:
    """The text of a file.

    Args:
        path: the file.
        expected: what it should be, for messages.

    Raises:
        SceneError: it is not there, empty, of another kind or no text; the message says what to do.
    """
    try:
        content = path.read_bytes()
    except FileNotFoundError as error:
        raise SceneError(
            f"{path}: there is no such file; expected {expected}; check the name"
        ) from error
    except OSError as error:
        raise SceneError(
            f"{path}: cannot be read ({error.strerror}); expected {expected}"
        ) from error
    if not content.strip():
        raise SceneError(f"{path}: the file is empty; expected {expected}; write it again")
    for place, mark, kind, remedy in _OTHERS:
        if content.startswith(mark, place):
            raise SceneError(f"{path}: this is {kind}; expected {expected}; {remedy}")
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise SceneError(
            f"{path}: no camera file (byte {error.start} is not UTF-8); expected {expected}; write "
            "it again"
        ) from error


def broken_json(error: Exception) -> str:
    """What is wrong with text that is no JSON, in a few words; `error` is of `json.loads`."""
    if isinstance(error, json.JSONDecodeError):
        return f"it is no JSON from line {error.lineno}, column {error.colno} on"
    return "its JSON is nested too deeply"
