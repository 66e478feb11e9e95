"""The structure that keyframes show, by pycolmap from tracked points."""

from __future__ import annotations

import math
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING

import cv2
import numpy as np
import numpy.typing as npt
from msgspec import Struct

from nlens_video.core.layers import Bool, Float64
from nlens_video.solve.points.observations import Ints, Table

if TYPE_CHECKING:
    import pycolmap

_APART = (1, 2, 3, 5, 8, 12)  # keyframes between the two of a pair
_LEAST_SHARED = 30  # points that two keyframes have in common
_WELL_SHARED = 200
_LEAST_RIGID = 0.4  # of them, on things that stand still
_EPIPOLAR_PX = 1.5
_TRIALS = 300  # of random samples
_NARROW_BEGUN_DEG, _NARROW_DEG = 0.6, 0.3  # between rays to a point, of a path that is narrow
_START_FOV_DEG = 53.0  # of the search, where nothing is known


class Structure(Struct, frozen=True, eq=False):
    """Keyframes and points that were solved together.

    Attributes:
        model: COLMAP's reconstruction.
        places: keyframe of each of its pictures, by picture.
        shown: point of each of a picture's observations, by keyframe.
    """

    model: pycolmap.Reconstruction
    places: dict[int, int]
    shown: dict[int, Ints]

    def points(self, count: int) -> Float64:
        """Positions of the points (P, 3), nan where one is not solved."""
        found = np.full((count, 3), np.nan)
        for image in self.model.images.values():
            numbers = self.shown[self.places[image.image_id]]
            for at, point in enumerate(image.points2D):
                if point.has_point3D():
                    found[numbers[at]] = self.model.points3D[point.point3D_id].xyz
        return found


def map_keyframes(
    table: Table, count: int, size: tuple[int, int], focal_px: float | None, *,
    zooms: bool = False, narrow: bool = False,
) -> Structure | None:  # fmt: skip
    """Structure from motion on keyframes.

    Args:
        table: observations in the keyframes.
        count: number of keyframes.
        size: columns and rows [px].
        focal_px: focal length where it is known [px].
        zooms: each keyframe has a focal length of its own.
        narrow: points count that are seen under a fraction of a degree.

    Returns:
        None where fewer than half of the keyframes can be solved together, or few points.
    """
    import pycolmap

    log = pycolmap.logging
    log.minloglevel = log.stderrthreshold = log.Level.FATAL.value
    seen = [table.at(place) for place in range(count)]
    pairs = {}
    for first in range(count):
        for second in (first + apart for apart in _APART if first + apart < count):
            shared = _Shared.of(seen[first], seen[second])
            if shared is not None:
                pairs[first, second] = shared
    if not pairs:
        return None
    with tempfile.TemporaryDirectory(prefix="nlens-video-solve-") as name:
        folder = Path(name)
        path = folder / "tracks.db"
        ids = _write_points(path, seen, size, focal_px, zooms=zooms)
        with pycolmap.Database.open(str(path)) as database:
            for (first, second), shared in pairs.items():
                geometry = pycolmap.TwoViewGeometry()
                geometry.config = pycolmap.TwoViewGeometryConfiguration.UNCALIBRATED
                geometry.F, geometry.inlier_matches = shared.fundamental, shared.matches
                database.write_matches(ids[first], ids[second], shared.matches)
                database.write_two_view_geometry(ids[first], ids[second], geometry)
        # What COLMAP begins with by itself may be two keyframes with too little parallax.
        widest = max(pairs, key=lambda pair: pairs[pair].parallax_px())
        options = _options(focal_px, narrow=narrow)
        options.init_image_id1, options.init_image_id2 = (ids[place] for place in widest)
        models = pycolmap.incremental_mapping(str(path), name, name, options)
    if not models:
        return None
    model = max(models.values(), key=lambda one: one.num_reg_images())
    if 2 * model.num_reg_images() < count or model.num_points3D() < _LEAST_SHARED:
        return None
    return Structure(
        model, {image: place for place, image in ids.items()},
        {place: numbers for place, (numbers, _) in enumerate(seen)},
    )  # fmt: skip


class _Shared(Struct, frozen=True, eq=False):
    """Points that two keyframes share.

    Attributes:
        matches: their places in both (M, 2), those that one motion explains.
        before: positions in the first keyframe (K, 2), of all [px].
        after: positions in the second (K, 2) [px].
        rigid: which of them one motion explains (K,).
        fundamental: the motion (3, 3).
    """

    matches: npt.NDArray[np.uint32]
    before: Float64
    after: Float64
    rigid: Bool
    fundamental: Float64

    @classmethod
    def of(cls, first: tuple[Ints, Float64], second: tuple[Ints, Float64]) -> _Shared | None:
        """None where they share too few."""
        _, one, two = np.intersect1d(first[0], second[0], return_indices=True)
        if len(one) < _LEAST_SHARED:
            return None
        before, after = first[1][one], second[1][two]
        matrix, inside = cv2.findFundamentalMat(
            before, after, cv2.FM_RANSAC, _EPIPOLAR_PX, 0.999, _TRIALS
        )
        if matrix is None or inside.sum() < max(_LEAST_SHARED, _LEAST_RIGID * len(one)):
            return None
        rigid = inside.ravel() == 1
        matches = np.column_stack([one, two])[rigid].astype(np.uint32)
        return cls(matches, before, after, rigid, np.asarray(matrix, np.float64))

    def parallax_px(self) -> float:
        """How far points that stand still move against each other, less where they are few [px].

        What moves by itself would have the most of it.
        """
        before, after = self.before[self.rigid], self.after[self.rigid]
        plane, _ = cv2.findHomography(before, after, cv2.RANSAC, 2.0, maxIters=_TRIALS)
        if plane is None:
            return 0.0
        moved = np.column_stack([before, np.ones(len(before))]) @ plane.T
        away = np.linalg.norm(after - moved[:, :2] / moved[:, 2:], axis=1)
        return float(np.quantile(away, 0.8) * min(1.0, len(away) / _WELL_SHARED))


def _options(focal_px: float | None, *, narrow: bool) -> pycolmap.IncrementalPipelineOptions:
    import pycolmap

    options = pycolmap.IncrementalPipelineOptions()
    options.multiple_models = False
    options.min_model_size = 3
    options.num_threads = 2
    options.random_seed = 0
    options.ba_refine_principal_point = options.ba_refine_extra_params = False
    options.ba_refine_focal_length = focal_px is None
    options.mapper.init_max_forward_motion = 1.0
    options.mapper.init_min_tri_angle = 2.0
    if narrow:
        options.mapper.init_min_tri_angle = _NARROW_BEGUN_DEG
        options.mapper.filter_min_tri_angle = options.triangulation.min_angle = _NARROW_DEG
    options.mapper.init_min_num_inliers = 40
    options.mapper.abs_pose_min_num_inliers = 15
    return options


def _write_points(
    path: Path,
    seen: list[tuple[Ints, Float64]],
    size: tuple[int, int],
    focal_px: float | None,
    *,
    zooms: bool,
) -> dict[int, int]:
    """Write a COLMAP database of keyframes and their points; the ids of the keyframes."""
    import pycolmap

    width, height = size
    start = focal_px or 0.5 * width / math.tan(0.5 * math.radians(_START_FOV_DEG))
    ids = {}
    rig = None
    with pycolmap.Database.open(str(path)) as database:
        for place, (_, pixels) in enumerate(seen):
            if rig is None or zooms:
                camera = pycolmap.Camera(
                    model="SIMPLE_PINHOLE", width=width, height=height,
                    params=[start, width / 2, height / 2],
                )  # fmt: skip
                camera.has_prior_focal_length = focal_px is not None
                camera.camera_id = database.write_camera(camera)
                rig = pycolmap.Rig()
                rig.add_ref_sensor(camera.sensor_id)
                rig.rig_id = database.write_rig(rig)
            image = pycolmap.Image(name=f"{place:08d}", camera_id=camera.camera_id)
            image.image_id = ids[place] = database.write_image(image)
            frame = pycolmap.Frame()
            frame.rig_id = rig.rig_id
            frame.add_data_id(image.data_id)
            database.write_frame(frame)
            database.write_keypoints(image.image_id, pixels.astype(np.float32))
    return ids
