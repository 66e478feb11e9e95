"""Detection of what moves in front of the object in a shot, in two passes before rendering.

The first pass surveys the background at low resolution: is it at rest, once the camera's motion is
taken out, and does anything move near the object? Only then the second one estimates the clean
plate around the object and tracks what moves. Memory is bounded by the frame size: a few frames are
kept, and some numbers for each target on a frame.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator

import numpy as np

from nlens_video.core.layers import Box
from nlens_video.effects.finding import Finding
from nlens_video.effects.foreground.background import (
    BackgroundModel,
    CleanPlate,
    exposure_gain,
    tells_nothing,
)
from nlens_video.effects.foreground.background_depth import PlaneSweep
from nlens_video.effects.foreground.detection import detect, foreground_mask
from nlens_video.effects.foreground.frame_sampler import (
    LARGE_REGION_PX,
    MAX_FRAMES,
    MAX_FRAMES_LARGE,
    MIN_FRAMES,
    FrameSampler,
)
from nlens_video.effects.foreground.parallax_view import ParallaxView
from nlens_video.effects.foreground.reference_view import ReferenceView, StaticView
from nlens_video.effects.foreground.rotation_view import RotationView
from nlens_video.effects.foreground.survey import (
    SURVEY_INTERVAL_S,
    BackgroundSurvey,
    StaticCameraSurvey,
)
from nlens_video.effects.foreground.tracker import Tracker
from nlens_video.graph.base.context import ReadAgain
from nlens_video.graph.base.view import View
from nlens_video.graph.foreground_matte import MovingForeground
from nlens_video.graph.shot_geometry import ShotGeometry
from nlens_video.kernels.channels import divided_channels
from nlens_video.scene.camera import Camera
from nlens_video.scene.scene import Scene
from nlens_video.scene.scene_light import SceneLight
from nlens_video.video.info import SourceFrame

MIN_CERTAINTY = 0.9
"""Least share of the object's surroundings with a known background, and of steady frames [1]."""
_GEOMETRY_SAMPLES = 12  # times of the shot at which the object's box is looked up
_CHECK_INTERVAL = 12  # frames from one check of the steadiness to the next
_MIN_PARALLAX, _MAX_PARALLAX = 0.0005, 0.15
"""Parallax of the background, by the frame's width [1]: where depth matters; the most allowed."""


def find_moving_foreground(
    again: ReadAgain, scene: Scene, view: View, ground_y: float | None,
    static_survey: StaticCameraSurvey | None = None, light: SceneLight | None = None,
) -> tuple[MovingForeground | None, Finding]:  # fmt: skip
    """Find what moves around an object.

    Args:
        again: reads the shot.
        scene: the object.
        view: how the frames see it.
        ground_y: height of the ground, None for the object's lowest point [scene unit].
        static_survey: survey of the shot for a static camera; default: the shot is read for it.
        light: may hold a known sun; the object's shadow by it belongs to its surroundings.

    Returns:
        What moves there, None where nothing does or it cannot be told; and why.
    """
    geometry = ShotGeometry(scene, view, ground_y, light)
    survey, reference, times = _survey(again, geometry, static_survey)
    object_box = _object_box(geometry, reference, times)
    if _parallax(geometry, times) > _MAX_PARALLAX:
        return None, Finding("the camera travels, and what it sees shifts; give --holdout PATH")
    if survey.frames > 1 and not survey.has_change(object_box):
        return None, Finding("nothing moves where the object stands")
    model = survey.model()
    if model is None:
        return None, Finding("too few frames show the background")
    if not survey.is_static(model):
        return None, Finding(
            "the camera moves, or most of the picture changes; give --holdout PATH"
        )
    certainty = model.certainty(object_box)
    if certainty < MIN_CERTAINTY:
        reason = f"only {certainty:.0%} of the background around the object is known"
        return None, Finding(
            f"{reason}; give --holdout PATH", certainty=certainty, threshold=MIN_CERTAINTY
        )
    if not model.has_motion(object_box):
        return None, Finding("nothing moves where the object stands")
    found, steadiness = _track(again, geometry, reference, model, object_box, times)
    if found is None or steadiness < MIN_CERTAINTY:
        reason = "what moves there has no steady outline; give --holdout PATH"
        return None, Finding(reason, certainty=steadiness, threshold=MIN_CERTAINTY)
    if not found.states:
        return None, Finding("what moves where the object stands is far behind it, or too brief")
    if not any(one.in_front > 0.0 for states in found.states.values() for one in states):
        return found, _wanted("what moves there stays behind the object", certainty)
    reason = f"things move past the object; background known in {certainty:.0%} around it"
    return found, _wanted(reason, certainty)


def _wanted(reason: str, certainty: float) -> Finding:
    return Finding(reason, wanted=True, certainty=certainty, threshold=MIN_CERTAINTY)


def _survey(
    again: ReadAgain, geometry: ShotGeometry, static_survey: StaticCameraSurvey | None
) -> tuple[BackgroundSurvey, ReferenceView, list[float]]:
    """Background survey of the shot, its reference view, and the times of the frames read [s]."""
    if static_survey is None:
        static_survey = StaticCameraSurvey((geometry.view.width, geometry.view.height))
        for frame in again(sparse=True):
            static_survey.see(frame)
            if not geometry.is_static((static_survey.times[0], frame.time_s)):
                break
    if not geometry.is_static(static_survey.times):
        return _survey_moving(again, geometry)
    return static_survey.survey, static_survey.reference, static_survey.times


def _survey_moving(
    again: ReadAgain, geometry: ShotGeometry
) -> tuple[BackgroundSurvey, ReferenceView, list[float]]:
    """The same for a camera that moves, from the frames that show the object."""
    reference: RotationView | None = None
    sweep, times = PlaneSweep(), list[float]()
    survey = BackgroundSurvey((geometry.view.width, geometry.view.height))
    for frame in _survey_frames(again, geometry, times):
        camera = geometry.camera(frame.time_s)
        if reference is None:
            reference = geometry.reference_view(frame.time_s)
            survey = BackgroundSurvey(reference.size)
        eye = camera.world_from_camera[:3, 3]
        roots = reference.at_eye(eye).warp_lowres(frame.picture, camera)
        if survey.add(roots):
            sweep.add(roots, eye)
    if reference is None:
        return survey, StaticView((geometry.view.width, geometry.view.height)), times
    if not _MIN_PARALLAX < _parallax(geometry, times) <= _MAX_PARALLAX:
        return survey, reference, times
    contact = geometry.contact(times[0])
    central = reference.at_eye(sweep.central_eye)
    lowres = central.camera.resized(*reference.lowres_size)
    with_depth = ParallaxView.from_disparity(central, sweep.disparity(lowres, contact))
    survey = BackgroundSurvey(reference.size)
    for frame in _survey_frames(again, geometry, []):
        survey.add(with_depth.register_lowres(frame.picture, geometry.camera(frame.time_s)))
    return survey, with_depth, times


def _survey_frames(
    again: ReadAgain, geometry: ShotGeometry, times: list[float]
) -> Iterator[SourceFrame]:
    """Frames of a survey, those that show the object; adds the times of all that were read [s]."""
    due = -math.inf
    for frame in again(sparse=True):
        times.append(frame.time_s)
        if frame.time_s < due:
            continue
        due = frame.time_s + SURVEY_INTERVAL_S
        if not geometry.object_box(frame.time_s).empty:
            yield frame


def _parallax(geometry: ShotGeometry, times: list[float]) -> float:
    """Parallax over the shot between the object's place and infinity, by the frame's width [1]."""
    step = max(1, math.ceil(len(times) / _GEOMETRY_SAMPLES))
    shown = [one for one in times[::step] if not geometry.object_box(one).empty]
    if not shown:
        return 0.0
    eyes = np.array([geometry.camera(one).world_from_camera[:3, 3] for one in shown])
    travel = float(np.linalg.norm(np.ptp(eyes, axis=0)))
    distance = np.linalg.norm(geometry.contact(shown[0]) - eyes[0])
    camera = geometry.camera(shown[0])
    return camera.fx * travel / max(float(distance), 1e-9) / camera.width


def _object_box(geometry: ShotGeometry, reference: ReferenceView, times: list[float]) -> Box:
    """Bounding box in the reference view of the object and its surroundings over the shot."""
    return _box_over_shot(geometry, reference, times, geometry.object_box)


def _box_over_shot(
    geometry: ShotGeometry, reference: ReferenceView, times: list[float],
    box_at: Callable[[float], Box],
) -> Box:  # fmt: skip
    """Bounding box in the reference view of a box of the frames that depends on time."""
    whole = Box(0, 0, 0, 0)
    step = max(1, math.ceil(len(times) / _GEOMETRY_SAMPLES))
    for time_s in times[::step]:
        box = box_at(time_s)
        if not box.empty:
            whole = whole.union(reference.box_in_reference(box, geometry.camera(time_s)))
    return whole


def _track(
    again: ReadAgain, geometry: ShotGeometry, reference: ReferenceView, model: BackgroundModel,
    object_box: Box, times: list[float],
) -> tuple[MovingForeground | None, float]:  # fmt: skip
    """The second pass: clean plate and tracks; None where these are not steady; steadiness [1]."""
    wide = object_box.union(_box_over_shot(geometry, reference, times, geometry.shadow_box))
    is_large = wide.width * wide.height > LARGE_REGION_PX
    sampler = FrameSampler(max_frames=MAX_FRAMES_LARGE if is_large else MAX_FRAMES)
    tracker = Tracker()
    full, low = reference.size, reference.lowres_size
    scale = full[0] / low[0], full[1] / low[1]
    cameras: dict[int, Camera] = {}
    for frame in again():
        picture, camera = frame.picture, geometry.camera(frame.time_s)
        if reference.box_in_frame(wide, camera).empty:
            continue
        roots = reference.warp_lowres(picture, camera)
        background = reference.render_background(model, camera)
        if tells_nothing(roots, background.roots):
            cameras[frame.index] = camera
            tracker.skip(frame.index)
            continue
        is_sampled = sampler.takes_next
        gain = exposure_gain(roots, background.roots)
        sampler.add(
            divided_channels(reference.register_box(picture, camera, wide), gain)
            if is_sampled
            else None
        )
        valid = ~np.isnan(roots[..., 0])
        roots = background.normalised(roots, gain)
        mask = foreground_mask(roots, background.roots, background.noise)
        detections = detect(mask, valid)
        if not detections:
            continue
        cameras[frame.index] = camera
        contact = geometry.contact(frame.time_s)
        feet = [
            reference.ground_disparity(
                (one.foot[0] * scale[0], one.foot[1] * scale[1]), camera, float(contact[1])
            )
            for one in detections
        ]
        depth = -float(camera.to_camera(contact[None])[0, 2])
        contact_disparity = 1.0 / depth if depth > 0.0 else math.inf
        tracker.add(frame.index, detections, feet, contact_disparity, (roots, mask))
        if frame.index % _CHECK_INTERVAL == 0 and frame.time_s > 0.0:
            remaining = max(0.0, times[-1] / frame.time_s - 1.0)
            steadiness = tracker.steadiness(model.lowres_box(object_box), remaining)
            if steadiness < MIN_CERTAINTY:
                return None, steadiness
    roots, noise = sampler.median()
    roots[sampler.valid_counts < MIN_FRAMES] = np.nan
    found = MovingForeground(
        reference=reference, model=model,
        clean_plate=CleanPlate(box=wide, roots=roots, noise=noise),
        states=tracker.states(), cameras=cameras,
    )  # fmt: skip
    return found, tracker.steadiness(model.lowres_box(object_box))
