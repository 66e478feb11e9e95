"""Errors, each with one line for the user and one exit code, and the notes of a run."""

from __future__ import annotations

from enum import Enum
from typing import Self


class NlensError(Exception):
    """Base class; the message says what came, what was expected and what to do.

    Attributes:
        exit_code: status that the command line ends with.
    """

    exit_code = 1


class UsageError(NlensError):
    """An argument, an option or a pipeline file is wrong."""

    exit_code = 2


class InputError(NlensError):
    """The plate (video, picture, stream, layers) cannot be read."""

    exit_code = 3


class SceneError(NlensError):
    """The glTF scene cannot be used."""

    exit_code = 4


class NoGroundError(SceneError):
    """The camera sees no ground to stand on."""


class MissingCameraError(SceneError):
    """The glTF scene has no camera, and none was given."""


class LensFitError(NlensError):
    """No usable lens fit, and none was given."""

    exit_code = 5


class OutOfViewError(LensFitError):
    """No frame shows the object, so there is nothing to fit the lens on."""


class OutputError(NlensError):
    """The result cannot be written."""

    exit_code = 6


class ReaderGone(OutputError):
    """The reader of standard output closed it (broken pipe); no failure."""

    exit_code = 0


class NoteKind(Enum):
    """What a note is about."""

    OTHER = "other"
    INFORMATION = "information"
    """Nothing needs doing."""
    CAMERA = "camera"
    UNCERTAIN = "uncertain"
    """The result may be wrong; the note says what to do."""
    FOOTPRINT_UNSEEN = "footprint unseen"
    LIGHTS_MISSING = "lights missing"
    LIGHTS_LIMITED = "lights limited"
    """Some of the scene's lights are not used."""
    STREAM_LEFT_OUT = "stream left out"


class Note(str):
    """A sentence for the user, with the kind of what it is about.

    A string, so that it prints, compares and serialises as its text. Text made from it
    (`note + "."`) is a plain string again.

    Attributes:
        kind: what it is about.
    """

    kind: NoteKind

    def __new__(cls, text: str, kind: NoteKind = NoteKind.OTHER) -> Self:
        """Make a note; the default kind lets copies and pickles restore it from the text."""
        note = super().__new__(cls, text)
        note.kind = kind
        return note


def kind_of(note: str) -> NoteKind:
    """The kind of a note, `OTHER` for plain text."""
    return note.kind if isinstance(note, Note) else NoteKind.OTHER
