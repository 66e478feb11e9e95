"""Whether each object of a shot of several is ever in view."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace  # noqa: TID251 - a scene is a dataclass

from nlens_video.core.errors import Note, NoteKind
from nlens_video.graph.base.view import View, bounds_near_frame
from nlens_video.scene.scene import Scene
from nlens_video.video.info import SourceInfo

_MOST_MOMENTS = 20_000


def is_in_view(scene: Scene, view: View, info: SourceInfo) -> bool:
    """Whether a scene is in view at some moment of the plate; true where its length is unknown."""
    moments = list(_moments(scene, view, info))
    return not moments or any(bounds_near_frame(scene, view, one) is not None for one in moments)


def notes_on_unseen(scene: Scene, view: View, info: SourceInfo) -> tuple[Note, ...]:
    """A note on each object of several that the whole plate does not show.

    Args:
        scene: of all objects.
        view: how the plate's frames see it.
        info: the plate.
    """
    if len(scene.parts) < 2:
        return ()
    return tuple(
        Note(
            f"object {number}, {part.path}: it lies outside the frame on all frames; check its "
            "place, its size and its keys",
            NoteKind.UNCERTAIN,
        )
        for number, part in enumerate(scene.parts, 1)
        if not _is_inside(replace(scene, parts=(part,)), view, info)
    )


def _is_inside(scene: Scene, view: View, info: SourceInfo) -> bool:
    """Whether a scene is in the frame itself at some moment; true where there are none."""
    moments = list(_moments(scene, view, info))
    bounds = (bounds_near_frame(scene, view, one) for one in moments)
    return not moments or any(
        one is not None and not one.box.intersection(view.box).empty for one in bounds
    )


def _moments(scene: Scene, view: View, info: SourceInfo) -> Iterator[float]:
    """Times at half the frame interval over the plate [s]; none where its length is unknown."""
    step = 0.5 * view.frame_s
    camera_moves = view.cameras is not None and len(view.cameras.solved.keys) > 1
    if not step or not (scene.moves or camera_moves):
        yield 0.0
        return
    length = info.duration_s or 2.0 * step * (info.frame_count or 0)
    step = max(step, length / _MOST_MOMENTS)
    yield from (number * step for number in range(math.ceil(length / step)))
