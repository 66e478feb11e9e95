"""What a command writes must not be what it reads: a slip of the hand must not cost the footage."""

from __future__ import annotations

import argparse
import json
import re
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import unquote

from nlens_video.cli.command_paths import Use, uses
from nlens_video.core.errors import OutputError
from nlens_video.video.named_files import NamedFiles, local_path

_URI = re.compile(rb'"uri"\s*:\s*("(?:[^"\\]|\\.)*")')
_LISTS = {".m3u8", ".m3u", ".mpd", ".ffconcat", ".txt", ".sdp"}
_MOST_LIST_BYTES = 1 << 20


def refuse_overwriting(*commands: argparse.Namespace) -> None:
    """See that no file that commands write is one that they read, nor two of them the same.

    Args:
        commands: words of the command line; several where they run side by side.

    Raises:
        OutputError: one of them is.
    """
    taken = _Taken()
    for words in commands:
        for read in (*uses(words, "reads"), *_named_inside(words)):
            taken.add(read)
    for words in commands:
        for written in uses(words, "writes"):
            other = taken.meeting(written)
            if other is not None:
                raise OutputError(_line(written, other))
            taken.add(written)


class _Taken:
    """Files that have a use already; single ones are looked up, since there may be many."""

    def __init__(self) -> None:
        self._uses: list[Use] = []
        self._by_key: dict[object, Use] = {}

    def add(self, use: Use) -> None:
        self._uses.append(use)
        self._by_key.update(dict.fromkeys(use.files.keys(), use))

    def meeting(self, use: Use) -> Use | None:
        """What has one of these files already."""
        for key in use.files.keys():
            if key in self._by_key:
                return self._by_key[key]
        return next(
            (
                other
                for other in self._uses
                if (use.files.several or other.files.several) and use.files.meets(other.files)
            ),
            None,
        )


def _line(written: Use, other: Use) -> str:
    if written.folder:
        return (
            f"{written.name} {written.given}: is the folder of {other.name} as well; "
            "give another folder"
        )
    return f"{written.name} {written.given}: is {other.name} as well; give it another name"


def _named_inside(words: argparse.Namespace) -> Iterator[Use]:
    """Files that a scene or a playlist names: they are read, too."""
    scene, plate = getattr(words, "glb", None), getattr(words, "input", None)
    if scene is not None:
        for path in _beside_scene(Path(scene)):
            yield Use("a file of the scene", str(path), NamedFiles(path))
    plate_path = None if plate is None else local_path(plate)
    if plate_path is not None and plate_path.suffix.lower() in _LISTS:
        for path in _listed(plate_path):
            yield Use("a file of the plate", str(path), NamedFiles(path))


def _beside_scene(scene: Path) -> Iterator[Path]:
    """Buffers and pictures that lie beside a glTF file; whoever loads it judges the file."""
    if scene.suffix.lower() != ".gltf":
        return
    try:
        text = scene.read_bytes()
    except OSError:
        return
    for match in _URI.finditer(text):
        try:
            name = str(json.loads(match[1]))
        except ValueError:
            continue
        if not name.startswith("data:"):
            yield scene.parent / unquote(name)


def _listed(plate: Path) -> Iterator[Path]:
    """Files that lines of a playlist name, bare or in quotes."""
    try:
        if plate.stat().st_size > _MOST_LIST_BYTES:
            return
        lines = plate.read_text(errors="replace").splitlines()
    except OSError:
        return
    for line in lines:
        for name in {line.strip(), *re.split(r"[\s'\"<>]+", line), *re.findall(r"'([^']+)'", line)}:
            path = local_path(name) if name else None
            if path is not None and len(name) < 255 and (plate.parent / path).is_file():
                yield plate.parent / path
