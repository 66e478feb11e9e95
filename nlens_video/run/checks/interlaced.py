"""Tells of a plate of fields: frames of it are composited as wholes."""

from __future__ import annotations

from nlens_video.core.errors import Note, NoteKind
from nlens_video.video.info import SourceInfo


def notes_on_fields(info: SourceInfo) -> tuple[Note, ...]:
    """What to tell the user of a plate whose frames consist of two fields; else nothing."""
    if not info.interlaced:
        return ()
    text = (
        "the plate is interlaced, and the object is composited on whole frames: where it or the "
        "camera moves it does not follow the fields; deinterlace the plate first, as by "
        "ffmpeg -i IN -vf bwdif OUT"
    )
    return (Note(text, NoteKind.UNCERTAIN),)
