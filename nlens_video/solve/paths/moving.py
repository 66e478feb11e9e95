"""A part of a shot whose camera turns or moves: keyframes first, then the frames between them."""

from __future__ import annotations

import importlib.util
import math
from collections.abc import Callable
from typing import Literal

import numpy as np
from msgspec import Struct
from msgspec.structs import replace
from scipy.interpolate import PchipInterpolator

from nlens_video.cameras.colmap import FLIP
from nlens_video.core.errors import InputError, UsageError
from nlens_video.core.layers import Float64
from nlens_video.solve.paths.bundle import Bundle, bundle_of, turn_error
from nlens_video.solve.paths.mapping import map_keyframes
from nlens_video.solve.paths.narrow import narrow_bundles
from nlens_video.solve.paths.plane import plane_bundles
from nlens_video.solve.paths.rotation import (
    RotationPath,
    point_directions,
    resect_rotation,
    solve_rotation,
)
from nlens_video.solve.points.evenly import evenly
from nlens_video.solve.points.noise import noise_px
from nlens_video.solve.points.observations import Ints, Observations

_ROTATION_PX = 0.6  # largest median residual of a rotation that is believed
_OF_NOISE = 2.0  # of the tracks' noise, where that is more: compression repeats it over frames
_STEADY_PX = 0.3  # above this the focal length may change
_BETTER = 0.6  # of the residual with one focal length, with one for each keyframe
_WORST_PX = 1.0  # of a reconstruction that is believed
_LEAST_ZOOM = 0.02  # change of the focal length that is no error [1]
_ZOOM_GAIN = 0.8  # of the cost with one focal length
_EXPLAINED = 0.5  # share of the observations that a path explains, unless it is narrow
_LEAST_SEEN = 12  # points that a frame is resected from
_FEWEST_POINTS = 30  # of a frame that shows texture
_SEEN_OFTEN = 3  # keyframes that show a point of a path


class Part(Struct, frozen=True, eq=False):
    """A solved part of a shot, in a world of any scale and axes.

    Attributes:
        kind: whether there is depth; a rotation has its eye at the origin.
        frames: those that are solved, in order (F,).
        poses: world-from-camera matrices (F, 4, 4), glTF's camera axes.
        focals_px: focal lengths (F,) [px].
        focal_error: standard error of the focal length [1].
        focal_noise: its part by noise: what other parts would differ by [1].
        names: points that are solved (P,).
        points: their positions (P, 3), those of a rotation at distance 1.
        residual_px: median distance of an observation from its point [px].
        zooms: whether the focal length changes.
        turn: largest angle between the optical axes of two keyframes [rad].
        distortion: radial coefficient, as of `Bundle` [1].
    """

    kind: Literal["rotation", "moving"]
    frames: list[int]
    poses: Float64
    focals_px: Float64
    focal_error: float
    focal_noise: float
    names: Ints
    points: Float64
    residual_px: float
    zooms: bool
    turn: float
    distortion: float = 0.0


def installed() -> bool:
    """Whether paths can be solved."""
    return importlib.util.find_spec("pycolmap") is not None


def check_installed() -> None:
    """Refuse before any work where pycolmap is missing.

    Raises:
        UsageError: it is not installed.
    """
    if not installed():
        raise UsageError(
            "a camera that moves needs pycolmap; install nlens-video[solve], or give --camera-from"
        )


class PartSolver(Struct, frozen=True):
    """Solves parts of a shot.

    Attributes:
        seen: where points were seen.
        size: columns and rows [px].
        first: number of the first frame in the plate.
    """

    seen: Observations
    size: tuple[int, int]
    first: int = 0

    def solve(self, keyframes: list[int], focal_px: float | None) -> Part | Bundle:
        """Rotation where that explains the keyframes, else structure from motion.

        Args:
            keyframes: at least two, in order.
            focal_px: focal length of the first one where it is known [px].

        Returns:
            A finished rotation, or the keyframes of a path.

        Raises:
            InputError: neither explains what was seen; the message says where.
            UsageError: the camera moves and pycolmap is missing.
        """
        table = self.seen.table(keyframes, fewest=2)
        count = len(keyframes)
        rotation = solve_rotation(table, count, self.size, focal_px)
        if rotation is None or rotation.residual_px > _STEADY_PX:
            zoomed = solve_rotation(table, count, self.size, focal_px, zooms=True)
            if zoomed is not None and _far_better(rotation, zoomed):
                rotation = zoomed
        noise = min(_OF_NOISE * noise_px(self.seen, keyframes[0], keyframes[-1]), _WORST_PX)
        if rotation is not None and rotation.residual_px < max(_ROTATION_PX, noise):
            zooms = float(np.ptp(rotation.focals_px)) > 0.0
            if rotation.residual_px < max(_STEADY_PX, noise) and not zooms or not installed():
                return self.turning(keyframes, rotation)
            # A path through far things, or towards them, looks much like a turn or a zoom.
            bundle = self._bundle(keyframes, focal_px)
            if bundle is None or bundle.residual_px > _BETTER * rotation.residual_px:
                return self.turning(keyframes, rotation)
            return bundle
        check_installed()
        bundle = self._bundle(keyframes, focal_px, narrow=True)
        if bundle is None or bundle.residual_px > _WORST_PX:
            raise InputError(self._why(keyframes))
        return bundle

    def _bundle(
        self, keyframes: list[int], focal_px: float | None, *, narrow: bool = False
    ) -> Bundle | None:
        """Keyframes with one focal length, or one for each where that fits far better.

        Args:
            keyframes: at least two, in order.
            focal_px: focal length of the first one where it is known [px].
            narrow: a path that hardly leaves its place counts too.
        """
        table, count = self.seen.table(keyframes, _SEEN_OFTEN), len(keyframes)
        free = focal_px is None
        structure = map_keyframes(table, count, self.size, focal_px)
        found = []
        if structure is not None:
            found.append(bundle_of(structure, table, self.size, count).adjusted(focal=free))
        found += plane_bundles(table, count, self.size, focal_px)
        if narrow and not any(one.believed().mean() > _EXPLAINED for one in found):
            found += narrow_bundles(table, count, self.size, focal_px)
        if found:
            bundle = min(found, key=lambda one: one.unexplained_px)
            used = bundle.believed()
            zoomed = bundle.adjusted(focal=free, zooms=True, used=used)
            change = float(np.ptp(np.log(zoomed.focals_px)))
            if change < _LEAST_ZOOM or not zoomed.cost(used) < _ZOOM_GAIN * bundle.cost(used):
                return bundle.bent(focal=free)
        structure = map_keyframes(table, count, self.size, focal_px, zooms=True)
        if structure is None:
            return None
        return bundle_of(structure, table, self.size, count).adjusted(focal=free, zooms=True)

    def turning(self, keyframes: list[int], path: RotationPath) -> Part:
        """A rotation's part: all frames from the directions of its points."""
        table = self.seen.table(keyframes, fewest=2)
        directions = point_directions(table, path, self.size)
        taken = np.unique(table.numbers[evenly(table, len(keyframes), self.size)])
        zooms = float(np.ptp(np.log(path.focals_px))) > 0.0
        focal_at = _between(keyframes, path.focals_px)
        frames, poses, focals = [], [], []
        for frame in range(keyframes[0], keyframes[-1] + 1):
            names, pixels = self.seen.frame(frame)
            _, here, there = np.intersect1d(names, table.names[taken], return_indices=True)
            found = resect_rotation(
                directions[taken[there]], pixels[here], self.size, focal_at(frame), zooms=zooms
            )
            if found is not None:
                pose = np.eye(4)
                pose[:3, :3], focal = found
                frames.append(frame)
                poses.append(pose)
                focals.append(focal)
        turn = _largest_turn(path.rotations)
        floor = turn_error(turn, path.focals_px[0] / self.size[0]) if path.focal_error else 0.0
        error = math.hypot(path.focal_error, floor)
        return Part(
            kind="rotation", frames=frames, poses=np.array(poses), focals_px=np.array(focals),
            focal_error=error, focal_noise=error, names=table.names, points=directions,
            residual_px=path.residual_px, zooms=zooms, turn=turn,
        )  # fmt: skip

    def moving(
        self, keyframes: list[int], bundle: Bundle, focal_error: float, focal_noise: float
    ) -> Part:
        """A path's part: the frames between the keyframes by resection."""
        import pycolmap

        solved = bundle.solved
        focal_at = _between([keyframes[n] for n in solved], bundle.focals_px[solved])
        kept = np.flatnonzero(np.isfinite(bundle.points[:, 0]))
        world, names = bundle.points[kept], bundle.table.names[kept]
        poses = {keyframes[n]: bundle.poses[n] for n in solved}
        for frame in range(keyframes[0], keyframes[-1] + 1):
            numbers, pixels = self.seen.frame(frame)
            _, here, there = np.intersect1d(numbers, names, return_indices=True)
            if frame in poses or len(here) < _LEAST_SEEN:
                continue
            near = min(poses, key=lambda key: abs(key - frame))
            refined = pycolmap.refine_absolute_pose(
                pycolmap.Rigid3d((FLIP @ np.linalg.inv(poses[near]))[:3]),
                pixels[here], world[there], np.ones(len(here), bool),
                pycolmap.Camera(
                    model="SIMPLE_RADIAL", width=self.size[0], height=self.size[1],
                    params=[focal_at(frame), self.size[0] / 2, self.size[1] / 2,
                            bundle.distortion],
                ),
            )  # fmt: skip
            if refined is not None:
                matrix = np.eye(4)
                matrix[:3] = refined["cam_from_world"].matrix()
                poses[frame] = np.asarray(np.linalg.inv(FLIP @ matrix))
        frames = sorted(poses)
        return Part(
            kind="moving", frames=frames, poses=np.array([poses[frame] for frame in frames]),
            focals_px=np.array([focal_at(frame) for frame in frames]),
            focal_error=focal_error, focal_noise=focal_noise, names=names, points=world,
            residual_px=bundle.residual_px, zooms=bundle.zooms, turn=bundle_turn(bundle),
            distortion=bundle.distortion,
        )  # fmt: skip

    def focal_errors(self, bundle: Bundle) -> tuple[float, float]:
        """Standard error of a path's focal length, and its part by noise and turn [1]."""
        focal = float(np.median(bundle.focals_px)) / self.size[0]
        noise = math.hypot(bundle.focal_noise(), turn_error(bundle_turn(bundle), focal))
        return (math.hypot(noise, bundle.focal_bias()) if math.isfinite(noise) else noise), noise

    def _why(self, keyframes: list[int]) -> str:
        """Why a part cannot be solved, and where."""
        counts = [len(self.seen.frame(frame)[0]) for frame in keyframes]
        fewest = int(np.argmin(counts))
        start, end = self.first + keyframes[0], self.first + keyframes[-1]
        where = f"frames {start} to {end}: the camera moves, but "
        if counts[fewest] < _FEWEST_POINTS:
            return (
                f"{where}frame {self.first + keyframes[fewest]} shows {counts[fewest]} points that "
                f"can be followed, expected {_FEWEST_POINTS}: little texture, or dark or blurred; "
                "leave these frames out by --range, or give --camera-from"
            )
        return (
            f"{where}no path explains its {min(counts)} to {max(counts)} points: most of the "
            "picture moves by itself, or nothing has depth; give --camera-from"
        )


def bundle_turn(bundle: Bundle) -> float:
    """Largest angle between the optical axes of two keyframes [rad]."""
    return _largest_turn(bundle.poses[bundle.solved, :3, :3])


def with_focal(bundle: Bundle, focal_px: float) -> Bundle:
    """The path with another focal length for all keyframes, adjusted."""
    used = bundle.believed()
    same = replace(bundle, focals_px=np.full_like(bundle.focals_px, np.median(bundle.focals_px)))
    return same.stretched(focal_px).adjusted(focal=False, used=used)


def _largest_turn(rotations: Float64) -> float:
    axes = rotations[:, :, 2]
    return float(np.arccos(np.clip(axes @ axes.T, -1.0, 1.0)).max())


def _far_better(one: RotationPath | None, zoomed: RotationPath) -> bool:
    change = float(np.ptp(np.log(zoomed.focals_px)))
    if one is None:
        return change > _LEAST_ZOOM
    return change > _LEAST_ZOOM and zoomed.residual_px < _BETTER * one.residual_px


def _between(keyframes: list[int], values: Float64) -> Callable[[int], float]:
    """Interpolation of a positive value between keyframes, without overshoot."""
    if len(keyframes) < 2 or not np.ptp(values) > 0.0:
        return lambda frame: float(values[0])
    spline = PchipInterpolator(keyframes, np.log(values))
    return lambda frame: math.exp(float(spline(frame)))
