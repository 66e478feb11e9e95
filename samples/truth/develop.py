"""From what Blender leaves to the files of a folder of ground truth (README.md lists them)."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt
import OpenEXR
from glb import Glb
from PIL import Image
from pygltflib import Mesh
from shapes import Part

from truth import subject
from truth.plan import SENSOR_MM, WIDTH, Floats, Lens, View, matrices

Float32 = npt.NDArray[np.float32]
NO_OBJECT_M = 1e10
SKY_M = 1e4
BRIGHT, BRIGHT_PERCENTILE = 0.45, 90.0


@dataclass(frozen=True, slots=True, kw_only=True)
class Take:
    """One focus of a scene: `raw` is the folder that render.py filled; exposure of its pictures."""

    view: View
    lens: Lens
    focus: str
    raw: Path

    @property
    def exposure(self) -> float:
        """Scene-linear to picture-linear, the same for every focus [1]."""
        first = min(self.raw.glob("bg_*.exr"))
        return exposure(self.view.seed, read_rgb(first))

    @property
    def sun(self) -> dict[str, object] | None:
        """The sun, as params.json describes it."""
        found: dict[str, object] | None = json.loads((self.raw / "lights.json").read_text())
        return found


def read_rgb(path: Path) -> Float32:
    """Scene-linear light (H, W, 3)."""
    return np.ascontiguousarray(_pixels(path)[..., :3])


def _pixels(path: Path) -> Float32:
    return np.asarray(OpenEXR.File(str(path)).channels()["RGBA"].pixels, np.float32)


def read_depth(path: Path) -> Float32:
    """Depth along the optical axis (H, W) [m]; 1e10 where nothing is."""
    channels = OpenEXR.File(str(path), separate_channels=True).channels()
    return np.asarray(channels["ViewLayer.Depth.Z"].pixels, np.float32)


def to_code(linear: Float32) -> npt.NDArray[np.uint8]:
    """8-bit display-coded sRGB."""
    light = np.clip(linear, 0.0, 1.0)
    code = np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)
    return np.uint8(255.0 * code + 0.5)


def exposure(seed: int, light: Float32) -> float:
    """What brings the brighter parts of a picture near BRIGHT, more or less; scene to picture."""
    level = float(np.percentile(light.mean(2), BRIGHT_PERCENTILE))
    chance = math.exp(np.random.default_rng([seed, 6]).normal(0.0, 0.25))
    return round(float(np.clip(BRIGHT * chance / max(level, 1e-6), 0.2, 5.0)), 3)


def coc_map(lens: Lens, depth: Float32, width: int) -> npt.NDArray[np.float16]:
    """Signed CoC diameter in pixels of a picture `width` wide, at depths (H, W) [m]."""
    return np.float16(lens.coc_px(depth) * width / WIDTH)


def variance_px2(light: Floats) -> float:
    """Mean of the variances of a spot along x and along y [px^2]."""
    rows, columns = np.arange(light.shape[0]), np.arange(light.shape[1])
    total, found = light.sum(), 0.0
    for profile, axis in ((light.sum(1), rows), (light.sum(0), columns)):
        middle = (profile * axis).sum() / total
        found += 0.5 * float((profile * (axis - middle) ** 2).sum() / total)
    return found


def write_exr(path: Path, channels: dict[str, npt.NDArray[np.floating]]) -> None:
    """Write single channels, ZIP."""
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    with OpenEXR.File(header, channels) as file:
        file.write(str(path))


def _half(light: Float32) -> npt.NDArray[np.float16]:
    return np.ascontiguousarray(np.clip(light, 0.0, 65000.0), np.float16)


def write_plate(take: Take, folder: Path, samples: int) -> None:
    """bg.png, bg.exr, bg_coc.npy, params.json and, if there is one, gt_noshadow.png."""
    light = take.exposure * read_rgb(take.raw / f"bg_{take.focus}.exr")
    depth = read_depth(take.raw / "depth.exr")
    coc = coc_map(take.lens, depth, light.shape[1])
    Image.fromarray(to_code(light)).save(folder / "bg.png")
    write_exr(folder / "bg.exr", {c: _half(light[..., i]) for i, c in enumerate("RGB")})
    np.save(folder / "bg_coc.npy", coc)
    truth = take.raw / f"gt_{take.focus}.exr"
    if truth.exists():
        Image.fromarray(to_code(take.exposure * read_rgb(truth))).save(folder / "gt_noshadow.png")
    shadowed = take.raw / f"shadow_{take.focus}.exr"
    if shadowed.exists():
        picture = take.exposure * read_rgb(shadowed)
        Image.fromarray(to_code(picture)).save(folder / "gt.png")
        write_exr(folder / "bg_depth.exr", {"Z": np.minimum(depth, np.float32(SKY_M))})
        write_around(take, folder / "env.hdr")
    known = params(take, light.shape[:2]) | {
        "coc_bg_px_max": float(np.abs(coc.astype(np.float32)).max()),
        "sun": take.sun,
        "samples_dof": samples,
    }
    (folder / "params.json").write_text(json.dumps(known, indent=1))


def write_around(take: Take, path: Path) -> None:
    """The light around the object, with the sun's, which the panorama leaves out, as a disc."""
    around = read_rgb(take.raw / "around.exr").astype(np.float64)
    sun = json.loads((take.raw / "lights.json").read_text())
    if sun:
        height, width = around.shape[:2]
        up = math.pi * (0.5 - (np.arange(height) + 0.5) / height)[:, None]
        turn = 2.0 * math.pi * ((np.arange(width) + 0.5) / width - 0.5)[None]
        x, z = np.cos(up) * np.cos(turn), np.cos(up) * np.sin(turn)
        directions = np.stack([x, np.broadcast_to(np.sin(up), x.shape), z], axis=-1)
        solid = np.cos(up) * (math.pi / height) * (2.0 * math.pi / width)
        cosine = directions @ -np.array(sun["direction_gltf"])
        radius = max(math.radians(0.5 * float(sun["angle_deg"])), 2.0 * math.pi / width)
        disc = (cosine >= math.cos(radius)) * solid
        power = float(sun["irradiance_w_m2"]) * np.array(sun["color"])
        around += (disc > 0.0)[..., None] * power / disc.sum()
    cv2.imwrite(str(path), np.float32(take.exposure * around)[..., ::-1])


def params(take: Take, size: tuple[int, int]) -> dict[str, object]:
    """What is known before rendering, for params.json; `size` is height and width [px]."""
    view, lens = take.view, take.lens
    near, _, far = subject.depths(view, subject.mesh(view))
    return {
        "resolution": [size[1], size[0]],
        "focal_length_mm": lens.focal_mm,
        "sensor_width_mm": SENSOR_MM,
        "sensor_height_mm": SENSOR_MM * size[0] / size[1],
        "f_stop": lens.f_number,
        "focus_distance_m": lens.focus_m,
        "aperture_diameter_mm": lens.focal_mm / lens.f_number,
        "aperture_blades": lens.blades,
        "cat_eye": lens.cat_eye,
        "blender_fstop_set": lens.blender_f_number,
        "coc_at_infinity_px": lens.coc_at_infinity_px * size[1] / WIDTH,
        "coc_law": "diameter_px = A*f/(zf-f) * |z-zf|/z * W_px/sensor_w, A=f/N; "
        "z = camera-space depth (planar) in metres; signed files: + in front of the focal plane",
        "yfov_rad": view.yfov,
        **matrices(view),
        "ground_plane_y_gltf": 0.0,
        "object_depth_range_m": [near, far],
        "coc_object_px": sorted(abs(float(lens.coc_px(z)) * size[1] / WIDTH) for z in (near, far)),
        "film_exposure": take.exposure,
        "tier": "truth",
        "scene": f"{view.ground or view.setting} {view.seed}",
        "focus": take.focus,
    }


def write_object(take: Take, folder: Path) -> None:
    """object.exr, object_rgba.png, object_coc.npy, object_depth.npz."""
    layer = _pixels(take.raw / "object.exr") * np.float32([*[take.exposure] * 3, 1.0])
    depth = read_depth(take.raw / "object_depth.exr")
    held = depth < 0.5 * NO_OBJECT_M
    depth = np.where(held, depth, np.float32(NO_OBJECT_M)).astype(np.float32)
    channels = {c: _half(layer[..., i]) for i, c in enumerate("RGBA")}
    write_exr(folder / "object.exr", {**channels, "Z": depth})
    alpha = np.clip(layer[..., 3:], 0.0, 1.0)
    straight = to_code(layer[..., :3] / np.maximum(alpha, 1e-6))
    rgba = np.concatenate([straight * (alpha > 0), np.uint8(255.0 * alpha + 0.5)], axis=2)
    Image.fromarray(rgba, "RGBA").save(folder / "object_rgba.png")
    coc = np.where(held, coc_map(take.lens, depth, depth.shape[1]), np.float16(0.0))
    np.save(folder / "object_coc.npy", coc)
    np.savez_compressed(folder / "object_depth.npz", depth=depth)


def write_glb(view: View, body: Part, sun: dict[str, object] | None, folder: Path) -> None:
    """The object, Y up, flat-shaded as rendered, with the camera and the sun."""
    corners = body.triangles.ravel()
    positions = body.positions[corners][:, [0, 2, 1]] * np.array([1.0, 1.0, -1.0])
    triangles = np.arange(len(corners)).reshape(-1, 3)
    side = np.cross(positions[1::3] - positions[::3], positions[2::3] - positions[::3])
    side /= np.maximum(np.linalg.norm(side, axis=1, keepdims=True), 1e-12)
    file = Glb()
    file.gltf.animations = []
    paint = file.material("paint", file.texture(subject.paint(view)), 1.0, matt=True)
    normals = np.repeat(side, 3, axis=0)
    mesh = file.primitive(positions, normals, body.uv[corners], triangles, paint)
    file.gltf.meshes.append(Mesh(name="object", primitives=[mesh]))
    file.node("object", mesh=0)
    file.camera(view, view.roll_deg)
    if sun:
        towards = [-float(v) for v in sun["direction_gltf"]]
        lamp = {"name": "sun", "towards": towards}
        lamp |= {"colour": sun["color"], "intensity": sun["irradiance_w_m2"]}
        file.lights([lamp])
    file.save(folder / "object.glb")
