"""The camera of a plate: still, turning on the spot or moving, from its pictures alone."""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

import numpy as np
import numpy.typing as npt
from scipy.spatial.transform import Rotation

from nlens_video.cameras.ground import fit_ground, ground_frame
from nlens_video.cameras.solved import CameraErrors, CameraKey, FovSource, PathKind, SolvedCamera
from nlens_video.core.errors import InputError
from nlens_video.core.layers import Float64
from nlens_video.solve.moving import MovingPath, solve_moving
from nlens_video.solve.rotation import RotationPath, resect_rotations, solve_rotation
from nlens_video.solve.segments import Segments, find_segments
from nlens_video.solve.tracks import Tracker
from nlens_video.solve.vanishing import FOCAL_PRIOR, Horizon, Mixture

EYE_HEIGHT = 1.6
"""Height of the first camera above the ground where no scale is known [scene unit]."""
_STILL_PX = 0.75
_ROTATION_PX = 0.6
_WORST_PX = 1.0  # of a reconstruction that is believed
_KEYFRAMES = 13
_FOV_MEASURED = 0.08  # largest standard error of a focal length that counts as measured [1]
_PITCH_MEASURED, _ROLL_MEASURED = math.radians(3.0), math.radians(1.5)
_GROUND_ERROR_DEG = 0.5


@dataclass(frozen=True, slots=True)
class KnownFov:
    """A field of view that need not be measured.

    Attributes:
        focal: focal length by the frame's width [1].
        error: its relative standard error [1].
        given: by the user, else by the file's metadata.
    """

    focal: float
    error: float
    given: bool


@dataclass(slots=True)
class ShotSolver:
    """Takes a shot's pictures one by one, then solves its camera.

    Attributes:
        size: columns and rows [px].
        known: field of view from metadata or the user, None to measure it.
        every: keyframes lie at least this many frames apart, 0 for a number by the shot's length.
    """

    size: tuple[int, int]
    known: KnownFov | None = None
    every: int = 0
    _tracker: Tracker = field(default_factory=Tracker)
    _times: list[float] = field(default_factory=list)
    _segments: Segments | None = None

    def add(self, luma: npt.NDArray[np.uint8], pts_s: float) -> None:
        """Take the next picture (H, W) and its time [s]."""
        if self._segments is None:
            self._segments = find_segments(luma)
        self._tracker.add(luma)
        self._times.append(pts_s)

    def solve(self) -> SolvedCamera:
        """The camera of the pictures so far.

        Raises:
            InputError: there was no picture.
            UsageError: the camera moves and pycolmap is missing.
        """
        if self._segments is None:
            raise InputError("no picture to solve the camera from")
        tracks = self._tracker.long_tracks()
        if self._motion(tracks) < _STILL_PX:
            return self._still()
        frames = list(range(len(self._times)))
        keyframes = self._keyframes()
        width = self.size[0]
        focal = None if self.known is None else self.known.focal * width
        rotation = solve_rotation(tracks, keyframes, self.size, focal)
        if rotation is not None and rotation.residual_px < _ROTATION_PX:
            turns = resect_rotations(tracks, keyframes, frames, rotation, self.size)
            return self._turning(rotation, turns)
        moving = solve_moving(tracks, keyframes, frames, self.size, focal)
        if focal is None and (moving is None or not _tells_focal(moving)):
            # A straight path without a turn fits any focal length: take that of the still picture.
            focal = math.exp(self._horizon().log_focal) * width
            moving = solve_moving(tracks, keyframes, frames, self.size, focal)
        if moving is None or moving.residual_px > _WORST_PX:
            raise InputError(
                f"the camera moves, but its path cannot be solved from {len(tracks)} tracked "
                "points: too little texture, or too much of the picture moves; give --camera-from"
            )
        return self._moving(moving)

    def _motion(self, tracks: list[dict[int, npt.NDArray[np.float32]]]) -> float:
        """How far the middle track strays from where it began [px]."""
        if not tracks:
            return 0.0
        strayed = []
        for track in tracks:
            points = np.array(list(track.values()))
            strayed.append(float(np.linalg.norm(points - points[0], axis=1).max()))
        return float(np.median(strayed))

    def _keyframes(self) -> list[int]:
        last = len(self._times) - 1
        step = self.every or max(1, math.ceil(last / (_KEYFRAMES - 1)))
        return sorted({*range(0, last + 1, step), last})

    def _horizon(self, focal: tuple[float, float] | None = None) -> Horizon:
        """Attitude of the first picture, with a focal length that is known to an error."""
        assert self._segments is not None
        if focal is None and self.known is not None:
            focal = math.log(self.known.focal), max(self.known.error, 1e-3)
        return Mixture(self._segments, self.size, focal or FOCAL_PRIOR).solve()

    def _still(self) -> SolvedCamera:
        horizon = self._horizon()
        return self._solved(
            [_pose(horizon)], horizon, path="still", focal=math.exp(horizon.log_focal),
            method="vanishing points",
        )  # fmt: skip

    def _turning(self, rotation: RotationPath, turns: Float64) -> SolvedCamera:
        focal = rotation.focal_px / self.size[0]
        error = max(rotation.focal_stderr_px / rotation.focal_px, 1e-3)
        horizon = self._horizon((math.log(focal), error))
        first = _pose(horizon)
        poses = []
        for turn in turns:
            pose = first.copy()
            pose[:3, :3] = first[:3, :3] @ turn
            poses.append(pose)
        return self._solved(
            poses, horizon, path="rotation", focal=focal, method="rotation and vanishing points"
        )

    def _moving(self, path: MovingPath) -> SolvedCamera:
        focal = path.focal_px / self.size[0]
        error = path.focal_stderr_px / path.focal_px
        poses = np.array(list(path.poses.values()))
        ground = fit_ground(path.points, poses)
        if ground is None:
            raise InputError(
                f"the camera's path is solved, but no ground is found among {len(path.points)} "
                "points: expected a plane below the camera; give --camera-from"
            )
        horizon = self._horizon((math.log(focal), max(error, 1e-3)) if error > 0.0 else None)
        covariance = horizon.covariance.copy()
        covariance[:2, :2] = np.eye(2) * math.radians(_GROUND_ERROR_DEG) ** 2
        horizon = replace(horizon, covariance=covariance, share=1.0)
        level = ground_frame(*ground, poses[0], EYE_HEIGHT)
        scale = float(np.cbrt(np.linalg.det(level[:3, :3])))
        turned = level @ poses
        turned[:, :3, :3] /= scale
        return self._solved(
            list(turned), horizon, path="moving", focal=focal, method="structure from motion",
            frames=list(path.poses),
        )  # fmt: skip

    def _solved(
        self, poses: list[Float64], horizon: Horizon, *, path: PathKind, focal: float, method: str,
        frames: list[int] | None = None,
    ) -> SolvedCamera:  # fmt: skip
        """The camera with the sources and errors of its values."""
        errors = np.sqrt(np.diag(horizon.covariance))
        fov = 2.0 * math.degrees(math.atan(0.5 / focal))
        sure = errors[0] < _PITCH_MEASURED and errors[1] < _ROLL_MEASURED and horizon.share > 0.5
        source: FovSource = "measured" if errors[2] < _FOV_MEASURED else "assumed"
        if self.known is not None:
            source = "metadata"
        return SolvedCamera(
            width=self.size[0],
            height=self.size[1],
            keys=tuple(
                CameraKey(
                    index=frame, pts_s=self._times[frame],
                    world_to_camera=np.asarray(np.linalg.inv(pose)), fov_x_deg=fov,
                )
                for frame, pose in zip(frames or range(len(poses)), poses, strict=True)
            ),
            fov=source,
            horizon="measured" if sure else "assumed",
            path=path,
            errors=CameraErrors(
                # d fov / d log focal = -sin(fov)
                fov_deg=math.degrees(math.sin(math.radians(fov)) * float(errors[2])),
                pitch_deg=math.degrees(errors[0]),
                roll_deg=math.degrees(errors[1]),
            ),
            method=method,
        )  # fmt: skip


def _tells_focal(path: MovingPath) -> bool:
    """Whether a path measures the focal length."""
    return path.focal_stderr_px < _FOV_MEASURED * path.focal_px


def _pose(horizon: Horizon) -> Float64:
    """World-from-camera matrix (4, 4) of a camera at eye height that looks along -Z."""
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_euler("XZ", [horizon.pitch, horizon.roll]).as_matrix()
    pose[1, 3] = EYE_HEIGHT
    return pose
