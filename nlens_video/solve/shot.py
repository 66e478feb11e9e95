"""The camera of a plate: still, turning on the spot or moving, from its pictures alone."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
import numpy.typing as npt
from msgspec.structs import replace

from nlens_video.cameras.ground import fit_ground, ground_frame
from nlens_video.cameras.solved import CameraKey, PathKind, SolvedCamera
from nlens_video.core.errors import InputError
from nlens_video.core.layers import Bool, CocMap, Float64
from nlens_video.solve.focal import MOST_POOLED, KnownFov, focal_of_scene, product, turned_segments
from nlens_video.solve.paths.bundle import Bundle
from nlens_video.solve.paths.given_focal import told_against, without_fov
from nlens_video.solve.paths.joining import Joined, parts_of
from nlens_video.solve.paths.moving import Part, PartSolver, bundle_turn, with_focal
from nlens_video.solve.paths.moving_areas import beside_areas, moving_areas
from nlens_video.solve.paths.standing_planes import standing_planes
from nlens_video.solve.paths.turn_axis import TurningPrior, turn_axis
from nlens_video.solve.points.observations import Observations
from nlens_video.solve.sources import (
    FOV_MEASURED,
    errors_of_path,
    fov_of_focal,
    fov_with_error,
    method_of,
    with_sources,
)
from nlens_video.solve.still.ground_blur import GroundBlur, fit_ground_blur
from nlens_video.solve.still.picture_cue import PictureCue
from nlens_video.solve.still.prior import FOCAL_PRIOR, CameraPrior
from nlens_video.solve.still.segments import NO_SEGMENTS, Segments, find_segments, pooled
from nlens_video.solve.still.vanishing import Horizon, Mixture
from nlens_video.solve.tracks import Tracker

Cue = Literal["lines", "blur", "picture"]
"""What tells the attitude of a still camera, or of one that turns."""
CUES: tuple[Cue, ...] = ("lines", "blur", "picture")
EYE_HEIGHT = 1.6
"""Height of the first camera above the ground where no scale is known [scene unit]."""
_FOV_KNOWN = 0.015  # error of a focal length by noise that the next parts take over [1]
_STRAIGHT = math.radians(1.0)  # turn of a path whose pictures share their vanishing points
_POOLED, _EVERY_OTHER = 6, 2  # pictures whose lines are pooled, at most; of a path's, for time


@dataclass(slots=True)
class ShotSolver:
    """Takes a shot's pictures one by one, then solves its camera.

    Attributes:
        size: columns and rows [px].
        known: field of view from metadata or the user, None to measure it.
        first: number of the first picture in the plate.
        every: keyframes lie at least this many frames apart, 0 for a number by the shot's length.
        coc: reads the blur of the first picture, which tells of the ground; None to leave it out.
        picture: what the first picture looks like it was taken by; None to leave it out.
        lines: whether line segments tell the camera too.
        ignored: ends of segments of the first picture (N, 2, 2), along which no line tells the
            camera [px].
    """

    size: tuple[int, int]
    known: KnownFov | None = None
    first: int = 0
    every: int = 0
    coc: Callable[[], CocMap] | None = None
    picture: Callable[[], PictureCue] | None = None
    lines: bool = True
    ignored: Float64 = field(default_factory=lambda: np.zeros((0, 2, 2)))
    _tracker: Tracker = field(default_factory=Tracker)
    _times: list[float] = field(default_factory=list)
    _lines: Segments | None = None
    _pictures: dict[int, npt.NDArray[np.uint8]] = field(default_factory=dict)
    _apart: int = 1
    _told: tuple[float, float] | None = None  # against the given field of view, and its error [deg]

    @property
    def seen(self) -> Observations:
        """Where points were seen."""
        return self._tracker.observations

    @property
    def times_s(self) -> list[float]:
        """Times of the pictures [s]."""
        return self._times

    @property
    def segments(self) -> Segments:
        """Those of `shown` that may tell the camera."""
        return self.shown.without(self.ignored, self.size[0])

    @property
    def shown(self) -> Segments:
        """Line segments of the first picture; of several's median where the camera is still."""
        if self._lines is None and self.lines:
            pictures = list(self._pictures.values())[: 1 if self._tracker.moves else None]
            self._lines = find_segments(np.median(pictures, axis=0).astype(np.uint8))
        return self._lines or NO_SEGMENTS

    def add(self, luma: npt.NDArray[np.uint8], pts_s: float) -> None:
        """Take the next picture (H, W) and its time [s]."""
        index = len(self._times)
        self._tracker.add(luma)
        self._times.append(pts_s)
        if index % self._apart == 0:
            self._pictures[index] = luma
            if len(self._pictures) > _POOLED:
                self._apart *= 2
                for one in [one for one in self._pictures if one % self._apart]:
                    del self._pictures[one]

    def solve(self) -> SolvedCamera:
        """The camera of the pictures so far.

        Raises:
            InputError: there was no picture, or no path explains them.
            UsageError: the camera moves and pycolmap is missing.
        """
        if not self._times:
            raise InputError("no picture to solve the camera from")
        if self._tracker.cut is not None:
            cut = self.first + self._tracker.cut
            raise InputError(
                f"frame {cut}: another shot begins, and a camera is of one shot; give --range "
                f"{self.first}:{cut} or --range {cut}:"
            )
        if len(self._times) == 1 or not self._tracker.moves:
            return self._still()
        # What the user gives is kept; a tag, which knows no crop, yields to a better measurement.
        focal = self.known.focal * self.size[0] if self.known and self.known.given else None
        solver = PartSolver(self.seen, self.size, self.first)
        joined = None
        for keyframes in parts_of(self._tracker.steps_px, self.size[0], self.every):
            known = focal
            if joined is not None and joined.last.zooms:  # its first frame has another one
                known = joined.zoomed_focal_px(keyframes[0])
            if joined is None and focal is not None:
                told = told_against(solver, keyframes, focal, FOV_MEASURED)
                self._told = told and fov_with_error(*told)
            part = self._part(solver, keyframes, known)
            if joined is None:
                joined, error = Joined.begun(part), part.focal_error
            else:
                joined.add(part)
            if focal is None and part.focal_noise < _FOV_KNOWN and not part.zooms:
                focal = float(np.median(part.focals_px))
        assert joined is not None
        return self._moving(joined, error) if joined.depth else self._turning(joined, error)

    def _part(self, solver: PartSolver, keyframes: list[int], focal_px: float | None) -> Part:
        """A part of the shot, with a focal length from lines where its path tells none."""
        found = solver.solve(keyframes, focal_px)
        if isinstance(found, Part):
            if found.focal_error < min(FOV_MEASURED, self._focal_prior()[1]):
                return found
            prior = math.log(found.focals_px[0] / self.size[0]), found.focal_error
            still = self._horizon(self.segments, product(prior, self._focal_prior()))
            again = solver.solve(keyframes, math.exp(still.log_focal) * self.size[0])
            if isinstance(again, Part):
                error = math.sqrt(still.covariance[2, 2])
                return replace(again, focal_error=error, focal_noise=error)
            return found
        error, noise = (0.0, 0.0) if focal_px is not None else solver.focal_errors(found)
        if error > min(_FOV_KNOWN, self._focal_prior()[1]) and not found.zooms:
            found, error = self._with_focal(keyframes, found, error)
        return solver.moving(keyframes, found, error, min(error, noise))

    def _with_focal(self, keyframes: list[int], path: Bundle, error: float) -> tuple[Bundle, float]:
        """A path with the focal length that its scene tells, and its error [1]."""
        width = self.size[0]
        focal = float(np.median(path.focals_px)) / width
        prior = product((math.log(focal), error), self._focal_prior())
        places = path.solved
        ground = fit_ground(path.points[np.isfinite(path.points[:, 0])], path.poses[places])
        first = path.poses[places[0]]
        shown = {keyframes[place]: path.poses[place] for place in places}
        turned = {
            frame: first[:3, :3].T @ shown[min(shown, key=lambda key: abs(key - frame))][:3, :3]
            for frame in self._pictures
            if keyframes[0] <= frame <= keyframes[-1]
        }
        # Turned segments depend on the focal length: a path that turns takes one picture.
        taken = slice(1) if bundle_turn(path) > _STRAIGHT else slice(0, None, _EVERY_OTHER)
        turned = dict(list(turned.items())[taken])
        if not turned:
            return path, error
        pictures = self._segments(turned, focal)
        if ground is None:
            found = self._horizon(pooled(pictures, MOST_POOLED), prior)
            log, error = found.log_focal, math.sqrt(found.covariance[2, 2])
        else:
            normal = first[:3, :3].T @ ground[0]
            standing = standing_planes(path, ground)
            log, error = focal_of_scene(pictures, self.size, normal, focal, prior, standing)
        return with_focal(path, math.exp(log) * width), error

    def _segments(
        self, turned: dict[int, Float64], focal: float, moving: dict[int, Bool] | None = None
    ) -> list[Segments]:
        """Line segments of some pictures in the axes of the first frame, of what stands still."""
        pictures = []
        for frame, turn in turned.items():
            found = find_segments(self._pictures[frame])
            found = beside_areas(found, moving[frame]) if moving else found
            found = turned_segments(found, turn, focal, self.size)
            pictures.append(found.without(self.ignored, self.size[0]))
        return pictures

    def _horizon(self, segments: Segments, focal: tuple[float, float]) -> Horizon:
        """Attitude of the first picture, with a focal length that is known to an error."""
        return Mixture(segments, self.size, CameraPrior(focal)).solve()

    def _cues(self) -> tuple[GroundBlur | None, PictureCue | None]:
        """What blur and looks of the first picture tell, None for what tells nothing."""
        blur = None if self.coc is None else fit_ground_blur(self.coc())
        return blur, None if self.picture is None else self.picture()

    def _focal_prior(self) -> tuple[float, float]:
        """Logarithm of the focal length by the frame's width, and its spread, before measuring."""
        if self.known is None:
            return FOCAL_PRIOR
        return math.log(self.known.focal), max(self.known.error, 1e-3)

    def _still(self) -> SolvedCamera:
        prior = CameraPrior(self._focal_prior(), *self._cues())
        horizon = Mixture(self.segments, self.size, prior).solve()
        errors = np.sqrt(np.diag(horizon.covariance))
        return self._outcome(
            [0], [horizon.pose(EYE_HEIGHT)], [math.exp(horizon.log_focal)], errors, path="still",
            method=method_of("vanishing points", prior),
        )  # fmt: skip

    def _turning(self, path: Joined, error: float) -> SolvedCamera:
        width = self.size[0]
        place = {frame: n for n, frame in enumerate(path.frames)}
        turns = np.array([pose[:3, :3] for pose in path.poses])
        first = turns[0]
        turned = {
            frame: first.T @ turns[place[frame]] for frame in self._pictures if frame in place
        }
        focal = path.focals_px[0] / width
        prior = TurningPrior(
            (math.log(focal), max(error, 1e-3)), *self._cues(),
            turn_axis(first.T @ turns),
        )  # fmt: skip
        focals = {frame: path.focals_px[place[frame]] for frame in turned}
        moving = moving_areas({frame: self._pictures[frame] for frame in turned}, turned, focals)
        lines = pooled(self._segments(turned, focal, moving), MOST_POOLED)
        horizon = Mixture(lines, self.size, prior).solve()
        errors = np.sqrt(np.diag(horizon.covariance))
        errors[2] = max(error, 1e-3)
        poses = np.repeat(horizon.pose(EYE_HEIGHT)[None], len(turns), axis=0)
        poses[:, :3, :3] = poses[:, :3, :3] @ first.T @ turns
        return self._outcome(
            path.frames, list(poses), [one / width for one in path.focals_px], errors,
            path="rotation", method=method_of("rotation, vanishing points", prior),
        )  # fmt: skip

    def _moving(self, path: Joined, error: float) -> SolvedCamera:
        poses = np.array(path.poses)
        ground = fit_ground(path.ground, poses[: path.ground_frames])
        if ground is None:
            advice = without_fov(self._told) if self.known and self.known.given else ""
            raise InputError(
                f"the camera's path is solved, but no ground is found among {len(path.ground)} "
                f"points: expected a plane below the camera; {advice}give --camera-from"
            )
        level = ground_frame(*ground, poses[0], EYE_HEIGHT)
        scale = float(np.cbrt(np.linalg.det(level[:3, :3])))
        turned = level @ poses
        turned[:, :3, :3] /= scale
        errors = errors_of_path(math.asin(float(turned[0, 1, 2])), max(error, 1e-3))
        camera = self._outcome(
            path.frames, list(turned), [one / self.size[0] for one in path.focals_px], errors,
            path="moving", method="structure from motion",
        )  # fmt: skip
        points = path.ground @ level[:3, :3].T + level[:3, 3]
        return replace(camera, points=points, distortion_k1=path.distortion)

    def _outcome(
        self, frames: list[int], poses: list[Float64], focals: list[float], errors: Float64, *,
        path: PathKind, method: str,
    ) -> SolvedCamera:  # fmt: skip
        keys = tuple(
            CameraKey(
                index=frame, pts_s=self._times[frame],
                world_to_camera=np.asarray(np.linalg.inv(pose)), fov_x_deg=fov_of_focal(focal),
            )
            for frame, pose, focal in zip(frames, poses, focals, strict=True)
        )  # fmt: skip
        camera = with_sources(self.size, keys, errors, self.known, path=path, method=method)
        return replace(camera, fov_told_deg=self._told)
