"""What moves in front of the object in a shot: found beforehand, in two passes.

The first pass looks at small pictures: does the background stand still, once the camera's motion is
taken out, and does anything cross the place of the object? Only then a second one learns the
background there and follows what moves. Memory is bounded by the frame: a few pictures are kept,
and some numbers for each thing on a frame.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

import numpy as np

from nlens_video.core.layers import Box
from nlens_video.effects.finding import Finding
from nlens_video.effects.foreground.background import Background, SmallBackground, Survey, gain
from nlens_video.effects.foreground.canvas import Canvas, StillCanvas
from nlens_video.effects.foreground.relief import Views
from nlens_video.effects.foreground.reservoir import (
    FEW_KEPT,
    LARGE_PX,
    LEAST_PICTURES,
    MOST_KEPT,
    Reservoir,
)
from nlens_video.effects.foreground.still_survey import EVERY_S, StillSurvey
from nlens_video.effects.foreground.things import find_things, things_mask
from nlens_video.effects.foreground.tracks import Tracks
from nlens_video.effects.foreground.travelled_canvas import TravelledCanvas
from nlens_video.effects.foreground.turned_canvas import TurnedCanvas
from nlens_video.graph.base.context import ReadAgain
from nlens_video.graph.base.view import View
from nlens_video.graph.foreground_matte import MovingForeground
from nlens_video.graph.sight import Sight
from nlens_video.scene.camera import Camera
from nlens_video.scene.scene import Scene
from nlens_video.scene.scene_light import SceneLight
from nlens_video.video.info import SourceFrame

CERTAIN = 0.9
"""Least share of the object's surroundings whose background is known, to be sure of it [1]."""
_SAMPLES = 12  # moments at which the object's place is looked up beforehand
_CHECKED_EVERY = 12  # frames, whether what moves can still turn out steady
_LEAST_PARALLAX, _MOST_PARALLAX = 0.0005, 0.15
"""Of the frame's width, by which the background shifts if its depth matters, and may shift [1]."""


def find_moving_foreground(
    again: ReadAgain, scene: Scene, view: View, ground_y: float | None,
    seen: StillSurvey | None = None, light: SceneLight | None = None,
) -> tuple[MovingForeground | None, Finding]:  # fmt: skip
    """Look for what moves around an object.

    Args:
        again: reads the shot.
        scene: the object.
        view: how the frames see it.
        ground_y: height of the ground, None for the object's lowest point [scene unit].
        seen: the shot as it was looked at before for a still camera; default: it is read for that.
        light: what may tell a sun, whose shadow of the object is looked at, too.

    Returns:
        What moves there, None where nothing does or it cannot be told; and why.
    """
    sight = Sight(scene, view, ground_y, light)
    survey, canvas, times = _survey(again, sight, seen)
    place = _object_place(sight, canvas, times)
    if _parallax(sight, times) > _MOST_PARALLAX:
        return None, Finding("the camera travels, and what it sees shifts; give --holdout PATH")
    if survey.pictures > 1 and not survey.changes(place):
        return None, Finding("nothing moves where the object stands")
    small = survey.result()
    if small is None:
        return None, Finding("too few frames to know the background from")
    if not small.steady:
        return None, Finding("the camera moves, or most of the picture; give --holdout PATH")
    certainty = small.certainty(place)
    if certainty < CERTAIN:
        reason = f"only {certainty:.0%} of the background around the object is known"
        return None, Finding(
            f"{reason}; give --holdout PATH", certainty=certainty, threshold=CERTAIN
        )
    if not small.moves(place):
        return None, Finding("nothing moves where the object stands")
    found, steadiness = _follow(again, sight, canvas, small, place, times)
    if found is None or steadiness < CERTAIN:
        reason = "what moves there has no steady outline; give --holdout PATH"
        return None, Finding(reason, certainty=steadiness, threshold=CERTAIN)
    if not found.things:
        return None, Finding("what moves where the object stands is far behind it, or too brief")
    if not any(one.before > 0.0 for things in found.things.values() for one in things):
        return found, _sure("what moves there stays behind the object", certainty)
    reason = f"things move past the object; background known in {certainty:.0%} around it"
    return found, _sure(reason, certainty)


def _sure(reason: str, certainty: float) -> Finding:
    return Finding(reason, wanted=True, certainty=certainty, threshold=CERTAIN)


def _survey(
    again: ReadAgain, sight: Sight, seen: StillSurvey | None
) -> tuple[Survey, Canvas, list[float]]:
    """A first look at the shot, where its frames lie, and the moments at which it was read [s]."""
    if seen is None:
        seen = StillSurvey((sight.view.width, sight.view.height))
        for frame in again(sparse=True):
            seen.see(frame)
            if not sight.stays((seen.times[0], frame.time_s)):
                break
    if not sight.stays(seen.times):
        return _survey_moving(again, sight)
    return seen.survey, seen.canvas, seen.times


def _survey_moving(again: ReadAgain, sight: Sight) -> tuple[Survey, Canvas, list[float]]:
    """The same of a camera that moves, by the frames that show the object."""
    canvas: TurnedCanvas | None = None
    views, survey, times = Views(), Survey((sight.view.width, sight.view.height)), list[float]()
    for frame in _looked_at(again, sight, times):
        camera = sight.camera(frame.time_s)
        if canvas is None:
            canvas = sight.canvas(frame.time_s)
            survey = Survey(canvas.size)
        eye = camera.world_from_camera[:3, 3]
        roots = canvas.from_eye(eye).small(frame.picture, camera)
        survey.add(roots)
        views.add(roots, eye)
    if canvas is None:
        return survey, StillCanvas((sight.view.width, sight.view.height)), times
    if not _LEAST_PARALLAX < _parallax(sight, times) <= _MOST_PARALLAX:
        return survey, canvas, times
    contact = sight.contact(times[0])
    turned = canvas.from_eye(views.middle)
    small = turned.camera.resized(*canvas.small_size)
    travelled = TravelledCanvas.of(turned, views.disparity(small, contact))
    survey = Survey(canvas.size)
    for frame in _looked_at(again, sight, []):
        survey.add(travelled.still(frame.picture, sight.camera(frame.time_s)))
    return survey, travelled, times


def _looked_at(again: ReadAgain, sight: Sight, times: list[float]) -> Iterator[SourceFrame]:
    """The frames of a first look that show the object; adds the moments that were read [s]."""
    due = -math.inf
    for frame in again(sparse=True):
        times.append(frame.time_s)
        if frame.time_s < due:
            continue
        due = frame.time_s + EVERY_S
        if not sight.place(frame.time_s).empty:
            yield frame


def _parallax(sight: Sight, times: list[float]) -> float:
    """By how much things behind the object can shift over the shot, by the frame's width [1].

    Those that are laid as if they were infinitely far, and stand where the object does, shift most.
    """
    step = max(1, math.ceil(len(times) / _SAMPLES))
    seen = [one for one in times[::step] if not sight.place(one).empty]
    if not seen:
        return 0.0
    eyes = np.array([sight.camera(one).world_from_camera[:3, 3] for one in seen])
    travel = float(np.linalg.norm(np.ptp(eyes, axis=0)))
    away = np.linalg.norm(sight.contact(seen[0]) - eyes[0])
    camera = sight.camera(seen[0])
    return camera.fx * travel / max(float(away), 1e-9) / camera.width


def _object_place(sight: Sight, canvas: Canvas, times: list[float]) -> Box:
    """Where the object and what is close to it are over the shot, on the canvas."""
    return _reached(sight, canvas, times, sight.place)


def _reached(
    sight: Sight, canvas: Canvas, times: list[float], of: Callable[[float], Box]
) -> Box:  # fmt: skip
    place = Box(0, 0, 0, 0)
    step = max(1, math.ceil(len(times) / _SAMPLES))
    for time_s in times[::step]:
        seen = of(time_s)
        if not seen.empty:
            place = place.union(canvas.reached(seen, sight.camera(time_s)))
    return place


def _follow(
    again: ReadAgain, sight: Sight, canvas: Canvas, small: SmallBackground, place: Box,
    times: list[float],
) -> tuple[MovingForeground | None, float]:  # fmt: skip
    """The background around the object, and what moves before it; how steadily that goes [1]."""
    wide = place.union(_reached(sight, canvas, times, sight.shadow))
    large = wide.width * wide.height > LARGE_PX
    reservoir, tracks = Reservoir(most=FEW_KEPT if large else MOST_KEPT), Tracks()
    scale = canvas.size[0] / canvas.small_size[0], canvas.size[1] / canvas.small_size[1]
    cameras: dict[int, Camera] = {}
    for frame in again():
        picture, camera = frame.picture, sight.camera(frame.time_s)
        if canvas.seen(wide, camera).empty:
            continue
        roots, below = canvas.small(picture, camera), canvas.background(small, camera)
        taken = reservoir.takes_next
        change = gain(roots, below.roots)
        reservoir.add(canvas.part(picture, camera, wide) / change if taken else None)
        shown = ~np.isnan(roots[..., 0])
        roots = below.normalised(roots)
        mask = things_mask(roots, below.roots, below.noise)
        things = find_things(mask, shown)
        if not things:
            continue
        cameras[frame.index] = camera
        contact = sight.contact(frame.time_s)
        feet = [
            canvas.ground_disparity(
                (one.foot[0] * scale[0], one.foot[1] * scale[1]), camera, float(contact[1])
            )
            for one in things
        ]
        depth = -float(camera.to_camera(contact[None])[0, 2])
        nearness = 1.0 / depth if depth > 0.0 else math.inf
        tracks.add(frame.index, things, feet, nearness, (roots, mask))
        if frame.index % _CHECKED_EVERY == 0 and frame.time_s > 0.0:
            left = max(0.0, times[-1] / frame.time_s - 1.0)
            steadiness = tracks.steadiness(small.small(place), left)
            if steadiness < CERTAIN:
                return None, steadiness
    light, noise = reservoir.median()
    light[reservoir.shown < LEAST_PICTURES] = np.nan
    background = Background(box=wide, roots=light, noise=noise)
    found = MovingForeground(
        canvas=canvas, small=small, background=background, things=tracks.ordered(), cameras=cameras
    )
    return found, tracks.steadiness(small.small(place))
