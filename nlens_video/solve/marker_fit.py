"""Ground and scale from markers of known size that lie on the ground.

The cameras are known in a world of their own; unknown are the ground, the world's scale where the
camera moves, the focal length unless it turns on the spot, and where on the ground each marker
lies. All corners are fitted at once. Markers that turn out to lie on a grid, as those of a board
do, are then fitted as one: a board tells far more than its markers do one by one.
"""

from __future__ import annotations

import math

import cv2
import numpy as np
from msgspec.structs import replace
from scipy.optimize import least_squares

from nlens_video.cameras.ground import ground_frame, moved
from nlens_video.cameras.solved import CameraErrors, FovSource, SolvedCamera
from nlens_video.core.errors import InputError
from nlens_video.core.layers import Float64
from nlens_video.solve.marker_scene import (
    Corners,
    as_grid,
    ground_axes,
    observed,
    stretched,
    stretched_plane,
)
from nlens_video.solve.markers import Sighting

_ERROR_PX = 0.1  # of a corner, at least
_OUTLIER_PX, _WORST_PX = 4.0, 3.0  # of a marker that is left out; of a fit that is believed
_SLANTED = math.cos(math.radians(75.0))
_LEAST_TILT = math.radians(1.0)  # error of the ground that the solve found
_DOUBT = 2.0  # its errors are believed so many times over
_HEIGHT_ERROR = 0.05  # of the first camera above the ground that a path shows [1]
_FREE, _FIXED = 1e3, 1e-9
_LOOSE = 0.2  # error of a focal length that is tried smaller and larger too [1]
_ENOUGH = 5  # markers that a start is fitted to
_ON_GRID_PX = 0.6  # of a board
_FOV_MEASURED = 0.08
_OFF_GROUND_DEG = 0.5  # between the markers' plane and a path's ground, which is told
_FOCAL_KNOWN = 0.002  # error of a path's focal length that is left as it is [1]
_HEAD = 5  # parameters before those of the layout


def metric_camera(
    camera: SolvedCamera, sightings: list[Sighting], family: str, side_m: float
) -> SolvedCamera:
    """The camera above the plane of the markers, in metres.

    Args:
        camera: the plate's, at the size of the sightings.
        sightings: markers by frame, as `MarkerFinder` gives them.
        family: name of their dictionary.
        side_m: length of a marker's side [m].

    Raises:
        InputError: no marker was seen, they do not lie on one plane below the camera, or they
            differ in size.
    """
    if not sightings:
        raise InputError(
            f"--marker {side_m:g}m: no marker of OpenCV's dictionaries is seen; expected one flat "
            "on the ground, with a white border, its side at least 12 pixels long"
        )
    return _Fit(camera, observed(camera, sightings, side_m)).solve(family)


class _Fit:
    """Ground, scale, focal length and layout by least squares.

    Parameters: tilts of the ground about x and z, its height, logarithms of scale and focal length,
    then x, z and turn of each marker, or of the grid with the logarithm of its spacing.
    """

    def __init__(self, camera: SolvedCamera, seen: Corners) -> None:
        self._camera, self._seen = camera, seen
        self._grid: Float64 | None = None
        self._last = seen, 1.0, seen
        errors, fov = camera.errors, math.radians(camera.keys[0].fov_x_deg)
        self._moves, self._still = camera.path == "moving", len(camera.keys) == 1
        self._first = camera.keys[0].world_from_camera
        above = float(camera.keys[0].world_from_camera[1, 3] - camera.ground_y)
        tilts = [math.radians(one) for one in (errors.pitch_deg, errors.roll_deg)]
        stretch = math.radians(errors.fov_deg) / math.sin(fov)
        refined = self._moves and stretch > _FOCAL_KNOWN
        # What is known before: the ground and the focal length that the solve found.
        self._centre = np.array([0.0, 0.0, camera.ground_y, 0.0, 0.0])
        self._spread = np.array([
            *(max(_DOUBT * one, _LEAST_TILT) for one in tilts),
            _HEIGHT_ERROR * above if self._moves else _FREE,
            _FREE if self._moves else _FIXED,
            max(stretch, 1e-4) if self._still else stretch if refined else _FIXED,
        ])  # fmt: skip

    def solve(self, family: str) -> SolvedCamera:
        """The camera above the markers' plane.

        Raises:
            InputError: as `metric_camera`.
        """
        everything = self._seen
        self._seen = everything.largest(_ENOUGH)
        fits = [self._fitted(start) for start in self._starts()]
        if not fits:
            raise InputError(
                "--marker: the marker does not lie flat on the ground below the camera; lay it "
                "there, or leave --marker out"
            )
        head = min(fits, key=lambda one: one[1])[0][:_HEAD]
        self._seen = everything
        params = self._with_layout(head)
        near = self._off(params) <= _OUTLIER_PX
        if near.any() and not near.all():
            self._seen = everything.take(near)
        params = self._all_fitted(head)
        rms = self._rms(params)
        if rms > _WORST_PX:
            raise InputError(
                f"--marker: the markers are {rms:.1f} pixels off one plane with sides of "
                f"{self._seen.side:g} m; expected markers of one size, flat on the ground"
            )
        return self._camera_of(params, family)

    def _starts(self) -> list[Float64]:
        """Both poses of the largest marker that its four corners allow, where it lies flat."""
        seen = self._seen
        largest = int(np.argmax([cv2.contourArea(one.astype(np.float32)) for one in seen.pixels]))
        side = 0.5 * seen.side
        model = np.array([[-side, side, 0], [side, side, 0], [side, -side, 0], [-side, -side, 0]])
        lens = np.diag([seen.focal[largest], seen.focal[largest], 1.0])
        lens[:2, 2] = seen.middle
        _, turns, shifts, _ = cv2.solvePnPGeneric(
            model, seen.pixels[largest], lens, None, flags=cv2.SOLVEPNP_IPPE_SQUARE
        )
        flip = np.diag([1.0, -1.0, -1.0])
        axes = seen.axes[largest]
        eye = -axes.T @ seen.shifts[largest]
        starts = []
        for turn, shift in zip(turns, shifts, strict=True):
            normal = axes.T @ flip @ cv2.Rodrigues(turn)[0][:, 2]
            ray = axes.T @ flip @ shift.ravel()
            if normal[1] < _SLANTED:
                continue
            drop = self._camera.ground_y - eye[1]
            scale = drop / ray[1] if self._moves and drop * ray[1] > 0.0 else 1.0
            tilts = _tilts(normal)
            height = float(normal @ (eye + scale * ray))
            loose = self._spread[4] > _LOOSE
            for stretch in (-_LOOSE, 0.0, _LOOSE) if loose else (0.0,):
                head = np.array([*tilts, height, math.log(scale), stretch])
                starts.append(self._with_layout(head))
        return starts

    def _with_layout(self, head: Float64) -> Float64:
        """The parameters whose layout is that of the corners' rays."""
        seen, turn, height, stretch = self._scene(head)
        layout = seen.layout(turn, height, math.exp(head[3]), stretch)
        return np.concatenate([head, layout.ravel()])

    def _scene(self, params: Float64) -> tuple[Corners, Float64, float, float]:
        """Sightings, the ground's axes and height, and what focal lengths are to be times.

        On a path another focal length stretches the scene, its ground too: the points stay on it.
        """
        turn, height, stretch = ground_axes(*params[:2]), float(params[2]), math.exp(params[4])
        if not self._moves:
            return self._seen, turn, height, stretch
        normal, height = stretched_plane(turn[:, 1], height, stretch, self._first)
        turn = ground_axes(*_tilts(normal))
        # Slopes by the other parameters ask for the same stretch again and again.
        if self._last[0] is not self._seen or self._last[1] != stretch:
            self._last = self._seen, stretch, self._seen.stretched(stretch, self._first)
        return self._last[2], turn, height, 1.0

    def _layout(self, params: Float64) -> Float64:
        if self._grid is None:
            return params[_HEAD:].reshape(-1, 3)
        x, z, yaw, spacing = params[_HEAD:]
        c, s = math.cos(yaw), math.sin(yaw)
        turned = math.exp(spacing) * self._grid @ np.array([[c, s], [-s, c]])
        return np.column_stack([turned + (x, z), np.full(len(turned), yaw)])

    def _apart(self, params: Float64) -> Float64:
        """From the observed corners to the fitted ones (N, 4, 2) [px]."""
        seen, turn, height, stretch = self._scene(params)
        points = seen.world(self._layout(params), turn, height, math.exp(params[3]))
        return seen.project(points, stretch) - seen.pixels

    def _residuals(self, params: Float64) -> Float64:
        known = (params[:_HEAD] - self._centre) / self._spread
        return np.concatenate([(self._apart(params) / _ERROR_PX).ravel(), known])

    def _off(self, params: Float64) -> Float64:
        """Root mean square distance of each sighting's corners (N,) [px]."""
        return np.asarray(np.sqrt((self._apart(params) ** 2).sum(axis=2).mean(axis=1)))

    def _rms(self, params: Float64) -> float:
        return float(np.sqrt((self._off(params) ** 2).mean()))

    def _fitted(self, start: Float64) -> tuple[Float64, float]:
        found = least_squares(
            self._residuals, start, loss="soft_l1", f_scale=3.0, x_scale="jac", max_nfev=100
        )
        return found.x, float(found.cost)

    def _all_fitted(self, head: Float64) -> Float64:
        """The fit of all markers: on one grid if they lie so, else each by itself."""
        free = self._with_layout(head)
        layout = self._layout(free)
        found = as_grid(layout, self._seen.side)
        if found is not None:
            self._grid, yaw, spacing = found
            start = np.array([*head, *layout[0, :2], yaw, math.log(spacing)])
            start[_HEAD : _HEAD + 2] -= self._layout(start)[0, :2] - layout[0, :2]
            fitted, _ = self._fitted(start)
            if self._rms(fitted) < _ON_GRID_PX:
                return fitted
            self._grid = None
        return self._fitted(free)[0]

    def _errors(self, params: Float64) -> Float64:
        """Standard errors of tilts, in the scene as it is stretched, and focal length (3,)."""
        step = 1e-6
        slopes = np.array([
            (self._residuals(params + step * unit) - self._residuals(params - step * unit))
            / (2.0 * step)
            for unit in np.eye(len(params))
        ]).T  # fmt: skip
        worse = max(1.0, float((self._residuals(params)[:-_HEAD] ** 2).mean()))
        spread = (np.linalg.pinv(slopes.T @ slopes) * worse)[:_HEAD, :_HEAD]
        turned = np.array([
            np.subtract(self._lean(params + step * unit), self._lean(params - step * unit))
            / (2.0 * step)
            for unit in np.eye(len(params))[:_HEAD]
        ]).T  # fmt: skip
        return np.sqrt([*np.diag(turned @ spread @ turned.T), spread[4, 4]])

    def _lean(self, params: Float64) -> tuple[float, float]:
        """Tilts of the ground in the scene as it is stretched [rad]."""
        return _tilts(self._scene(params)[1][:, 1])

    def _camera_of(self, params: Float64, family: str) -> SolvedCamera:
        camera, errors = self._camera, self._errors(params)
        _, turn, height, _ = self._scene(params)
        normal, pose = turn[:, 1], self._first
        above = (float(normal @ pose[:3, 3]) - height) / math.exp(params[3])
        if above <= 0.0:
            raise InputError("--marker: the markers lie above the camera; lay them on the ground")
        source, fov_error = camera.fov, camera.errors.fov_deg
        if self._spread[4] > _FIXED:
            fov, source, fov_error = self._lens(params[4], errors[2])
            camera = (
                stretched(camera, math.exp(params[4]))
                if self._moves
                else replace(camera, keys=(replace(camera.keys[0], fov_x_deg=fov),))
            )
        count = self._seen.count
        what = (
            f"a board of {count} markers"
            if self._grid is not None
            else (f"{count} marker{'s' if count > 1 else ''}")
        )
        apart = math.degrees(math.hypot(params[0], params[1])) if self._moves else 0.0
        off = f", {apart:.1f} degrees off the ground of the path's points"
        return replace(
            moved(camera, ground_frame(normal, height, pose, above)),
            ground_y=0.0, fov=source, horizon="measured", scale="metres",
            errors=CameraErrors(
                fov_deg=fov_error, pitch_deg=math.degrees(errors[0]),
                roll_deg=math.degrees(errors[1]),
            ),
            method=f"{camera.method}; ground and scale by {what} ({family})"
            f"{off if apart > _OFF_GROUND_DEG else ''}",
        )  # fmt: skip

    def _lens(self, stretch: float, error: float) -> tuple[float, FovSource, float]:
        """Field of view of the first frame, where it comes from, and its error [deg]."""
        half = math.tan(0.5 * math.radians(self._camera.keys[0].fov_x_deg)) / math.exp(stretch)
        fov = 2.0 * math.atan(half)
        seen = error < min(_FOV_MEASURED, 0.6 * self._spread[4])
        source: FovSource = "measured" if seen else self._camera.fov
        return math.degrees(fov), source, math.degrees(math.sin(fov) * error)


def _tilts(normal: Float64) -> tuple[float, float]:
    """Of a ground about x, then z [rad], as `ground_axes` takes them."""
    return math.atan2(normal[2], normal[1]), -math.asin(normal[0])
