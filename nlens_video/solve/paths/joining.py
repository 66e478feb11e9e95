"""Parts of a shot put together: each begins with frames that end the one before."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from msgspec.structs import replace
from scipy.spatial.transform import Rotation

from nlens_video.cameras.ground import fit_ground
from nlens_video.core.errors import InputError
from nlens_video.core.layers import Float64
from nlens_video.solve.paths.moving import Part

_KEYFRAMES = 13  # of a part
_OVERLAP = 4  # keyframes that two parts share
_SPACING = 0.03  # way of the middle point from one keyframe to the next, at most [frame width]
_LONGEST = 48  # frames from one keyframe to the next
_FEWEST = 12  # points that two parts share


def parts_of(steps_px: list[float], width: int, every: int = 0) -> list[list[int]]:
    """Keyframes of each part of a shot, evenly along the way of its points.

    Args:
        steps_px: how far the middle point moved into each frame [px].
        width: of the frame [px].
        every: frames from one keyframe to the next, 0 by the points' way.
    """
    last = len(steps_px) - 1
    if every:
        keyframes = sorted({*range(0, last + 1, every), last})
    else:
        way = np.cumsum(steps_px)
        # An even share of the frames counts too: a camera that rests is seen as often.
        way = way / max(way[-1], 1e-9) + np.linspace(0.0, 1.0, last + 1) * 0.5
        count = max(
            _KEYFRAMES - 1, int(np.ceil(np.sum(steps_px) / (_SPACING * width))), last // _LONGEST
        )
        marks = np.linspace(way[0], way[-1], count + 1)
        keyframes = sorted({int(n) for n in np.clip(np.searchsorted(way, marks), 0, last)})
    step = _KEYFRAMES - _OVERLAP
    # What is left at the end is no part of its own where it is small.
    starts = range(0, max(1, len(keyframes) - _KEYFRAMES + step // 2), step)
    parts = [keyframes[start : start + _KEYFRAMES] for start in starts]
    parts[-1] = keyframes[starts[-1] :]
    return parts


@dataclass(slots=True)
class Joined:
    """A path put together part by part, in the world of its first part.

    Attributes:
        frames: those that are solved, in order.
        poses: world-from-camera matrices, one for each.
        focals_px: focal lengths, one for each [px].
        ground: points of the first part with depth, by which the ground is found (P, 3).
        ground_frames: how many frames there are up to its end.
        last: the newest part, in this world.
        depth: the newest part with depth, in this world.
        distortion: radial coefficient of the first part with depth [1].
    """

    frames: list[int]
    poses: list[Float64]
    focals_px: list[float]
    ground: Float64
    ground_frames: int
    last: Part
    depth: Part | None
    distortion: float

    @classmethod
    def begun(cls, part: Part) -> Joined:
        """A path of one part."""
        moving = part.kind == "moving"
        return cls(
            list(part.frames), list(part.poses), list(part.focals_px),
            part.points if moving else np.zeros((0, 3)), len(part.frames), part,
            part if moving else None, part.distortion,
        )  # fmt: skip

    def zoomed_focal_px(self, frame: int) -> float | None:
        """Focal length on a frame where the next part begins, None without a zoom on the spot [px].

        Each part of a turn tells it anew, with another error, and the ground would slip between.
        """
        if self.last.kind != "rotation" or not self.last.zooms or frame not in self.frames:
            return None
        return self.focals_px[self.frames.index(frame)]

    def add(self, part: Part) -> None:
        """Put the next part behind, blended over the frames that both hold.

        Raises:
            InputError: there is no such frame.
        """
        place = {frame: n for n, frame in enumerate(self.frames)}
        both = [(place[frame], n) for n, frame in enumerate(part.frames) if frame in place]
        if not both:
            raise InputError(
                f"frame {part.frames[0]}: the camera's path is lost here; leave the frames before "
                "or behind it out by --range"
            )
        part = self._fitted(part, np.array([self.poses[n] for n, _ in both]), [n for _, n in both])
        for step, (before, now) in enumerate(both):
            share = (step + 1.0) / (len(both) + 1.0)
            self.poses[before] = _blended(self.poses[before], part.poses[now], share)
            self.focals_px[before] = float(
                self.focals_px[before] ** (1.0 - share) * part.focals_px[now] ** share
            )
        start = both[-1][1] + 1
        self.frames += part.frames[start:]
        self.poses += list(part.poses[start:])
        self.focals_px += list(part.focals_px[start:])
        self.last = part
        if part.kind == "moving":
            if self.depth is None:
                self.ground, self.ground_frames = part.points, len(self.frames)
                self.distortion = part.distortion
            self.depth = part

    def _fitted(self, part: Part, before: Float64, now: list[int]) -> Part:
        """The part in this path's world."""
        own = part.poses[now]
        turns = before[:, :3, :3] @ own[:, :3, :3].swapaxes(1, 2)
        turn = Rotation.from_matrix(turns).mean().as_matrix()
        scale = self._scale(part, before, own) if part.kind == "moving" else 1.0
        shift = (before[:, :3, 3] - scale * own[:, :3, 3] @ turn.T).mean(axis=0)
        poses = part.poses.copy()
        poses[:, :3, :3] = turn @ poses[:, :3, :3]
        poses[:, :3, 3] = scale * poses[:, :3, 3] @ turn.T + shift
        return replace(part, poses=poses, points=scale * part.points @ turn.T + shift)

    def _scale(self, part: Part, before: Float64, own: Float64) -> float:
        """This path's unit by that of a part: from the distances of points that both hold."""
        if self.depth is None:
            return 1.0
        _, first, second = np.intersect1d(self.depth.names, part.names, return_indices=True)
        if len(first) >= _FEWEST:
            far = self.depth.points[first, None] - before[None, :, :3, 3]
            near = part.points[second, None] - own[None, :, :3, 3]
            return float(np.median(np.linalg.norm(far, axis=2) / np.linalg.norm(near, axis=2)))
        # The camera only turned in between: it is as high above the ground as it was.
        was, now = _height(self.depth, -1), _height(part, 0)
        return 1.0 if was is None or now is None else was / now


def _height(part: Part, frame: int) -> float | None:
    ground = fit_ground(part.points, part.poses)
    return None if ground is None else float(ground[0] @ part.poses[frame, :3, 3] - ground[1])


def _blended(first: Float64, second: Float64, share: float) -> Float64:
    turn = Rotation.from_matrix(first[:3, :3].T @ second[:3, :3]).as_rotvec()
    pose = np.eye(4)
    pose[:3, :3] = first[:3, :3] @ Rotation.from_rotvec(share * turn).as_matrix()
    pose[:3, 3] = (1.0 - share) * first[:3, 3] + share * second[:3, 3]
    return pose
