"""Conditions under which the CoC is judged: a codec, noise, another size, a wrong field of view.

A user's camera is a guess. Its pose is kept, its focal length f is f' = s f with s = tan(yfov / 2)
/ tan(yfov' / 2), and the user then moves and scales the object (rigidly: one factor for all axes)
until it stands where it stood:

- The foot, the middle of the footprint on the ground, keeps its pixel p: the ray through p under
  f' meets the plane y = ground_y at the new foot, at depth z' instead of z.
- The size in the picture at the foot, k f' / z', is that of f / z: so k = z' / (s z).

Contact, footprint and height thus match at the foot; away from it the pixels differ only by what a
wrong perspective changes, which is the error under test. Each point of the object's surface keeps
the CoC that the true lens gave it.
"""

from __future__ import annotations

import io
import math
from collections.abc import Callable, Mapping
from functools import partial

import cv2
import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from nlens_video.core.errors import SceneError
from nlens_video.core.layers import Float32, Float64
from nlens_video.scene.camera import Camera

CRF = 28
NOISE = 0.02  # standard deviation, part of the full code range
WIDTHS = (480, 640, 1920, 3840)
YFOV_RATIOS = (0.85, 1.15)
_SEED = 20  # of the noise: every run sees the same


def with_noise(rgb: Float32, deviation: float = NOISE) -> Float32:
    """Add white Gaussian noise in display code; 8-bit codes in [0, 1] (H, W, 3) come out."""
    noise = np.random.default_rng(_SEED).normal(0, deviation, rgb.shape)
    return _eight_bit(np.asarray(rgb + noise, np.float32))


def scaled(rgb: Float32, width: int) -> Float32:
    """The picture at another width [px]; its height follows to the nearest pixel."""
    height = max(1, round(rgb.shape[0] * width / rgb.shape[1]))
    way = cv2.INTER_AREA if width < rgb.shape[1] else cv2.INTER_CUBIC
    resized = cv2.resize(rgb, (width, height), interpolation=way)
    return _eight_bit(np.asarray(resized, np.float32))


def through_h264(rgb: Float32, crf: int = CRF) -> Float32:
    """Encode a picture as a clip of one frame (libx264, 4:2:0, BT.709 limited) and decode it.

    One frame is the hardest case: no later one shares its bits.
    """
    import av

    height, width = rgb.shape[:2]
    even = np.pad(rgb, ((0, height % 2), (0, width % 2), (0, 0)), mode="edge")
    codes = np.ascontiguousarray(np.round(255 * np.clip(even, 0, 1)), dtype=np.uint8)
    clip = io.BytesIO()
    with av.open(clip, "w", format="matroska") as container:
        stream = container.add_stream("libx264", rate=25)
        stream.width, stream.height, stream.pix_fmt = even.shape[1], even.shape[0], "yuv420p"
        # one thread: the bits must not depend on the machine's number of cores
        stream.options = {"crf": str(crf), "preset": "medium", "threads": "1"}
        frame = av.VideoFrame.from_ndarray(codes, "rgb24").reformat(
            format="yuv420p", dst_colorspace="ITU709", dst_color_range="MPEG"
        )
        container.mux(stream.encode(frame))
        container.mux(stream.encode())
    clip.seek(0)
    with av.open(clip, "r") as container:
        decoded = next(container.decode(video=0)).to_ndarray(
            format="rgb24", src_colorspace="ITU709", src_color_range="MPEG"
        )
    return decoded[:height, :width].astype(np.float32) / np.float32(255)


def _eight_bit(rgb: Float32) -> Float32:
    return np.asarray(np.round(255 * np.clip(rgb, 0, 1)) / 255, dtype=np.float32)


PICTURES: Mapping[str, Callable[[Float32], Float32]] = {
    "as rendered": lambda rgb: rgb,
    f"H.264, crf {CRF}": through_h264,
    f"noise of {NOISE:.0%}": with_noise,
    **{f"{width} px wide": partial(scaled, width=width) for width in WIDTHS},
}
"""Display-coded picture in [0, 1] (H, W, 3) to another, perhaps of another size, by row."""


class GuessedCamera(Struct, frozen=True, kw_only=True):
    """A camera with a wrong field of view, and where its user puts the object.

    Attributes:
        camera: the wrong camera, on the same frame.
        size: factor by which the object is scaled about its foot [1].
        foot: the foot in the true world (3,) [scene unit].
        moved_foot: the foot in the world of the wrong camera (3,) [scene unit].
    """

    camera: Camera
    size: float
    foot: Float64
    moved_foot: Float64

    def moved(self, world: Float64) -> Float64:
        """Points of the true object (..., 3), moved and scaled with it [scene unit]."""
        return np.asarray(self.moved_foot + self.size * (world - self.foot))

    def moved_depth(self, camera: Camera, depth: Float64) -> Float64:
        """Depth (H, W) under the wrong camera of the surface points of a depth map [scene unit].

        Args:
            camera: the true camera.
            depth: camera-space depth of the object under it (H, W) [scene unit].
        """
        columns = (np.arange(camera.width) + 0.5 - camera.cx) / camera.fx
        rows = -(np.arange(camera.height) + 0.5 - camera.cy) / camera.fy
        across, up = np.broadcast_arrays(columns[None, :], rows[:, None])
        seen = depth[..., None] * np.stack([across, up, -np.ones_like(across)], axis=-1)
        pose = camera.world_from_camera
        world = self.moved(seen.reshape(-1, 3) @ pose[:3, :3].T + pose[:3, 3])
        return np.asarray(-self.camera.to_camera(world)[:, 2].reshape(depth.shape))


def guess_camera(
    camera: Camera, triangles: Float64, ground_y: float, yfov_ratio: float
) -> GuessedCamera:
    """Take the field of view for `yfov_ratio` times what it is, and place the object anew.

    Args:
        camera: the true camera.
        triangles: the object in the true world (T, 3, 3) [scene unit].
        ground_y: height of the plane on which it stands, in both worlds [scene unit].
        yfov_ratio: wrong vertical field of view by the true one [1].

    Raises:
        SceneError: no such field of view, or no ground in view where the foot would have to be.
    """
    half = math.atan(0.5 * camera.height / camera.fy)
    if not 0 < half * yfov_ratio < math.pi / 2:
        raise SceneError(f"no camera sees {math.degrees(2 * half * yfov_ratio):.0f} degrees")
    factor = math.tan(half) / math.tan(half * yfov_ratio)
    wrong = replace(camera, fx=camera.fx * factor, fy=camera.fy * factor)
    corners = triangles.reshape(-1, 3)
    foot = 0.5 * (corners.min(axis=0) + corners.max(axis=0))
    foot[1] = ground_y
    seen = camera.to_camera(foot[None])
    depth = -float(seen[0, 2])
    if depth <= 0:
        raise SceneError("the object's foot lies behind the camera")
    feet, depths = wrong.ground_seen_at(camera.pixels(seen), ground_y)
    if not depths[0] > 0.0:
        raise SceneError("under the wrong field of view the object's foot lies above the horizon")
    return GuessedCamera(
        camera=wrong,
        size=float(depths[0]) / (factor * depth),
        foot=foot,
        moved_foot=feet[0],
    )
