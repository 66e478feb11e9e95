"""What moves in front of the object in a shot of a still camera: found beforehand, in two passes.

The first pass looks at small pictures: does the camera stand still, and does anything cross the
place of the object? Only then a second one learns the background there and follows what moves.
Memory is bounded by the frame: a few pictures are kept, and some numbers for each thing on a frame.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from nlens_video.cameras.placement import contact_point
from nlens_video.core.layers import Box, Float32, MovingMatte, MovingThings, Picture
from nlens_video.core.lens_fit import LensFit
from nlens_video.effects.finding import Finding
from nlens_video.effects.foreground.background import (
    FEW_KEPT,
    LARGE_PX,
    MOST_KEPT,
    Background,
    Reservoir,
    SmallBackground,
    Survey,
    gain,
    root,
    small_size,
)
from nlens_video.effects.foreground.looks import parted
from nlens_video.effects.foreground.matte import soft_matte
from nlens_video.effects.foreground.things import find_regions, find_things, normalised, things_mask
from nlens_video.effects.foreground.tracks import Ordered, Tracks
from nlens_video.graph.base.context import ReadAgain
from nlens_video.graph.base.view import View, bounds_near_frame
from nlens_video.scene.camera import Camera
from nlens_video.scene.scene import Scene

CERTAIN = 0.9
"""Least share of the object's surroundings whose background is known, to be sure of it [1]."""
_EVERY_S = 0.2  # from one frame that is looked at beforehand to the next [s]
_SAMPLES = 12  # moments at which the object's place is looked up beforehand
_MARGIN = 0.5  # of the object's height, around it: its shadow lies there [1]
_LEAST_MARGIN_PX = 24
_CHECKED_EVERY = 12  # frames, whether what moves can still turn out steady
_ALONG = 2.0  # pixels of the small size, within which the border of things that meet is sought
_SMOOTHEST = 2e-4  # variance of roots of light below which it is no border
_CONTEXT_PX = 24  # around a region from which a thing is continued [px]


@dataclass(frozen=True, slots=True, kw_only=True)
class MovingForeground:
    """What moves in a shot around its object.

    Attributes:
        small: background of the whole frame at a small size.
        background: that of the object's surroundings.
        things: what moves on each frame.
    """

    small: SmallBackground
    background: Background
    things: dict[int, tuple[Ordered, ...]]

    def on_frame(self, index: int) -> MovingThings:
        """What moves on a frame."""
        things = self.things.get(index, ())

        def matte(picture: Picture, region: Box, fit: LensFit | None) -> MovingMatte | None:
            return self._matte(things, picture, region, fit)

        return MovingThings(matte)

    def _matte(
        self, things: tuple[Ordered, ...], picture: Picture, region: Box, fit: LensFit | None
    ) -> MovingMatte | None:
        box = region.intersection(self.background.box)
        small_box = self.small.small(box)
        if box.empty or all(one.box.intersection(small_box).empty for one in things):
            return None
        near, before, meet = self._things_near(things, picture)
        frame = Box(0, 0, *self.small.size)
        wide = box.expanded(_CONTEXT_PX).intersection(self.background.box)
        size = frame.width, frame.height
        inside = wide.slices_in(frame)
        prior = cv2.resize(near, size, interpolation=cv2.INTER_LINEAR)[inside] > 0.5
        if not prior.any():
            return None
        part = wide.slices_in(self.background.box)
        light = picture.linear(wide)
        roots = self.background.roots[part]
        change = gain(root(picture.downsample(*small_size(*size))), self.small.roots)
        below = np.square(roots * change)
        scale = frame.width / self.small.noise.shape[1]
        share = soft_matte(
            light, below, self.background.noise[part], prior, self._edge_px(things, fit, scale),
            scale,
        )  # fmt: skip
        order = cv2.resize(before, size, interpolation=cv2.INTER_LINEAR)[inside]
        if meet:  # where one ends and another begins the picture knows better
            guide = np.ascontiguousarray(root(light))
            reach = max(2, math.ceil(_ALONG * scale))
            order = np.clip(cv2.ximgproc.guidedFilter(guide, order, reach, _SMOOTHEST), 0.0, 1.0)
        cut = box.slices_in(wide)
        return MovingMatte(
            box=box, coverage=share[cut], before=np.asarray(order[cut], np.float32),
            background=below[cut],
        )  # fmt: skip

    def _edge_px(self, things: tuple[Ordered, ...], fit: LensFit | None, scale: float) -> float:
        """How wide the softest edge of a thing is, by lens and motion [px]."""
        widest = 0.0
        for one in things:
            disparity = np.array([one.disparity], np.float32)
            coc = 0.0 if fit is None else abs(float(fit.coc_px(disparity)[0]))
            widest = max(widest, coc + 0.5 * one.moved_px * scale)
        return min(max(0.75 * widest, 1.0) + 1.0, 40.0)

    def _things_near(
        self, things: tuple[Ordered, ...], picture: Picture
    ) -> tuple[Float32, Float32, bool]:
        """Mask of what moves, how much of it is before the object, at the small size (h, w).

        And whether things of different order meet.
        """
        roots = root(picture.downsample(*small_size(*self.small.size)))
        roots = normalised(roots, self.small.roots)
        mask = things_mask(roots, self.small.roots, self.small.noise)
        meet = False
        near, order = np.zeros(mask.shape, np.float32), np.full(mask.shape, np.nan, np.float32)
        frame = Box(0, 0, *mask.shape[::-1])
        for region in find_regions(mask):
            parts = sorted(
                (one for one in things if one.region == region.box), key=lambda one: one.disparity
            )
            inside = np.zeros(mask.shape, np.bool_)
            inside[region.box.slices_in(frame)] = region.inside
            near[inside] = bool(parts)
            if len({one.before for one in parts}) > 1:
                meet, at = True, region.box.slices_in(frame)
                shares = parted(
                    [one.look for one in parts], [one.box for one in parts], roots[at], region.box
                )
                mixed = np.tensordot(np.array([one.before for one in parts], np.float32), shares, 1)
                order[at][inside[at]] = mixed[inside[at]]
                continue
            for one in parts:  # the nearest last
                at = one.box.intersection(frame).slices_in(frame)
                order[at][inside[at]] = one.before
        _, nearest = cv2.distanceTransformWithLabels(
            np.isnan(order).astype(np.uint8), cv2.DIST_L2, 3, labelType=cv2.DIST_LABEL_PIXEL
        )
        known = ~np.isnan(order)
        values = np.zeros(int(nearest.max()) + 1, np.float32)
        values[nearest[known]] = order[known]
        return near, values[nearest], meet


def find_moving_foreground(
    again: ReadAgain, scene: Scene, view: View, ground_y: float | None
) -> tuple[MovingForeground | None, Finding]:
    """Look for what moves around an object.

    Args:
        again: reads the shot.
        scene: the object.
        view: how the frames see it.
        ground_y: height of the ground, None for the object's lowest point [scene unit].

    Returns:
        What moves there, None where nothing does or it cannot be told; and why.
    """
    survey, times = _survey(again, view)
    place = _object_place(scene, view, times)
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
    found, steadiness = _follow(again, scene, view, ground_y, small, place, times[-1])
    if found is None or steadiness < CERTAIN:
        reason = "what moves there has no steady outline; give --holdout PATH"
        return None, Finding(reason, certainty=steadiness, threshold=CERTAIN)
    if not found.things:
        return None, Finding("what moves where the object stands is far behind it, or too brief")
    if not any(one.before > 0.0 for things in found.things.values() for one in things):
        return found, _sure("what moves there stays behind the object", certainty)
    reason = f"things move past the object; background known in {certainty:.0%} around it"
    return found, _sure(reason, certainty)


def _survey(again: ReadAgain, view: View) -> tuple[Survey, list[float]]:
    """A first look at the shot, and the moments at which it was read [s]."""
    survey, times, due = Survey((view.width, view.height)), list[float](), -math.inf
    for frame in again(sparse=True):
        if frame.time_s >= due:
            survey.add(frame.picture)
            due = frame.time_s + _EVERY_S
        times.append(frame.time_s)
    return survey, times


def _sure(reason: str, certainty: float) -> Finding:
    return Finding(reason, wanted=True, certainty=certainty, threshold=CERTAIN)


def _object_place(scene: Scene, view: View, times: list[float]) -> Box:
    """Where the object and its shadow are over the shot, inside the frame."""
    place = Box(0, 0, 0, 0)
    step = max(1, math.ceil(len(times) / _SAMPLES))
    for time_s in times[::step]:
        bounds = bounds_near_frame(scene, view, time_s)
        if bounds is not None:
            margin = max(_LEAST_MARGIN_PX, round(_MARGIN * bounds.box.height))
            place = place.union(bounds.box.expanded(margin).intersection(view.box))
    return place


def _follow(
    again: ReadAgain, scene: Scene, view: View, ground_y: float | None, small: SmallBackground,
    place: Box, end_s: float,
) -> tuple[MovingForeground | None, float]:  # fmt: skip
    """The background around the object, and what moves before it; how steadily that goes [1]."""
    large = place.width * place.height > LARGE_PX
    reservoir, tracks = Reservoir(most=FEW_KEPT if large else MOST_KEPT), Tracks()
    scale = view.width / small.noise.shape[1], view.height / small.noise.shape[0]
    for frame in again():
        picture = frame.picture
        roots = root(picture.downsample(*small_size(*small.size)))
        change = gain(roots, small.roots)
        taken = reservoir.takes_next
        reservoir.add(root(picture.linear(place)) / change if taken else None)
        roots = roots / change
        mask = things_mask(roots, small.roots, small.noise)
        things = find_things(mask)
        if not things:
            continue
        camera, contact = _contact(scene, view, ground_y, frame.time_s)
        height = contact[1]
        feet = [
            _disparity(camera, one.foot[0] * scale[0], one.foot[1] * scale[1], height)
            for one in things
        ]
        depth = -float(camera.to_camera(contact[None])[0, 2])
        nearness = 1.0 / depth if depth > 0.0 else math.inf
        tracks.add(frame.index, things, feet, nearness, (roots, mask))
        if frame.index % _CHECKED_EVERY == 0 and frame.time_s > 0.0:
            left = max(0.0, end_s / frame.time_s - 1.0)
            steadiness = tracks.steadiness(small.small(place), left)
            if steadiness < CERTAIN:
                return None, steadiness
    light, noise = reservoir.median()
    background = Background(box=place, roots=light, noise=noise)
    found = MovingForeground(small=small, background=background, things=tracks.ordered())
    return found, tracks.steadiness(small.small(place))


def _contact(
    scene: Scene, view: View, ground_y: float | None, time_s: float
) -> tuple[Camera, np.ndarray]:
    vertices = scene.pose(time_s).vertices()
    return view.camera_at(scene, time_s), contact_point(vertices, ground_y)


def _disparity(camera: Camera, column: float, row: float, ground_y: float) -> float:
    """Disparity of the ground at a place of the frame [1 / scene unit]."""
    x, y = math.floor(column), math.floor(row)
    return float(camera.cropped(Box(x, y, x + 1, y + 1)).plane_disparity(ground_y)[0, 0])
