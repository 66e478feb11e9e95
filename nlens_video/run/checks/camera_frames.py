"""Tells of a camera file of fewer frames than a run: beyond its ends the camera stands still."""

from __future__ import annotations

from nlens_video.cameras.solved import SolvedCamera
from nlens_video.core.errors import Note, NoteKind
from nlens_video.video.info import SourceInfo

_SLACK = 1  # frames that containers, which count by their length, and other programs are off by


def notes_on_camera_frames(
    camera: SolvedCamera | None, info: SourceInfo, frames: tuple[int, int | None]
) -> tuple[Note, ...]:
    """What to tell the user of a camera that does not last for the whole run; else nothing.

    Args:
        camera: of the plate; None where it has none of its own.
        info: the plate.
        frames: first frame of the run and the one behind its last, None for the plate's end.
    """
    if camera is None or len(camera.keys) == 1:
        return ()
    first, last = camera.keys[0].index, camera.keys[-1].index
    ends = [end for end in (info.frame_count, frames[1]) if end is not None]
    end = min(ends) if ends else None
    early, late = frames[0] < first - _SLACK, end is not None and end - 1 > last + _SLACK
    if not (early or late):
        return ()
    needed = f"{frames[0]} to {end - 1}" if end is not None else f"all from {frames[0]} on"
    text = (
        f"the camera file covers frames {first} to {last}, the run needs {needed}: outside the "
        f"camera stands still; solve the camera of all frames, or give --range {first}:{last + 1}"
    )
    return (Note(text, NoteKind.UNCERTAIN),)
