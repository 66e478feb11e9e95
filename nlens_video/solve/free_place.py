"""A place on the ground of the first frame that is in view and in no one's way.

A point of the ground follows the ground's own movement from frame to frame; what moves by itself,
and what stands above the ground where the camera moves, does not. Walls, boxes and furniture before
a camera that stands still are told by their upright edges.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from nlens_video.cameras.placed import ground_top
from nlens_video.cameras.solved import SolvedCamera
from nlens_video.core.errors import SceneError
from nlens_video.core.layers import Float32, Float64
from nlens_video.scene.camera import Camera
from nlens_video.solve.evidence import shows_ground, standing_points
from nlens_video.solve.still.segments import Segments

_OFF_PX = 2.5  # from where a point of the ground would be, at a width of 960
_COLUMNS = (0.5, 0.42, 0.58, 0.34, 0.66, 0.26, 0.74)
_DOWN = (0.62, 0.7, 0.54, 0.78, 0.46)  # from the horizon, or the frame's top, to the lower border
_HALF_WIDTH, _ABOVE, _BELOW = 0.13, 0.22, 0.07  # of the window that is kept free [frame]
_FEW = 2  # points in it that may be errors of the tracker
_MARGIN = 0.05  # of a frame that shows the place [frame]
_MOST_FRAMES, _MOST_TRACKS = 12, 4000
NOTHING: Float64 = np.zeros((0, 2))
"""Places of a picture without upright edges."""


def chosen_place(
    tracks: Sequence[Mapping[int, Float32 | Float64]],
    times_s: list[float],
    solved: SolvedCamera,
    segments: Segments,
) -> tuple[tuple[float, float] | None, bool]:
    """The free place of a shot, and whether it is a guess: nothing tells that it is on the ground.

    Args:
        tracks: positions by frame, at the size of the solved camera [px].
        times_s: of the frames [s].
        solved: the cameras.
        segments: of the first picture, at the size of the solved camera.
    """
    standing = standing_points(segments, solved.at(times_s[0]))
    place = free_place(tracks, times_s, solved, standing)
    told = place is None or shows_ground(segments, solved, times_s[0], place)
    return place, not told


def free_place(
    tracks: Sequence[Mapping[int, Float32 | Float64]],
    times_s: list[float],
    solved: SolvedCamera,
    standing: Float64 = NOTHING,
) -> tuple[float, float] | None:
    """The place nearest to the middle of the ground that is free, None where there is no ground.

    Where none is free, the one with the least in its way.

    Args:
        tracks: positions by frame, at the size of the solved camera [px].
        times_s: of the frames [s].
        solved: the cameras.
        standing: places of the first frame that show upright edges (N, 2) [px].

    Returns:
        Column and row [frame width, frame height].
    """
    first = solved.at(times_s[0])
    try:
        top = ground_top(first)
    except SceneError:
        return None
    size = np.array([first.width, first.height])
    taken = np.concatenate([_obstacles(tracks, times_s, solved), standing]) / size
    every = max(1, len(times_s) // _MOST_FRAMES)
    later = [solved.at(time_s) for time_s in times_s[::every]]
    best = None
    for down in _DOWN:
        for column in _COLUMNS:
            place = np.array([column, top + down * (1.0 - top)])
            near = abs(taken[:, 0] - place[0]) < _HALF_WIDTH
            near &= (taken[:, 1] > place[1] - _ABOVE) & (taken[:, 1] < place[1] + _BELOW)
            lost = 1.0 - _share_in_view(place * size, first, later, solved.ground_y)
            away = abs(column - _COLUMNS[0]) + abs(down - _DOWN[0])
            cost = max(0, int(near.sum()) - _FEW), lost > 0.0, lost, away
            if best is None or cost < best[0]:
                best = cost, (float(place[0]), float(place[1]))
    assert best is not None
    return best[1]


def _obstacles(
    tracks: Sequence[Mapping[int, Float32 | Float64]], times_s: list[float], solved: SolvedCamera
) -> Float64:
    """Where the first frame shows the ground under points that are not of it (N, 2) [px]."""
    first = solved.at(times_s[0])
    limit = _OFF_PX * first.width / 960.0
    cameras = [solved.at(time_s) for time_s in times_s]
    found = []
    for track in tracks[:: 1 + len(tracks) // _MOST_TRACKS]:
        frames = sorted(track)
        start, end = frames[0], frames[-1]
        expected = _carried(track[start], cameras[start], cameras[end], solved.ground_y)
        if expected is None or np.linalg.norm(expected - track[end]) <= limit:
            continue
        for frame in (start, end):
            spot = _carried(track[frame], cameras[frame], first, solved.ground_y)
            if spot is not None:
                found.append(spot)
    return np.array(found).reshape(-1, 2)


def _share_in_view(spot: Float64, first: Camera, later: list[Camera], ground_y: float) -> float:
    """Share of cameras that show the point of the ground that the first one shows at a pixel."""
    seen = 0
    for camera in later:
        place = _carried(spot, first, camera, ground_y)
        if place is not None:
            share = place / (camera.width, camera.height)
            seen += bool((share > _MARGIN).all() and (share < 1.0 - _MARGIN).all())
    return seen / len(later)


def _carried(
    spot: Float64 | Float32, one: Camera, other: Camera, ground_y: float
) -> Float64 | None:
    """Where a camera shows the point of the ground that another shows at a pixel, None nowhere."""
    points, _ = one.ground_seen_at(np.asarray(spot, np.float64)[None], ground_y)
    if np.isnan(points).any():
        return None
    seen = other.to_camera(points)
    return None if seen[0, 2] >= 0.0 else np.asarray(other.pixels(seen)[0], np.float64)
