"""Files that option values name, the column of the option table, and that such files name."""

from __future__ import annotations

import argparse
import json
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Literal
from urllib.parse import unquote

from msgspec import Struct

from nlens_video.video.atomic_files import kept_name, stem_beside
from nlens_video.video.named_files import is_file, local_path

_URI = re.compile(rb'"uri"\s*:\s*("(?:[^"\\]|\\.)*")')
_LISTS = {".m3u8", ".m3u", ".mpd", ".ffconcat", ".txt", ".sdp"}
_MOST_LIST_BYTES = 1 << 20


class Files(Struct, frozen=True):
    """Files that an option's value names.

    Attributes:
        role: what is done with them.
        name: what messages call them; empty: the option itself.
        inside: shell patterns of the files, where the value names their folder.
        of: the path that is meant, from the one that is named; None: that one.
        when: an option that must be given for this to hold, `!` before it for one that must not;
            empty: it always holds.
        or_word: whether a value may be of another kind too, such as a preset's name.
    """

    role: Literal["reads", "writes"]
    name: str = ""
    inside: tuple[str, ...] = ()
    of: Callable[[Path], Path] | None = None
    when: str = ""
    or_word: bool = False

    def holds(self, args: argparse.Namespace) -> bool:
        """Whether `when` is fulfilled."""
        given = bool(getattr(args, self.when.lstrip("!"), False))
        return not self.when or given != self.when.startswith("!")

    def is_word(self, path: Path) -> bool:
        """Whether a value is of the other kind: without a suffix, as `6:15:0.2` is too."""
        return self.or_word and not path.suffix[1:2].isalpha()


CHUNKS = ("*.nut", "fit-*.json", "front-*.npz")
"""Files of a folder of chunks."""
PAGE = ("index.html",)
"""The file of a report's folder."""
PICTURES = ("*.csv", "*.png", "*.jpg", "*.jpeg", "*.webp")
TABLES = ("*.md", "*.csv", "reliability.png", "error_by_coc.png", "composite.png")
BENCH = ("bench.md", "bench*.csv", "bench.png")


def chunks_beside(output: Path) -> Path:
    """The folder of the chunks that become a result."""
    mark = ".chunks"
    return output.with_name(f"{stem_beside(output, len(mark))}{output.suffix}{mark}")


READ, WRITE = (Files("reads"),), (Files("writes"),)
PIPELINE = (Files("reads", "the pipeline", or_word=True),)
APERTURE = (Files("reads", or_word=True),)
CAMERA = (Files("writes", "the camera"),)
PLATE, SCENE = (Files("reads", "the plate"),), (Files("reads", "the scene"),)
_RENDERED = ("bg*.*", "object*.*", "gt*.png", "params.json", "env.hdr")
PLATE_FOLDER = (Files("reads", "FOLDER", _RENDERED),)
REPORT = (Files("writes", inside=PAGE),)
RESULT = (
    Files("writes", "the result", when="!as_chunk"),
    Files("writes", "the part that --keep-partial keeps", of=kept_name, when="keep_partial"),
)
CHUNK_FOLDER = Files("writes", "the folder of chunks", CHUNKS, when="as_chunk")
CHUNKS_BESIDE = Files("writes", "the folder of chunks", CHUNKS, of=chunks_beside)
RESUMED_CHUNKS = Files("writes", "the folder of chunks", CHUNKS, of=chunks_beside, when="resume")


def beside_scene(scene: Path) -> Iterator[Path]:
    """Buffers and images that a glTF file names; a broken file is reported where it is loaded."""
    if scene.suffix.lower() not in (".gltf", ".glb"):
        return
    try:
        text = _gltf_json(scene)
    except OSError:
        return
    for match in _URI.finditer(text):
        try:
            name = str(json.loads(match[1]))
        except ValueError:
            continue
        if not name.startswith("data:"):
            yield scene.parent / unquote(name)


def _gltf_json(scene: Path) -> bytes:
    """The JSON of a glTF file: all of it, or the first chunk of a binary one."""
    with scene.open("rb") as file:
        head = file.read(20)  # of a binary one: mark, version, length, and the chunk's length, kind
        if head.startswith(b"glTF"):
            return file.read(int.from_bytes(head[12:16], "little"))
        return head + file.read()


def listed(plate: Path) -> Iterator[Path]:
    """Files that a plate names, bare or in quotes, where it is a playlist."""
    if plate.suffix.lower() not in _LISTS:
        return
    try:
        if plate.stat().st_size > _MOST_LIST_BYTES:
            return
        lines = plate.read_text(errors="replace").splitlines()
    except OSError:
        return
    for line in lines:
        for name in {line.strip(), *re.split(r"[\s'\"<>]+", line), *re.findall(r"'([^']+)'", line)}:
            path = local_path(name) if name else None
            if path is not None and len(name) < 255 and is_file(plate.parent / path):
                yield plate.parent / path
