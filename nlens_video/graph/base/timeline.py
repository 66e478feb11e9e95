"""How the animations of a scene lie against the length of the plate."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from nlens_video.core.errors import Note, NoteKind
from nlens_video.graph.base.view import View
from nlens_video.scene.scene import Scene
from nlens_video.scene.scene_part import ScenePart

_MOMENTS = 9  # of a shot, at which a few properties of all of it are read


def moments_of(scene: Scene, length_s: float | None) -> tuple[float, ...]:
    """A few moments of a plate, evenly over what differs in it [s].

    Args:
        scene: the objects.
        length_s: of the plate, None where it is not known [s].
    """
    end_s = max(scene.camera_motion.duration_s, *(part.end_s for part in scene.parts))
    end_s = end_s if length_s is None else min(end_s, length_s)
    if not scene.moves or end_s <= 0.0:
        return (0.0,)
    return tuple(np.linspace(0.0, end_s, _MOMENTS).tolist())


def notes_on_timing(scene: Scene, view: View) -> Iterator[Note]:
    """Notes on animations that do not play while the plate lasts.

    Args:
        scene: the objects.
        view: with the camera that sees them, and the length of the plate.
    """
    if not view.length_s:
        return
    lasts = f"the plate lasts {view.length_s:.4g} s"
    for part in scene.parts:
        of = f"{part.path}: " if len(scene.parts) > 1 else ""
        start_s, end_s = part.animation.start_s, part.animation.duration_s
        if start_s is None or not _rests(part, start_s, view.length_s):
            continue
        yield Note(
            f"{of}the animation runs from {start_s:.4g} to {end_s:.4g} s, {lasts}: the object "
            f"rests; give --animation-offset {round(start_s, 3):g}",
            NoteKind.UNCERTAIN,
        )
    motion = scene.camera_motion
    own = view.placed is None and view.cameras is None
    if own and motion.start_s is not None and motion.start_s >= view.length_s:
        yield Note(
            f"the camera's animation runs from {motion.start_s:.4g} to {motion.duration_s:.4g} s, "
            f"{lasts}: the camera rests; export it so that it begins at 0",
            NoteKind.UNCERTAIN,
        )


def _rests(part: ScenePart, start_s: float, length_s: float) -> bool:
    """Whether all that the plate shows of an animation lies before its first key or behind all."""
    playback, end_s = part.playback, part.animation.duration_s
    first_s = playback.moment(0.0, end_s)
    return first_s + playback.speed * length_s <= start_s or first_s >= end_s
