"""Which words of each command name files that it reads, and which name files that it writes.

The one table behind `overwriting` (no command writes over what it reads) and `existing_outputs`
(what is there already). A test walks all argument parsers and fails where an option that may name
a file is not listed.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from nlens_video.video.atomic_files import kept_name
from nlens_video.video.named_files import NamedFiles, local_path

CHUNKS = ("*.nut", "fit-*.json")
"""Files of a folder of chunks."""
PAGE = ("index.html",)
"""The file of a report's folder."""

Of = Callable[[Path], Path]


@dataclass(frozen=True, slots=True, kw_only=True)
class PathWord:
    """A word of the command line that names files.

    Attributes:
        dest: its name in the parsed words.
        name: how messages call it.
        role: what is done with the files.
        inside: shell patterns of the files, where the word names their folder.
        of: makes another path of the one that is named; None: that one.
        when: the option without which the word does not count; empty: it always does.
    """

    dest: str
    name: str
    role: Literal["reads", "writes"]
    inside: tuple[str, ...] = ()
    of: Of | None = None
    when: str = ""


@dataclass(frozen=True, slots=True)
class Use:
    """Files that a command reads or writes.

    Attributes:
        name: what they are, for messages.
        given: as the user named them.
        files: they.
        derived: whether the user named another file, beside which they lie.
    """

    name: str
    given: str
    files: NamedFiles
    derived: bool = False

    @property
    def folder(self) -> bool:
        """Whether the user named their folder."""
        return bool(self.files.inside)


def _reads(dest: str, name: str, inside: tuple[str, ...] = ()) -> PathWord:
    return PathWord(dest=dest, name=name, role="reads", inside=inside)


def _writes(
    dest: str, name: str, inside: tuple[str, ...] = (), *, of: Of | None = None, when: str = ""
) -> PathWord:
    return PathWord(dest=dest, name=name, role="writes", inside=inside, of=of, when=when)


def chunks_beside(output: Path) -> Path:
    """The folder of the chunks that become a result."""
    return output.with_name(f"{output.name}.chunks")


_PLATE = _reads("input", "the plate")
_SCENE = _reads("glb", "the scene")
_LOOKS = (
    _reads("layers", "--layers"),
    _reads("holdout", "--holdout"),
    _reads("env", "--env"),
    _reads("aperture", "--aperture"),
    _reads("preset", "the pipeline"),
)
_RESULT = _writes("output", "the result")
_PARTIAL = _writes(
    "output", "the part that --keep-partial keeps", of=kept_name, when="keep_partial"
)
_CHUNKS_BESIDE = _writes("output", "the folder of chunks", CHUNKS, of=chunks_beside, when="resume")
_REPORT = _writes("report", "--report", PAGE)
_SHOT = (_PLATE, _SCENE, *_LOOKS)
_BESIDE_RESULT = (
    _writes("save_fit", "--save-fit"),
    _writes("timings", "--timings"),
    _REPORT,
    _writes("aov", "--aov", ("*.exr",)),
)
_FIT = _reads("fit", "--fit")
_RENDERED = ("bg*.*", "object*.*", "gt*.png", "params.json", "env.hdr")
_NAMES_TOO = ("preset", "aperture")  # words that are a path or one of a few names

PATH_WORDS: dict[str, tuple[PathWord, ...]] = {
    "render": (*_SHOT, _FIT, _RESULT, *_BESIDE_RESULT, _PARTIAL, _CHUNKS_BESIDE),
    "render --as-chunk": (
        *_SHOT, _FIT, _writes("output", "the folder of chunks", CHUNKS), *_BESIDE_RESULT,
    ),
    "fit": (*_SHOT, _writes("save_fit", "the lens fit"), _REPORT),
    "farm": (
        *_SHOT, _FIT, _RESULT, *_BESIDE_RESULT, _PARTIAL, _writes("chunks", "--chunks", CHUNKS),
        _writes("output", "the folder of chunks", CHUNKS, of=chunks_beside),
    ),
    "farm --jobs": (_reads("jobs", "--jobs"),),
    "merge": (_PLATE, _reads("chunks", "a chunk", CHUNKS), _RESULT, _PARTIAL),
    "place": (_PLATE, _SCENE, _writes("output", "the contact sheet")),
    "check": (_PLATE, _reads("result", "the result"), _REPORT),
    "evaluate": (
        _reads("folder", "FOLDER", _RENDERED),
        _writes("out", "--out", (
            "*.md", "*.csv", "reliability.png", "error_by_coc.png", "composite.png",
        )),
    ),
    "bench": (
        _reads("folder", "FOLDER", _RENDERED),
        _writes("out", "--out", ("bench.md", "bench*.csv", "bench.png")),
    ),
    "study make": (
        _reads("folder", "FOLDER", ("*.csv", "*.png", "*.jpg", "*.jpeg", "*.webp")),
        _writes("page", "the page"),
    ),
    "study analyse": (_reads("answers", "the answers"),),
    "doctor": (),
    "completion": (),
}  # fmt: skip
"""By form of a command: what it reads and what it writes."""


def form(words: argparse.Namespace) -> str:
    """The row of `PATH_WORDS` that holds for parsed words."""
    command = str(words.command)
    if command == "render" and words.as_chunk:
        return "render --as-chunk"
    if command == "farm" and words.jobs is not None:
        return "farm --jobs"
    return f"study {words.what}" if command == "study" else command


def uses(words: argparse.Namespace, role: Literal["reads", "writes"]) -> Iterator[Use]:
    """The files that a command reads or writes, as far as its words name them.

    Args:
        words: of the command line.
        role: which of the two.
    """
    for word in PATH_WORDS[form(words)]:
        if word.role != role or (word.when and not getattr(words, word.when, False)):
            continue
        value = getattr(words, word.dest, None)
        for given in value if isinstance(value, list) else [value]:
            path = None if given is None else local_path(str(given))
            if path is None or (word.dest in _NAMES_TOO and not path.suffix):
                continue
            if word.of is not None:
                path = word.of(path)
            single = role == "reads" and not path.is_dir()  # a chunk by itself, a folder of them
            yield Use(
                word.name,
                str(given),
                NamedFiles(path, () if single else word.inside),
                word.of is not None,
            )


def drop_protocol(words: argparse.Namespace) -> None:
    """Turn `file:p.mp4`, FFmpeg's way of saying that a path is meant, into that path, in place."""
    for dest in {word.dest for word in PATH_WORDS[form(words)]}:
        value = getattr(words, dest, None)
        if isinstance(value, list):
            setattr(words, dest, [_bare(one) for one in value])
        elif value is not None:
            setattr(words, dest, _bare(value))


def _bare(given: str | Path) -> str | Path:
    path = local_path(str(given)) if str(given).startswith("file:") else None
    return given if path is None else type(given)(path)
