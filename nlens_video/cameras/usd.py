"""Camera paths as OpenUSD: an animated camera, a grid on the ground and the points of the solve.

Times count in time codes from the stage's first one. The horizontal aperture gives the field of
view, as rows are conformed to the plate's shape; offsets of the aperture give the principal point.
"""

from __future__ import annotations

import importlib.util
import json
import math
import subprocess
import sys
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from msgspec.structs import replace

from nlens_video.cameras.camera_json import DESCRIPTION, described_camera, description
from nlens_video.cameras.fspy import Y_UP_FROM_Z_UP
from nlens_video.cameras.ground_grid import ground_lines, on_ground_zero, square_size
from nlens_video.cameras.solved import CameraKey, SolvedCamera
from nlens_video.core.errors import SceneError, UsageError
from nlens_video.core.layers import Float64
from nlens_video.scene.camera import rigid

if TYPE_CHECKING:
    from pxr import Usd, UsdGeom

SUFFIXES = (".usda", ".usdc", ".usd", ".usdz")
_FILM_MM = 36.0  # longer side of the aperture, as photographers count focal lengths
_NEAR, _FAR = 0.05, 1000.0  # what is drawn [squares of the grid]
_LINE, _POINT = 0.01, 0.02  # widths in the scene [squares of the grid]
_SECONDS = 120
_STRAYS_PX = 0.5  # of a principal point that stays
_CENTRED_PX = 1e-3  # nearer to the middle is the middle: apertures are single floats
_RATE = 24.0  # of a still camera's stage


def require_usd(path: Path) -> None:
    """Refuse before any work where OpenUSD is missing.

    Raises:
        UsageError: it is not installed.
    """
    if importlib.util.find_spec("pxr") is None:
        raise UsageError(f"{path}: USD needs usd-core; install nlens-video[usd]")


def to_usda(camera: SolvedCamera) -> bytes:
    """The bytes of a `.usda` file; time code 0 is the plate's first frame.

    Raises:
        UsageError: OpenUSD is not installed.
    """
    require_usd(Path("camera.usda"))
    from pxr import Usd, UsdGeom

    camera = on_ground_zero(camera)
    stage = Usd.Stage.CreateInMemory("camera.usda")
    rate, codes = _time_codes(camera)
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    stage.SetTimeCodesPerSecond(rate)
    stage.SetFramesPerSecond(rate)
    stage.SetStartTimeCode(0.0)
    stage.SetEndTimeCode(max(codes[-1], 0.0))
    stage.GetRootLayer().customLayerData = {DESCRIPTION: json.dumps(description(camera))}
    stage.SetDefaultPrim(UsdGeom.Xform.Define(stage, "/world").GetPrim())
    _add_camera(stage, camera, codes)
    side = square_size(camera)
    lines = ground_lines(camera)
    grid = UsdGeom.BasisCurves.Define(stage, "/world/ground")
    grid.CreateTypeAttr(UsdGeom.Tokens.linear)
    grid.CreateCurveVertexCountsAttr([2] * len(lines))
    _set_points(grid, lines.reshape(-1, 3), _LINE * side)
    if camera.points is not None and len(camera.points):
        cloud = UsdGeom.Points.Define(stage, "/world/points")
        _set_points(cloud, camera.points, _POINT * side)
    return str(stage.GetRootLayer().ExportToString()).encode()


def _add_camera(stage: Usd.Stage, camera: SolvedCamera, codes: list[float]) -> None:
    from pxr import Gf, Usd, UsdGeom

    lens = UsdGeom.Camera.Define(stage, "/world/camera")
    lens.CreateProjectionAttr(UsdGeom.Tokens.perspective)
    wide = camera.width * camera.pixel_aspect
    millimetres = _FILM_MM / max(wide, camera.height) * camera.pixel_aspect  # a pixel across
    upright = millimetres / camera.pixel_aspect
    lens.CreateHorizontalApertureAttr(millimetres * camera.width)
    lens.CreateVerticalApertureAttr(upright * camera.height)
    if camera.principal_px is not None:
        column, row = camera.principal_px
        lens.CreateHorizontalApertureOffsetAttr(millimetres * (0.5 * camera.width - column))
        lens.CreateVerticalApertureOffsetAttr(upright * (row - 0.5 * camera.height))
    side = square_size(camera)
    lens.CreateClippingRangeAttr(Gf.Vec2f(_NEAR * side, _FAR * side))
    place = lens.AddTranslateOp(UsdGeom.XformOp.PrecisionDouble)
    turn = lens.AddOrientOp(UsdGeom.XformOp.PrecisionDouble)
    focal = lens.CreateFocalLengthAttr()
    from scipy.spatial.transform import Rotation  # here: scipy takes long to load

    always = Usd.TimeCode.Default()
    zooms = len({key.fov_x_deg for key in camera.keys}) > 1
    for code, key in zip(codes, camera.keys, strict=True):
        when = Usd.TimeCode(code) if codes[1:] else always
        pose = key.world_from_camera
        x, y, z, w = Rotation.from_matrix(pose[:3, :3]).as_quat().tolist()
        place.Set(Gf.Vec3d(pose[:3, 3].tolist()), when)
        turn.Set(Gf.Quatd(w, x, y, z), when)
        half = math.tan(0.5 * math.radians(key.fov_x_deg))
        focal.Set(0.5 * millimetres * camera.width / half, when if zooms else always)


def _set_points(prim: UsdGeom.PointBased, positions: Float64, width: float) -> None:
    """Give lines or points their positions (N, 3), extent and width."""
    from pxr import UsdGeom, Vt

    there = Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(positions, np.float32))
    prim.CreatePointsAttr(there)
    prim.CreateExtentAttr(UsdGeom.PointBased.ComputeExtent(there))
    prim.CreateWidthsAttr([width])
    prim.SetWidthsInterpolation(UsdGeom.Tokens.constant)


def from_usd(
    path: Path, size: tuple[int, int], rate: Fraction, pixel_aspect: float = 1.0
) -> SolvedCamera:
    """Read a stage's first perspective camera, at all its time codes.

    The plate's first frame is the stage's first time code, and the ground y = 0 (z = 0 where Z is
    up). A stage that does not say how many time codes a second has counts the plate's frames.

    Args:
        path: a `.usda`, `.usdc`, `.usd` or `.usdz` file.
        size: columns and rows of the plate [px].
        rate: frames a second of the plate.
        pixel_aspect: width of a pixel of the plate by its height [1].

    Raises:
        SceneError: it cannot be read, or holds no camera that can be used.
        UsageError: OpenUSD is not installed.
    """
    require_usd(path)
    try:
        return _camera(_found(path), size, rate, pixel_aspect)
    except SceneError as error:
        raise SceneError(f"{path}: {error}") from error


def layers_beside(path: Path) -> list[Path]:
    """Files of the layers that a stage with a camera refers to, by name; none of a broken one.

    Raises:
        UsageError: OpenUSD is not installed.
    """
    require_usd(path)
    try:
        layers = [Path(name) for name in _found(path)["layers"]]
    except SceneError:
        return []  # reported where it is read
    return [layer for layer in layers if layer.is_file() and layer != path.resolve()]


def _found(path: Path) -> dict[str, Any]:
    """What the worker says of a file's camera."""
    if not path.is_file():
        raise SceneError("cannot be read as USD; expected a .usda, .usdc, .usd or .usdz file")
    # By its path, so that it need not load this package.
    worker = Path(__file__).with_name("usd_worker.py")
    command = [sys.executable, "-P", str(worker), str(path.resolve())]
    try:
        run = subprocess.run(command, capture_output=True, timeout=_SECONDS, check=False)
    except (OSError, subprocess.TimeoutExpired) as error:
        raise SceneError(f"cannot be read as USD ({error})") from error
    if run.returncode != 0:
        raise SceneError("cannot be read as USD; it is damaged")
    found: dict[str, Any] = json.loads(run.stdout)
    if "fault" in found:
        raise SceneError(str(found["fault"]))
    return found


def _time_codes(camera: SolvedCamera) -> tuple[float, list[float]]:
    """Time codes a second, and that of each key: the frame's number where frames are even."""
    first, last = camera.keys[0], camera.keys[-1]
    rate = _RATE
    if last.pts_s > first.pts_s and last.index > first.index:
        rate = float(
            Fraction((last.index - first.index) / (last.pts_s - first.pts_s)).limit_denominator(
                1001
            )
        )
    codes = [key.pts_s * rate for key in camera.keys]
    whole = [float(round(code)) for code in codes]
    return rate, [
        even if abs(code - even) < 1e-6 else code for code, even in zip(codes, whole, strict=True)
    ]


def _camera(
    found: dict[str, Any], size: tuple[int, int], rate: Fraction, pixel_aspect: float
) -> SolvedCamera:
    """The camera of what the worker found."""
    where, metres = found["camera"], found["metres"]
    per_second = float(rate) if found["codes_per_s"] is None else found["codes_per_s"]
    frames = np.array(found["frames"], dtype=np.float64)
    times = np.array(found["codes"], dtype=np.float64) - found["codes"][0]
    if not (per_second > 0.0 and np.isfinite(times / per_second).all()):
        raise SceneError(f"camera {where}: {per_second:g} time codes a second")
    if not (np.isfinite(frames).all() and np.isfinite(metres or 1.0)):
        raise SceneError(f"camera {where}: its place or its lens is no finite number")
    focal, aperture, across, up = frames[:, 16:].T
    if not (min(focal.min(), aperture.min()) > 0.0):
        raise SceneError(
            f"camera {where}: a focal length of {focal.min():g} with an aperture of "
            f"{aperture.min():g}; expected lengths above 0"
        )
    pixels = size[0] / aperture
    columns, rows = 0.5 * size[0] - pixels * across, 0.5 * size[1] + pixels * pixel_aspect * up
    points = np.stack([columns, rows], axis=1)
    if np.ptp(points, axis=0).max() > _STRAYS_PX:
        raise SceneError(f"camera {where}: its aperture's offset is animated; expected one for all")
    axes = Y_UP_FROM_Z_UP if found["z_up"] else np.eye(4)
    keys = []
    for time_s, frame in zip((times / per_second).tolist(), frames, strict=True):
        pose = rigid(axes @ frame[:16].reshape(4, 4).T)
        pose[:3, 3] *= metres or 1.0
        keys.append(
            CameraKey(
                index=round(time_s * rate), pts_s=time_s,
                world_to_camera=np.asarray(np.linalg.inv(pose)),
                fov_x_deg=2.0 * math.degrees(math.atan(0.5 * frame[17] / frame[16])),
            )
        )  # fmt: skip
    camera = described_camera(
        keys, size, _description(found["description"]), f"camera {where}", pixel_aspect,
        scale="arbitrary" if metres is None else "metres", method="OpenUSD",
    )  # fmt: skip
    middle = (0.5 * size[0], 0.5 * size[1])
    centred = bool(abs(points[0] - middle).max() < _CENTRED_PX)
    point = None if centred else (float(points[0, 0]), float(points[0, 1]))
    return replace(camera.resized(*size, pixel_aspect), principal_px=point)


def _description(text: object) -> dict[str, object]:
    """What our own files say beside the camera; the principal point is that of the aperture."""
    try:
        said = json.loads(text) if isinstance(text, str) else None
    except (ValueError, RecursionError):
        said = None
    known = said if isinstance(said, dict) else {}
    return {name: value for name, value in known.items() if name != "principal_px"}
