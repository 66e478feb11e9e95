"""A plate's camera: pose and field of view of each frame, where they come from, `camera.json`."""

from __future__ import annotations

import bisect
import json
import math
from typing import Literal

import cv2
import numpy as np
from msgspec import Struct, field
from msgspec.structs import asdict, replace

from nlens_video.core.box import Box, half_diagonal, undistorted_radius
from nlens_video.core.errors import SceneError
from nlens_video.core.layers import Float64
from nlens_video.core.optics import Distortion
from nlens_video.scene.camera import Camera

FovSource = Literal["measured", "metadata", "assumed"]
HorizonSource = Literal["measured", "assumed"]
PathKind = Literal["still", "rotation", "moving", "assumed"]
Scale = Literal["metres", "arbitrary"]

_RIGID = 1e-3  # rotations read from text are orthonormal to about six digits
GIVEN_FOV = "field of view by --fov"
"""In the method of a camera whose field of view the user gave: `fov` knows metadata only."""
LARGEST = 1e9
"""Numbers beyond that are taken for mistakes."""


class CameraKey(Struct, frozen=True, kw_only=True, eq=False):
    """The camera of one frame.

    Attributes:
        index: frame of the plate, counted from 0.
        pts_s: presentation time [s].
        world_to_camera: rigid transform (4, 4), glTF axes [scene unit].
        fov_x_deg: field of view across the frame's width, in (0, 180) [deg].
    """

    index: int
    pts_s: float
    world_to_camera: Float64
    fov_x_deg: float

    @property
    def world_from_camera(self) -> Float64:
        """Pose (4, 4)."""
        rotation, shift = self.world_to_camera[:3, :3], self.world_to_camera[:3, 3]
        pose = np.eye(4)
        pose[:3, :3] = rotation.T
        pose[:3, 3] = -rotation.T @ shift
        return pose

    @property
    def pitch_deg(self) -> float:
        """Elevation of the optical axis, negative when the camera looks down [deg]."""
        return -math.degrees(math.asin(float(np.clip(self.world_to_camera[2, 1], -1.0, 1.0))))

    @property
    def roll_deg(self) -> float:
        """Turn about the optical axis: positive where the world's up leans right [deg]."""
        right, up = self.world_to_camera[:2, 1]
        return math.degrees(math.atan2(float(right), float(up)))


class CameraErrors(Struct, frozen=True, kw_only=True):
    """Standard errors; the defaults are those of a camera about which nothing is known [deg]."""

    fov_deg: float = 20.0
    pitch_deg: float = 18.0
    roll_deg: float = 3.0


class SolvedCamera(Struct, frozen=True, kw_only=True, eq=False):
    """The camera of a plate, in a world whose ground is horizontal.

    Attributes:
        width: columns of the plate [px].
        height: rows of the plate [px].
        keys: frames in the order of time, at least one; a still camera has one.
        ground_y: height of the ground [scene unit].
        fov: where the field of view comes from.
        horizon: where pitch and roll come from.
        path: how the camera moves.
        scale: whether the scene unit is the metre.
        errors: standard errors of the first frame.
        method: how it was solved, in a few words.
        principal_px: principal point, pixel centres at +0.5, None for the frame's middle [px].
        distortion_k1: of the lens, by focal lengths, as OpenCV's k1: what a pinhole sees at radius
            r from the principal point lies at r (1 + k1 r²) [1].
        place: column and row of the first frame where an object stands on the ground in no one's
            way, None where that is not known [frame width, frame height].
        place_guessed: whether nothing in the plate tells that the place is on the ground.
        reprojection_px: median distance of tracked points from where the cameras see them, None
            where no point was tracked [px].
        points: points of the scene that were solved with it (N, 3), None without; of scene files,
            not of `camera.json` [scene unit].
        pixel_aspect: width of a pixel by its height, > 0 [1].
        fov_told_deg: field of view that the movement tells and its standard error, where that
            contradicts a given one, which is kept; not of `camera.json` [deg].
        missed_lines: ends x0, y0, x1, y1 of segments whose lines were to be ignored, and along
            which there is none; not of `camera.json` [frame width, frame height].
    """

    width: int
    height: int
    keys: tuple[CameraKey, ...]
    ground_y: float = 0.0
    fov: FovSource = "assumed"
    horizon: HorizonSource = "assumed"
    path: PathKind = "still"
    scale: Scale = "arbitrary"
    errors: CameraErrors = field(default_factory=CameraErrors)
    method: str = ""
    principal_px: tuple[float, float] | None = None
    distortion_k1: float = 0.0
    place: tuple[float, float] | None = None
    place_guessed: bool = False
    reprojection_px: float | None = None
    points: Float64 | None = None
    pixel_aspect: float = 1.0
    fov_told_deg: tuple[float, float] | None = None
    missed_lines: tuple[tuple[float, ...], ...] = ()

    @property
    def distortion(self) -> Distortion | None:
        """Of the lens, None for a pinhole."""
        k1 = self.distortion_k1
        return Distortion(k1=k1, focal_normalized=True) if k1 else None

    @property
    def aspect(self) -> float:
        """Width of the frame by its height, as it is displayed [1]."""
        return self.width * self.pixel_aspect / self.height

    @property
    def fov_source(self) -> str:
        """Where the field of view comes from, in words."""
        if self.fov != "metadata":
            return self.fov
        return "given" if GIVEN_FOV in self.method else "from metadata"

    def at(self, time_s: float) -> Camera:
        """The camera at a time, interpolated between frames and held beyond them.

        Rotations turn at a constant rate between two frames; positions and fields of view change
        linearly.

        Args:
            time_s: time of the plate [s].
        """
        times = [key.pts_s for key in self.keys]
        after = bisect.bisect_right(times, time_s)
        if after in (0, len(times)):
            key = self.keys[min(after, len(times) - 1)]
            return self._camera(key.world_from_camera, key.fov_x_deg)
        first, second = self.keys[after - 1], self.keys[after]
        share = (time_s - first.pts_s) / (second.pts_s - first.pts_s)
        start, end = first.world_from_camera, second.world_from_camera
        turn = cv2.Rodrigues(start[:3, :3].T @ end[:3, :3])[0]
        pose = np.eye(4)
        pose[:3, :3] = start[:3, :3] @ cv2.Rodrigues(share * turn)[0]
        pose[:3, 3] = (1.0 - share) * start[:3, 3] + share * end[:3, 3]
        return self._camera(pose, (1.0 - share) * first.fov_x_deg + share * second.fov_x_deg)

    def resized(
        self, width: int, height: int, pixel_aspect: float | None = None
    ) -> SolvedCamera:  # fmt: skip
        """The same camera for another size of the plate.

        Args:
            width: columns [px].
            height: rows [px].
            pixel_aspect: width of a pixel by its height; None: as here where the frame has the
                same shape in pixels, else square [1].

        Raises:
            SceneError: the shape of the frame differs by more than a pixel, both as rows and
                columns are counted and as it is displayed.
        """
        scale = width / self.width
        same = self.fits(width, height)
        wanted = pixel_aspect or (self.pixel_aspect if same else 1.0)
        rows = self.height * scale * wanted / self.pixel_aspect  # of the same picture, displayed
        if not same and abs(rows - height) > 1.0 + scale:
            own = _frame(self.width, self.height, self.pixel_aspect)
            raise SceneError(
                f"the camera is of a plate of {own}, the plate has "
                f"{_frame(width, height, wanted)}; solve the camera of this plate"
            )
        point, down = self.principal_px, scale if same else height / self.height
        return replace(
            self, width=width, height=height, pixel_aspect=wanted,
            principal_px=None if point is None else (point[0] * scale, point[1] * down),
        )  # fmt: skip

    def fits(self, width: int, height: int) -> bool:
        """Whether a frame has the same shape, counted in rows and columns, but for a pixel."""
        scale = width / self.width
        return abs(self.height * scale - height) <= 1.0 + scale

    def _camera(self, pose: Float64, fov_x_deg: float) -> Camera:
        focal = 0.5 * self.width / math.tan(0.5 * math.radians(fov_x_deg))
        middle = 0.5 * self.width, 0.5 * self.height
        column, row = self.principal_px or middle
        return Camera(
            world_from_camera=pose, fx=focal, fy=focal * self.pixel_aspect, cx=column, cy=row,
            width=self.width, height=self.height,
        )  # fmt: skip

    def to_json(self) -> str:
        """The text of `camera.json`.

        Raises:
            ValueError: a number is not finite, which JSON cannot say.
        """
        values: dict[str, object] = {
            "width": self.width,
            "height": self.height,
            "frames": [
                {
                    "index": key.index,
                    "pts_s": key.pts_s,
                    "world_to_camera": key.world_to_camera.tolist(),
                    "fov_x_deg": key.fov_x_deg,
                }
                for key in self.keys
            ],
            "ground_y": self.ground_y,
            "fov": self.fov,
            "horizon": self.horizon,
            "path": self.path,
            "scale": self.scale,
            "stderr": asdict(self.errors),
            "method": self.method,
        }
        if self.pixel_aspect != 1.0:
            values["pixel_aspect"] = self.pixel_aspect
        if self.principal_px is not None:
            values["principal_px"] = list(self.principal_px)
        if self.distortion_k1:
            values["distortion_k1"] = self.distortion_k1
        if self.place is not None:
            values["place"] = list(self.place)
        if self.place_guessed:
            values["place_guessed"] = True
        if self.reprojection_px is not None:
            values["reprojection_px"] = self.reprojection_px
        return json.dumps(values, indent=1, allow_nan=False) + "\n"


def _frame(width: int, height: int, pixel_aspect: float) -> str:
    """A frame's size, in words."""
    square = abs(pixel_aspect - 1.0) < 1e-6
    return f"{width}x{height}" + ("" if square else f" with pixels of {pixel_aspect:.4g}:1")


def undistorted(pixels: Float64, camera: Camera, lens: Distortion | None) -> Float64:
    """Where a pinhole sees what a lens with distortion shows.

    Args:
        pixels: places in the plate (N, 2) [px].
        camera: the pinhole.
        lens: its distortion, None for a pinhole.

    Returns:
        Places (N, 2) [px]; those that no pinhole sees stay.
    """
    if lens is None or not len(pixels):
        return pixels
    centre, unit = (camera.cx, camera.cy), (camera.fx, camera.fy)
    if not lens.focal_normalized:
        half = half_diagonal(Box(0, 0, camera.width, camera.height))
        centre, unit = (0.5 * camera.width, 0.5 * camera.height), (half, half)
    flat = (pixels - centre) / unit
    far = np.linalg.norm(flat, axis=1)
    scale = undistorted_radius(lens.k1, lens.k2, far) / np.maximum(far, 1e-9)
    scale[~np.isfinite(scale) | (far < 1e-9)] = 1.0
    return np.asarray(flat * scale[:, None] * unit + centre)


def rigid_matrix(raw: object) -> Float64 | None:
    """A rigid transform (4, 4) from rows of numbers, None for anything else."""
    try:
        matrix = np.array(raw, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        return None
    if matrix.shape != (4, 4) or not (abs(matrix) <= LARGEST).all():
        return None
    turn = matrix[:3, :3]
    rigid = np.allclose(turn @ turn.T, np.eye(3), atol=_RIGID) and np.linalg.det(turn) > 0.0
    return matrix if rigid and np.allclose(matrix[3], (0.0, 0.0, 0.0, 1.0)) else None
