"""Keyframes and points together: adjusted by pycolmap under several models of the lens."""

from __future__ import annotations

import math

import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from nlens_video.cameras.colmap import FLIP
from nlens_video.core.layers import Bool, Float64
from nlens_video.solve.paths.mapping import Structure
from nlens_video.solve.points.observations import Ints, Table

_FARTHEST_PX = 3.0  # from its model, of an observation that takes part
_LOSS_PX = 1.0
_TRIED = 0.02  # change of the focal length by which its error is measured [1]
_SYSTEMATIC = 2e-4  # errors of tracks that do not average out, by the frame's width [1]
_FEWEST = 3  # observations of a point that takes part
_LEAST_KEPT = 0.5  # share of them by which the error of a focal length is told
_REGIONS = 4, 2  # columns and rows of the regions whose points may err alike
_BENT_GAIN, _BENT_PX = 0.985, 2.0  # of the cost without; shift of a corner that shows


class Bundle(Struct, frozen=True, eq=False):
    """Keyframes and points, in a world of any scale and axes.

    Attributes:
        table: observations in the keyframes.
        size: columns and rows [px].
        poses: world-from-camera matrices of the keyframes (K, 4, 4), glTF's camera axes; nan for
            one that is not solved.
        focals_px: focal lengths of the keyframes (K,) [px].
        points: positions (P, 3), nan where one is not solved.
        distortion: radial coefficient k: a point at radius r from the middle is seen at
            r (1 + k r²), r by the focal length [1].
    """

    table: Table
    size: tuple[int, int]
    poses: Float64
    focals_px: Float64
    points: Float64
    distortion: float = 0.0

    @property
    def solved(self) -> list[int]:
        """Keyframes that are solved."""
        return [int(n) for n in np.flatnonzero(np.isfinite(self.poses[:, 0, 0]))]

    @property
    def zooms(self) -> bool:
        """Whether the focal length changes."""
        return float(np.ptp(self.focals_px)) > 0.0

    def errors_px(self) -> Float64:
        """Distance of each observation from its model (N,), nan where that is not solved [px]."""
        world = self.points[self.table.numbers]
        poses = self.poses[self.table.places]
        local = np.einsum("nji,nj->ni", poses[:, :3, :3], world - poses[:, :3, 3])
        flat = local[:, :2] / -np.where(local[:, 2:] < 0.0, local[:, 2:], np.nan)
        flat = flat * (1.0 + self.distortion * (flat**2).sum(axis=1, keepdims=True))
        seen = flat * self.focals_px[self.table.places, None] * (1.0, -1.0)
        seen += np.array(self.size) / 2.0
        return np.asarray(np.linalg.norm(seen - self.table.pixels, axis=1))

    def believed(self) -> Bool:
        """Observations that fit, of points that have enough of them (N,)."""
        used = self.errors_px() < _FARTHEST_PX
        counts = np.bincount(self.table.numbers[used], minlength=len(self.points))
        return np.asarray(used & (counts[self.table.numbers] >= _FEWEST))

    def cost(self, used: Bool) -> float:
        """Sum of some observations' losses (Cauchy's), infinite where one has no model [px²]."""
        losses = _LOSS_PX**2 * np.log1p((self.errors_px()[used] / _LOSS_PX) ** 2)
        return float(np.nan_to_num(losses, nan=math.inf).sum())

    @property
    def residual_px(self) -> float:
        """Median distance of an observation from its model, infinite without any [px]."""
        errors = self.errors_px()
        errors = errors[np.isfinite(errors)]
        return float(np.median(errors)) if len(errors) else math.inf

    @property
    def unexplained_px(self) -> float:
        """Mean distance of the observations from their model, at most 3 px each [px].

        One whose point is not solved is as far off.
        """
        errors = np.nan_to_num(self.errors_px(), nan=_FARTHEST_PX)
        return float(np.minimum(errors, _FARTHEST_PX).mean())

    def stretched(self, focal_px: float) -> Bundle:
        """The same pictures seen with another focal length, where the camera does not turn.

        The scene stretches along the optical axis by as much.
        """
        share = focal_px / float(np.median(self.focals_px))
        first = self.poses[self.solved[0]]
        turn, eye = first[:3, :3], first[:3, 3]
        stretch = turn @ np.diag([1.0, 1.0, share]) @ turn.T
        poses = self.poses.copy()
        poses[:, :3, 3] = (poses[:, :3, 3] - eye) @ stretch + eye
        return replace(
            self, poses=poses, points=(self.points - eye) @ stretch + eye,
            focals_px=self.focals_px * share, distortion=self.distortion * share**2,
        )  # fmt: skip

    def adjusted(
        self, *, focal: bool = True, zooms: bool = False, distortion: bool = False,
        used: Bool | None = None,
    ) -> Bundle:  # fmt: skip
        """Poses and points that fit the observations best.

        Args:
            used: observations that take part (N,), None for those that fit now.
            focal: the focal length is free; of a zoom, that of the first keyframe is.
            zooms: each keyframe has one of its own, which is free.
            distortion: the radial coefficient is free.
        """
        import pycolmap

        free, kept = focal or zooms, zooms and not focal
        zooms = zooms or self.zooms
        model = pycolmap.Reconstruction()
        width, height = self.size
        for place in self.solved:
            if zooms or place == self.solved[0]:
                camera = pycolmap.Camera(
                    model="SIMPLE_RADIAL", width=width, height=height, camera_id=place + 1,
                    params=[self.focals_px[place], width / 2, height / 2, self.distortion],
                )  # fmt: skip
                model.add_camera_with_trivial_rig(camera)
        used = self.believed() if used is None else used
        tracks: dict[int, list[tuple[int, int]]] = {}
        for place in self.solved:
            here = np.flatnonzero(used & (self.table.places == place))
            image = pycolmap.Image(
                name=str(place), keypoints=self.table.pixels[here],
                camera_id=(place if zooms else self.solved[0]) + 1, image_id=place + 1,
            )  # fmt: skip
            pose = pycolmap.Rigid3d((FLIP @ np.linalg.inv(self.poses[place]))[:3])
            model.add_image_with_trivial_frame(image, pose)
            for at, number in enumerate(self.table.numbers[here]):
                tracks.setdefault(int(number), []).append((place + 1, at))
        names = {}
        for number, elements in tracks.items():
            track = pycolmap.Track([pycolmap.TrackElement(*one) for one in elements])
            names[number] = model.add_point3D(self.points[number], track)
        options = pycolmap.BundleAdjustmentOptions()
        options.print_summary = False
        options.refine_focal_length, options.refine_extra_params = free, distortion
        options.ceres.loss_function_type = pycolmap.LossFunctionType.CAUCHY
        options.ceres.loss_function_scale = _LOSS_PX
        options.ceres.solver_options.num_threads = 1
        options.ceres.solver_options.max_num_iterations = 50
        options.ceres.solver_options.function_tolerance = 1e-6
        config = pycolmap.BundleAdjustmentConfig()
        for place in self.solved:
            config.add_image(place + 1)
        if kept:
            config.set_constant_cam_intrinsics(self.solved[0] + 1)
        config.fix_gauge(pycolmap.BundleAdjustmentGauge.TWO_CAMS_FROM_WORLD)
        pycolmap.create_default_bundle_adjuster(options, config, model).solve()
        poses, focals, points = self.poses.copy(), self.focals_px.copy(), self.points.copy()
        cameras = {}
        for place in self.solved:
            image = model.images[place + 1]
            poses[place] = pose_of(image.cam_from_world().matrix())
            cameras[place] = model.cameras[image.camera_id].params
            focals[place] = cameras[place][0]
        for number, name in names.items():
            points[number] = model.points3D[name].xyz
        return replace(
            self, poses=poses, points=points, focals_px=focals,
            distortion=float(cameras[self.solved[0]][3]) if distortion else self.distortion,
        )  # fmt: skip

    def bent(self, *, focal: bool) -> Bundle:
        """With the lens' distortion, where the observations call for it; else this one.

        What calls for it is a cost that falls by 1.5 %: observations of one point err together, so
        that less would be chance. The corners must have shifted visibly, and must have a place.

        Args:
            focal: whether the focal length is free.
        """
        used = self.believed()
        found = self.adjusted(focal=focal, distortion=True, used=used)
        half, px = 0.5 * math.hypot(*self.size), float(np.median(found.focals_px))
        corner = found.distortion * (half / px) ** 2
        shows = abs(corner) * half > _BENT_PX and 1.0 + 3.0 * corner > 0.0
        return found if shows and found.cost(used) < _BENT_GAIN * self.cost(used) else self

    def focal_noise(self) -> float:
        """Standard error of the focal length by noise, from two adjustments beside it [1].

        Where the path does not tell the focal length, as on a straight line without a turn, both
        cost next to nothing and the error is large. It is infinite where they lose half of what
        is seen.
        """
        focal, used = float(np.median(self.focals_px)), self.believed()
        tried = [
            self.stretched(focal * share).adjusted(focal=False, used=used)
            for share in (1.0 - _TRIED, 1.0, 1.0 + _TRIED)
        ]
        # A point that one of them takes behind a camera costs nothing that could be compared.
        kept = used & np.isfinite([one.errors_px() for one in tried]).all(axis=0)
        if kept.sum() <= _LEAST_KEPT * used.sum():
            return math.inf
        low, here, high = (one.cost(kept) for one in tried)
        spread = (1.4826 * self.residual_px) ** 2 / 2.0
        rise = max(0.5 * (low + high) - here, 1e-9) / max(spread, 1e-9)
        return _TRIED / math.sqrt(rise)

    def focal_bias(self) -> float:
        """Standard error of the focal length by what neighbouring points err alike [1].

        As a patch of ground comes nearer its pattern is seen at another slant, and residuals do not
        show what that shifts. On even ground that a camera hardly turns over, hundredths of a pixel
        change the focal length by several percent. A delete-one jackknife over regions.
        """
        used = self.believed()
        regions = self._regions(used)
        logs = np.array([
            np.log(np.median(self.adjusted(focal=True, used=used & (regions != one)).focals_px))
            for one in np.unique(regions[used])
        ])  # fmt: skip
        return math.sqrt((len(logs) - 1) * float(np.var(logs)))

    def _regions(self, used: Bool) -> Ints:
        """Region of the point of each observation (N,), by where it is first seen; alike in size.

        Args:
            used: observations whose points are shared out evenly (N,).
        """
        columns, rows = _REGIONS
        first = np.zeros((len(self.points), 2))
        order = np.argsort(-self.table.places, kind="stable")  # the earliest is written last
        first[self.table.numbers[order]] = self.table.pixels[order]
        shared = np.unique(self.table.numbers[used])
        row = np.zeros(len(first), np.int64)
        column = np.zeros(len(first), np.int64)
        row[shared] = _parts(first[shared, 1], rows)
        for n in range(rows):
            here = shared[row[shared] == n]
            column[here] = _parts(first[here, 0], columns)
        return np.asarray((row * columns + column)[self.table.numbers])


def bundle_of(structure: Structure, table: Table, size: tuple[int, int], count: int) -> Bundle:
    """The keyframes and points of a structure."""
    poses, focals = np.full((count, 4, 4), np.nan), np.full(count, np.nan)
    for image in structure.model.images.values():
        if image.has_pose:
            place = structure.places[image.image_id]
            poses[place] = pose_of(image.cam_from_world().matrix())
            focals[place] = structure.model.cameras[image.camera_id].params[0]
    known = np.flatnonzero(np.isfinite(focals))
    focals = np.interp(np.arange(count), known, focals[known])
    return Bundle(table, size, poses, focals, structure.points(len(table.names)))


def _parts(values: Float64, count: int) -> Ints:
    """Which of as many parts alike in size each value (N,) lies in, by its rank."""
    ranks = np.argsort(np.argsort(values, kind="stable"), kind="stable")
    return np.asarray(ranks * count // max(len(values), 1))


def turn_error(turn: float, focal: float) -> float:
    """Least standard error of a focal length that turns of a camera tell [1].

    A turn moves the picture's border against its middle by what the focal length says; errors of
    tracks are compared with that.

    Args:
        turn: the largest angle between two optical axes [rad].
        focal: focal length by the frame's width [1].
    """
    return 4.0 * _SYSTEMATIC * focal / max(turn, 1e-6)


def pose_of(cam_from_world: Float64) -> Float64:
    """World-from-camera matrix (4, 4) in glTF's camera axes."""
    matrix = np.eye(4)
    matrix[:3] = cam_from_world
    return np.asarray(np.linalg.inv(FLIP @ matrix))
