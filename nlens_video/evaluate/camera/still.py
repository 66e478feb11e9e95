"""The CoC that an object gets by a solved camera, against the true one.

The object is placed under the solved camera as its user places it, moved, turned and scaled as a
whole until it covers the same pixels: the foot (the middle of its footprint) keeps its pixel p and
stands where the ray through p meets the solved ground; seen from there it is as large as before,
size' f' / z' = size f / z; upright on the solved ground, it shows the camera the same side. Each
point of its surface keeps the CoC that the true lens gave it.
"""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import numpy.typing as npt
from msgspec import Struct

from nlens_video.core.errors import InputError, LensFitError
from nlens_video.core.layers import Bool, CocMap, Float32, Float64
from nlens_video.core.lens_fit import LensFit
from nlens_video.evaluate.camera.truth import Known
from nlens_video.evaluate.metrics import rms_within
from nlens_video.scene import Camera, Scene
from nlens_video.stages.p_projection import project_to_ground
from nlens_video.stages.r_regression import FitLens

Int64 = npt.NDArray[np.int64]
OBJECT, GROUND = "object.glb", "bg_coc.npy"
WIDTH_PX = 960
"""Errors of the CoC count pixels of a frame of this width."""
_IS_GROUND_PX = 0.5  # a pixel shows the ground where its true CoC is that of the ground


class Subject(Struct, frozen=True, kw_only=True, eq=False):
    """What is to be blurred, under the true camera.

    Attributes:
        camera: the true camera.
        triangles: the object in the true world (T, 3, 3), none for bare ground [m].
        points: places whose CoC is compared (N, 3) [m].
        coc_px: their true signed CoC diameter (N,) [px of the plate].
        foot: the object's foot on the true ground (3,) [m].
    """

    camera: Camera
    triangles: Float64
    points: Float64
    coc_px: Float32
    foot: Float64

    def under(self, found: Camera, ground_y: float) -> tuple[Float64, Float64]:
        """Triangles (T, 3, 3) and points (N, 3) as they are placed under a solved camera.

        Raises:
            InputError: its ground does not lie under the foot's pixel.
        """
        seen = self.camera.to_camera(self.foot[None])
        depth = -float(seen[0, 2])
        feet, depths = found.ground_seen_at(self.camera.pixels(seen), ground_y)
        foot, new_depth = feet[0], float(depths[0])
        if not (depth > 0.0 and new_depth > 0.0):
            raise InputError("the object's foot lies above the horizon")
        size = new_depth * self.camera.fy / (depth * found.fy)
        turn = _about_y(_heading(found.world_from_camera) - _heading(self.camera.world_from_camera))

        def moved(places: Float64) -> Float64:
            return np.asarray(foot + size * (places - self.foot) @ turn.T)

        return moved(self.triangles), moved(self.points)


def coc_rms(subject: Subject, coc: CocMap, camera: Camera, ground_y: float) -> float:
    """Error of the CoC with a camera, infinite where none is found [px of WIDTH_PX].

    Args:
        subject: the object.
        coc: the plate's estimated CoC.
        camera: solved, or the true one.
        ground_y: its ground [scene unit].
    """
    try:
        triangles, points = subject.under(camera, ground_y)
        fit = FitLens()(coc, project_to_ground(triangles, camera, ground_y)).fit
    except (InputError, LensFitError):
        return math.inf
    depth = -camera.to_camera(points)[:, 2]
    if not (depth > 0.0).all():
        return math.inf
    found = fit.coc_px(np.asarray(1.0 / depth, np.float32))
    everywhere = np.ones(found.shape, np.bool_)
    return rms_within(found, subject.coc_px, everywhere) * WIDTH_PX / camera.width


def subject_of(known: Known) -> Subject | None:
    """The object of a still, bare ground where there is none; None where no lens is known.

    Raises:
        InputError: a file that is there cannot be read.
        SceneError: the object cannot be used.
    """
    if known.lens is None:
        return None
    camera = known.camera.at(0.0)
    if (known.folder / OBJECT).is_file():
        return _object(known.folder, camera, known.camera.ground_y, known.lens)
    if (known.folder / GROUND).is_file():
        return _ground(known.folder, camera, known.camera.ground_y, known.lens)
    return None


def _object(folder: Path, camera: Camera, ground_y: float, lens: LensFit) -> Subject | None:
    """The GLB's object at rest, None where it is out of view."""
    from nlens_video.render.software.renderer import SoftwareObjectRenderer

    scene = Scene.load(folder / OBJECT)
    with SoftwareObjectRenderer(scene) as renderer:
        layer = renderer.render(0.0, camera)
    if layer is None:
        return None
    solid = (layer.rgba[..., 3] >= 1.0 - 1e-4) & np.isfinite(layer.depth)
    rows, columns = np.nonzero(solid)
    if not len(rows):
        return None
    depth = layer.depth[solid].astype(np.float64)
    points = _lifted(camera, columns + layer.box.x0, rows + layer.box.y0, depth)
    positions, faces = scene.pose(0.0).triangles()
    triangles = positions[faces].astype(np.float64)
    corners = triangles.reshape(-1, 3)
    foot = 0.5 * (corners.min(axis=0) + corners.max(axis=0))
    foot[1] = ground_y
    return Subject(
        camera=camera, triangles=triangles, points=points, foot=foot,
        coc_px=lens.coc_px(np.asarray(1.0 / depth, np.float32)),
    )  # fmt: skip


def _ground(folder: Path, camera: Camera, ground_y: float, lens: LensFit) -> Subject | None:
    """Ground in the lower middle of the frame, where objects are put; None where none is seen."""
    try:
        coc = np.asarray(np.load(folder / GROUND, allow_pickle=False), np.float32)
    except (OSError, ValueError, EOFError) as error:
        raise InputError(f"{folder / GROUND}: cannot be read as a numpy array ({error})") from error
    if coc.shape != (camera.height, camera.width):
        raise InputError(
            f"{folder / GROUND}: shape {coc.shape}, expected {(camera.height, camera.width)}"
        )
    disparity = camera.plane_disparity(ground_y)
    shown: Bool = disparity > 0.0
    shown &= np.abs(lens.coc_px(disparity.astype(np.float32)) - coc) < _IS_GROUND_PX
    shown[: camera.height // 3] = False
    shown[:, : camera.width // 4] = shown[:, -camera.width // 4 :] = False
    rows, columns = np.nonzero(shown)
    if not len(rows):
        return None
    points = _lifted(camera, columns, rows, 1.0 / disparity[shown])
    return Subject(
        camera=camera, triangles=np.zeros((0, 3, 3)), points=points, coc_px=coc[shown],
        foot=np.median(points, axis=0),
    )  # fmt: skip


def _lifted(camera: Camera, columns: Int64, rows: Int64, depth: Float64) -> Float64:
    """World points (N, 3) of pixels at depths (N,) [m]."""
    x, y = (columns + 0.5 - camera.cx) / camera.fx, -(rows + 0.5 - camera.cy) / camera.fy
    seen = depth[:, None] * np.stack([x, y, -np.ones_like(x)], axis=1)
    pose = camera.world_from_camera
    return np.asarray(seen @ pose[:3, :3].T + pose[:3, 3])


def _heading(pose: Float64) -> float:
    """Turn of a camera about the world's up [rad]."""
    return math.atan2(pose[0, 2], pose[2, 2])


def _about_y(angle: float) -> Float64:
    c, s = math.cos(angle), math.sin(angle)
    return np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
