"""How well a solved camera explains what it was solved from: tracked points and line segments."""

from __future__ import annotations

import math

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from nlens_video.cameras.solved import SolvedCamera, undistorted
from nlens_video.core.layers import Bool, Float64
from nlens_video.scene.camera import Camera
from nlens_video.solve.points.observations import Ints, Observations
from nlens_video.solve.still.segments import Segments

VERTICAL, CLUTTER = 0, -1
"""Groups of segments; horizontal directions count from 1."""
_AT_REST = 1e-6  # movement of a camera, by its height, below which no depth can be found [1]
_NEAR = np.radians(1.0)  # between a segment and its vanishing point
_AMBIGUOUS = np.radians(3.0)  # an upright segment so near to a horizontal direction may be of it
_STEP = 0.02  # between places along a segment, by the frame's height
_FEWEST = 3  # segments that make a horizontal direction
_MOST_DIRECTIONS = 4
_STEEP_DEG, _STEEP_ERROR_DEG = -40.0, 20.0  # pitch that uprights must confirm; its error without
_ASIDE, _BEYOND, _BEFORE = 0.25, 0.12, 0.2  # of a place: lines that tell whether it is ground
_FEWEST_NEAR, _LEAST_LENGTH = 3, 0.12  # lines of a direction there; their length by the width
_GROUND_DIRECTIONS = 2
_BINS = 180
_MOST_FRAMES = 300  # of a shot, evenly
_SHORTEST = 5  # frames that show a point


class Reprojection(Struct, frozen=True, eq=False):
    """Distances of tracked points from where the cameras see them.

    Attributes:
        track: number of the track of each observation (N,).
        frame: its place among the frames (N,).
        position: where it was seen (N, 2) [px].
        error_px: distance from where its point is seen by the cameras, without the lens'
            distortion (N,) [px].
    """

    track: Ints
    frame: Ints
    position: Float64
    error_px: Float64

    @property
    def median_px(self) -> float | None:
        """Median over all observations, None without any [px]."""
        return float(np.median(self.error_px)) if len(self.error_px) else None

    def by_frame(self) -> tuple[Ints, Float64, Float64]:
        """Frames that show points, and the median and the 90th percentile on each [px]."""
        frames = np.unique(self.frame)
        shown = [self.error_px[self.frame == frame] for frame in frames]
        low = np.array([np.median(errors) for errors in shown])
        return frames, low, np.array([np.quantile(errors, 0.9) for errors in shown])


class PlateLines(Struct, frozen=True, eq=False):
    """Line segments of a plate's first picture.

    Attributes:
        ends: (N, 2, 2) [frame width, frame height].
        groups: as of `line_groups` (N,).
    """

    ends: Float64
    groups: Ints

    @classmethod
    def of(cls, segments: Segments, size: tuple[int, int], camera: Camera) -> PlateLines:
        """The segments of a picture.

        Args:
            segments: of it.
            size: its columns and rows [px].
            camera: that sees it.
        """
        return cls(segments.ends / size, line_groups(segments, camera))


def reproject(seen: Observations, times_s: list[float], solved: SolvedCamera) -> Reprojection:
    """Find each track's point by the solved cameras, and compare it with where it was seen.

    A camera that does not leave its place sees directions, one that does sees points: those nearest
    to all rays.

    Args:
        seen: where points were seen, at the size of the solved camera [px].
        times_s: of the frames [s].
        solved: the cameras.
    """
    frames = list(range(0, len(times_s), 1 + (len(times_s) - 1) // _MOST_FRAMES))
    table = seen.table(frames, _SHORTEST)
    numbers, places, pixels = table.numbers, table.places, table.pixels.copy()
    if not len(numbers):
        return Reprojection(numbers, places, pixels, np.zeros(0))
    cameras = [solved.at(times_s[frame]) for frame in frames]
    for place, camera in enumerate(cameras if solved.distortion_k1 else ()):
        here = places == place
        pixels[here] = undistorted(pixels[here], camera, solved.distortion)
    poses = np.array([camera.world_from_camera for camera in cameras])[places]
    lens = np.array([(c.fx, c.fy, c.cx, c.cy) for c in cameras])[places]
    rays = np.column_stack([
        (pixels[:, 0] - lens[:, 2]) / lens[:, 0],
        -(pixels[:, 1] - lens[:, 3]) / lens[:, 1],
        -np.ones(len(pixels)),
    ])  # fmt: skip
    rays = np.einsum("nij,nj->ni", poses[:, :3, :3], rays)
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    eyes, count = poses[:, :3, 3], int(numbers.max()) + 1
    moved = np.ptp(eyes, axis=0).max() > _AT_REST * max(1.0, abs(eyes[:, 1]).max())
    if moved:
        points = _nearest_points(numbers, eyes, rays, count)[numbers] - eyes
    else:
        points = _sums(numbers, rays, count)[numbers]
    local = np.einsum("nji,nj->ni", poses[:, :3, :3], points)
    depth = np.maximum(-local[:, 2], 1e-9)
    spots = np.column_stack([
        lens[:, 2] + lens[:, 0] * local[:, 0] / depth,
        lens[:, 3] - lens[:, 1] * local[:, 1] / depth,
    ])  # fmt: skip
    shown = np.array(frames)[places]
    return Reprojection(numbers, shown, table.pixels, np.linalg.norm(spots - pixels, axis=1))


def _nearest_points(numbers: Ints, eyes: Float64, rays: Float64, count: int) -> Float64:
    """The point nearest to all rays of each track (count, 3), near rays counting more.

    A distance across a ray counts by its angle, which takes the point's depth of a first round.
    """
    across = np.eye(3) - rays[:, :, None] * rays[:, None, :]
    weights: Float64 = np.ones(len(rays))
    points: Float64 = np.zeros((count, 3))
    for _ in range(3):
        sums = _sums(numbers, (weights[:, None, None] * across).reshape(-1, 9), count)
        sides = _sums(numbers, weights[:, None] * np.einsum("nij,nj->ni", across, eyes), count)
        # rays that are parallel leave the depth open: the least of it is taken
        normal = sums.reshape(-1, 3, 3) + 1e-9 * np.eye(3)
        points = np.asarray(np.linalg.solve(normal, sides[..., None])[..., 0], np.float64)
        depth = np.einsum("ni,ni->n", points[numbers] - eyes, rays)
        weights = 1.0 / np.maximum(depth, 1e-3) ** 2
        scale = _sums(numbers, weights[:, None], count)[numbers, 0]
        weights /= np.maximum(scale, 1e-12)
    return points


def _sums(numbers: Ints, values: Float64, count: int) -> Float64:
    """Sum of the values (N, K) of each track (count, K)."""
    found = np.zeros((count, values.shape[1]))
    np.add.at(found, numbers, values)
    return found


def line_groups(segments: Segments, camera: Camera) -> Ints:
    """Which vanishing point each segment points to, as a camera has it (N,).

    Args:
        segments: of the picture.
        camera: at the picture's size.

    Returns:
        `VERTICAL`, the number of a horizontal direction from 1 on, or `CLUTTER`.
    """
    return _grouped(segments, camera)[0]


def doubted_where_steep(solved: SolvedCamera, segments: Segments) -> SolvedCamera:
    """A camera that looks down steeply, its horizon assumed where no line shows the vertical.

    Squares on a wall, or on the sides of a bridge, that the camera faces look like a floor seen
    from above. What stands upright on a floor tells them apart.

    Args:
        solved: a camera, at the size of the picture.
        segments: of its first picture.
    """
    first = solved.keys[0]
    if solved.path == "moving" or solved.horizon != "measured" or first.pitch_deg > _STEEP_DEG:
        return solved
    if np.count_nonzero(_upright(segments, solved.at(first.pts_s))) >= _FEWEST:
        return solved
    errors = replace(solved.errors, pitch_deg=max(solved.errors.pitch_deg, _STEEP_ERROR_DEG))
    return replace(solved, horizon="assumed", errors=errors)


def standing_points(segments: Segments, camera: Camera) -> Float64:
    """Places along the upright edges of a picture (M, 2) [px]: what shows them is no ground.

    Edges that lie on the ground as well as others do, and point to the camera, are left out: they
    look upright too.

    Args:
        segments: of the picture.
        camera: at the picture's size.
    """
    step = _STEP * camera.height
    found = [
        one + share * (other - one)
        for one, other in segments.ends[_upright(segments, camera)]
        for share in np.linspace(0.0, 1.0, 1 + math.ceil(float(np.linalg.norm(other - one)) / step))
    ]
    return np.array(found).reshape(-1, 2)


def shows_ground(
    segments: Segments, solved: SolvedCamera, time_s: float, place: tuple[float, float]
) -> bool:
    """Whether something tells that a place is on the ground.

    Points below a path do, what gives the scale, blur that grows towards the viewer, and lines
    about the place along two directions over a ground that is measured: tiles, boards, kerbs. A
    wall shows one level direction, and the vertical.

    Args:
        segments: of the first picture, at the size of the solved camera.
        solved: the cameras.
        time_s: of the first picture [s].
        place: column and row in it [frame width, frame height].
    """
    if solved.path == "moving" or solved.scale == "metres" or "blur" in solved.method:
        return True
    if solved.horizon == "assumed":
        return False
    size = solved.width, solved.height
    off = segments.ends.mean(axis=1).reshape(-1, 2) / size - place
    near = (abs(off[:, 0]) < _ASIDE) & (off[:, 1] > -_BEYOND) & (off[:, 1] < _BEFORE)
    groups = _grouped(segments, solved.at(time_s))[0]
    share = segments.lengths / solved.width
    found = [near & (groups == number) for number in range(1, _MOST_DIRECTIONS + 1)]
    told = [one.sum() >= _FEWEST_NEAR and share[one].sum() > _LEAST_LENGTH for one in found]
    return bool(sum(told) >= _GROUND_DIRECTIONS)


def _upright(segments: Segments, camera: Camera) -> Bool:
    """Which segments are upright, and not as well along a horizontal direction (N,)."""
    groups, directions = _grouped(segments, camera)
    upright = groups == VERTICAL
    for direction in directions:
        upright &= _angles(segments, camera, direction) > _AMBIGUOUS
    return np.asarray(upright)


def _grouped(segments: Segments, camera: Camera) -> tuple[Ints, list[Float64]]:
    """The groups of `line_groups`, and the horizontal directions in camera axes (3,)."""
    up = camera.world_from_camera[1, :3]
    groups = np.full(len(segments.ends), CLUTTER)
    found: list[Float64] = []
    if not len(groups):
        return groups, found
    groups[_angles(segments, camera, up) < _NEAR] = VERTICAL
    axes = camera.world_from_camera[:3, :3]
    lengths = segments.lengths
    for number in range(1, _MOST_DIRECTIONS + 1):
        turns = np.pi * np.arange(_BINS) / _BINS
        directions = np.column_stack([np.cos(turns), np.zeros(_BINS), np.sin(turns)]) @ axes
        near = np.array([_angles(segments, camera, one) < _NEAR for one in directions])
        near &= groups == CLUTTER
        best = int((near * lengths).sum(axis=1).argmax())
        if near[best].sum() < _FEWEST:
            break
        groups[near[best]] = number
        found.append(directions[best])
    return groups, found


def _angles(segments: Segments, camera: Camera, direction: Float64) -> Float64:
    """Angle between each segment and the line to a direction's vanishing point (N,) [rad]."""
    middles = segments.ends.mean(axis=1)
    along = segments.ends[:, 1] - segments.ends[:, 0]
    # the vanishing point in homogeneous pixels: finite where the direction leaves the image plane
    depth = -direction[2]
    x = camera.fx * direction[0] + depth * (camera.cx - middles[:, 0])
    y = -camera.fy * direction[1] + depth * (camera.cy - middles[:, 1])
    cross = abs(x * along[:, 1] - y * along[:, 0])
    return np.asarray(np.arcsin(
        np.clip(cross / np.maximum(np.hypot(x, y) * segments.lengths, 1e-12), 0.0, 1.0)
    ))  # fmt: skip
