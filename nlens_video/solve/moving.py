"""A camera that moves: structure from motion by pycolmap on keyframes, resection of the others."""

from __future__ import annotations

import copy
import importlib.util
import math
import tempfile
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import TYPE_CHECKING

import cv2
import numpy as np
import numpy.typing as npt

from nlens_video.cameras.colmap import FLIP
from nlens_video.core.errors import UsageError
from nlens_video.core.layers import Float32, Float64

if TYPE_CHECKING:
    import pycolmap

_LEAST_SHARED = 30  # points that two keyframes have in common
_WELL_SHARED = 200
_LEAST_SEEN = 12  # points that a frame is resected from
_START_FOV_DEG = 53.0  # of the search, where nothing is known
_TRIED = 0.02  # change of the focal length by which its error is measured [1]


@dataclass(frozen=True, slots=True, eq=False)
class MovingPath:
    """A solved path, in a world of any scale and axes.

    Attributes:
        focal_px: focal length [px].
        focal_stderr_px: its standard error [px].
        poses: world-from-camera matrices by frame (4, 4), glTF's camera axes.
        points: positions of the tracks that were solved (N, 3).
        residual_px: root mean square distance of an observation from its point [px].
    """

    focal_px: float
    focal_stderr_px: float
    poses: dict[int, Float64]
    points: Float64
    residual_px: float


def check_installed() -> None:
    """Refuse before any work where pycolmap is missing.

    Raises:
        UsageError: it is not installed.
    """
    if importlib.util.find_spec("pycolmap") is None:
        raise UsageError(
            "a camera that moves needs pycolmap; install nlens-video[solve], or give --camera-from"
        )


def solve_moving(
    tracks: list[dict[int, Float32]],
    keyframes: list[int],
    frames: list[int],
    size: tuple[int, int],
    focal_px: float | None = None,
) -> MovingPath | None:
    """Solve the path of a camera with one focal length.

    Args:
        tracks: positions of points by frame [px].
        keyframes: those that structure is solved from, in order.
        frames: all frames.
        size: columns and rows [px].
        focal_px: focal length where it is known [px].

    Returns:
        None where fewer than half of the keyframes can be solved together.
    """
    check_installed()
    import pycolmap

    log = pycolmap.logging
    log.minloglevel = log.stderrthreshold = log.Level.FATAL.value
    with tempfile.TemporaryDirectory(prefix="nlens-video-solve-") as folder:
        found = _map(Path(folder), tracks, keyframes, size, focal_px)
        if found is None or 2 * found[0].num_reg_images() < len(keyframes):
            return None
        model, observed = found
        return _resected(model, observed, tracks, frames, known=focal_px is not None)


def _map(
    folder: Path,
    tracks: list[dict[int, Float32]],
    keyframes: list[int],
    size: tuple[int, int],
    focal_px: float | None,
) -> tuple[pycolmap.Reconstruction, dict[int, list[int]]] | None:
    """Structure from motion on keyframes; the model, and the tracks seen by each keyframe."""
    import pycolmap

    path, listed = folder / "tracks.db", folder / "pairs.txt"
    observed = {
        key: [number for number, track in enumerate(tracks) if key in track] for key in keyframes
    }
    ids = _write_points(path, tracks, observed, size, focal_px)
    matches = _matches(observed)
    if not matches:
        return None
    with pycolmap.Database.open(str(path)) as database:
        for (first, second), shared in matches.items():
            database.write_matches(ids[first], ids[second], shared)
    listed.write_text("\n".join(f"{first:08d} {second:08d}" for first, second in matches))
    pycolmap.verify_matches(str(path), str(listed))
    options = pycolmap.IncrementalPipelineOptions()
    options.multiple_models = False
    options.min_model_size = 3
    options.num_threads = 2
    options.random_seed = 0
    options.ba_refine_principal_point = options.ba_refine_extra_params = False
    options.ba_refine_focal_length = focal_px is None
    options.mapper.init_max_forward_motion = 1.0
    options.mapper.init_min_tri_angle = 2.0
    options.mapper.init_min_num_inliers = 40
    options.mapper.abs_pose_min_num_inliers = 15
    # What COLMAP begins with by itself may be two keyframes with too little parallax.
    widest = max(matches, key=lambda pair: _parallax(tracks, *pair))
    options.init_image_id1, options.init_image_id2 = (ids[key] for key in widest)
    models = pycolmap.incremental_mapping(str(path), str(folder), str(folder), options)
    if not models:
        return None
    return max(models.values(), key=lambda one: one.num_reg_images()), observed


def _write_points(
    path: Path,
    tracks: list[dict[int, Float32]],
    observed: dict[int, list[int]],
    size: tuple[int, int],
    focal_px: float | None,
) -> dict[int, int]:
    """Write a COLMAP database of keyframes and their points; the ids of the keyframes."""
    import pycolmap

    width, height = size
    start = focal_px or 0.5 * width / math.tan(0.5 * math.radians(_START_FOV_DEG))
    camera = pycolmap.Camera(
        model="SIMPLE_PINHOLE", width=width, height=height, params=[start, width / 2, height / 2]
    )
    camera.has_prior_focal_length = focal_px is not None
    ids = {}
    with pycolmap.Database.open(str(path)) as database:
        camera.camera_id = database.write_camera(camera)
        rig = pycolmap.Rig()
        rig.add_ref_sensor(camera.sensor_id)
        rig.rig_id = database.write_rig(rig)
        for key, numbers in observed.items():
            image = pycolmap.Image(name=f"{key:08d}", camera_id=camera.camera_id)
            image.image_id = ids[key] = database.write_image(image)
            frame = pycolmap.Frame()
            frame.rig_id = rig.rig_id
            frame.add_data_id(image.data_id)
            database.write_frame(frame)
            points = np.array([tracks[number][key] for number in numbers], np.float32)
            database.write_keypoints(image.image_id, points.reshape(-1, 2))
    return ids


def _matches(observed: dict[int, list[int]]) -> dict[tuple[int, int], npt.NDArray[np.uint32]]:
    """Places of the points that two keyframes share (N, 2), where they share enough."""
    found = {}
    for (first, numbers), (second, others) in combinations(observed.items(), 2):
        place = {number: at for at, number in enumerate(numbers)}
        shared = [(place[number], at) for at, number in enumerate(others) if number in place]
        if len(shared) >= _LEAST_SHARED:
            found[first, second] = np.array(shared, np.uint32)
    return found


def _parallax(tracks: list[dict[int, Float32]], first: int, second: int) -> float:
    """How far points move against each other between two frames, less where they are few [px]."""
    both = [track for track in tracks if first in track and second in track]
    before = np.array([track[first] for track in both], np.float64)
    after = np.array([track[second] for track in both], np.float64)
    plane, _ = cv2.findHomography(before, after, cv2.RANSAC, 2.0)
    if plane is None:
        return 0.0
    moved = np.column_stack([before, np.ones(len(before))]) @ plane.T
    away = np.linalg.norm(after - moved[:, :2] / moved[:, 2:], axis=1)
    return float(np.quantile(away, 0.8) * min(1.0, len(both) / _WELL_SHARED))


def _resected(
    model: pycolmap.Reconstruction,
    observed: dict[int, list[int]],
    tracks: list[dict[int, Float32]],
    frames: list[int],
    *,
    known: bool,
) -> MovingPath:
    """Poses of all frames that see enough of the solved points."""
    import pycolmap

    (camera,) = model.cameras.values()
    positions = {}
    poses = {}
    for image in model.images.values():
        if not image.has_pose:
            continue
        key = int(image.name)
        poses[key] = _pose(image.cam_from_world())
        for at, point in enumerate(image.points2D):
            if point.has_point3D():
                positions[observed[key][at]] = model.points3D[point.point3D_id].xyz
    for frame in frames:
        seen = [number for number in positions if frame in tracks[number]]
        if frame in poses or len(seen) < _LEAST_SEEN:
            continue
        near = min(poses, key=lambda key: abs(key - frame))
        start = np.linalg.inv(poses[near])
        refined = pycolmap.refine_absolute_pose(
            pycolmap.Rigid3d((FLIP @ start)[:3]),
            np.array([tracks[number][frame] for number in seen], np.float64),
            np.array([positions[number] for number in seen]),
            np.ones(len(seen), bool),
            camera,
        )
        if refined is not None:
            poses[frame] = _pose(refined["cam_from_world"])
    return MovingPath(
        focal_px=float(camera.params[0]),
        focal_stderr_px=0.0 if known else _focal_error(model),
        poses=dict(sorted(poses.items())),
        points=np.array([point.xyz for point in model.points3D.values()]),
        residual_px=float(model.compute_mean_reprojection_error()),
    )


def _focal_error(model: pycolmap.Reconstruction) -> float:
    """Standard error of the focal length, from the cost of two adjustments beside it [px].

    Where the path does not tell the focal length, as on a straight line without a turn, both cost
    next to nothing and the error is large.
    """
    import pycolmap

    options = pycolmap.BundleAdjustmentOptions()
    options.print_summary = False
    costs = []
    for change in (0.0, -_TRIED, _TRIED):
        tried = copy.deepcopy(model)
        ((camera_id, camera),) = tried.cameras.items()
        camera.params = camera.params * (1.0 + change, 1.0, 1.0)
        config = pycolmap.BundleAdjustmentConfig()
        for image_id in tried.reg_image_ids():
            config.add_image(image_id)
        config.set_constant_cam_intrinsics(camera_id)
        config.fix_gauge(pycolmap.BundleAdjustmentGauge.TWO_CAMS_FROM_WORLD)
        pycolmap.create_default_bundle_adjuster(options, config, tried).solve()
        tried.update_point_3d_errors()
        costs.append(
            tried.compute_num_observations() * tried.compute_mean_reprojection_error() ** 2
        )
    variance = costs[0] / max(1, model.compute_num_observations())
    rise = max(0.5 * (costs[1] + costs[2]) - costs[0], 1e-9) / max(variance, 1e-9)
    return float(model.cameras[next(iter(model.cameras))].params[0] * _TRIED / math.sqrt(rise))


def _pose(cam_from_world: pycolmap.Rigid3d) -> Float64:
    """World-from-camera matrix (4, 4) in glTF's camera axes."""
    matrix = np.eye(4)
    matrix[:3] = cam_from_world.matrix()
    return np.asarray(np.linalg.inv(FLIP @ matrix))
