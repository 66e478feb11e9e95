"""Folders of plates whose camera is known, as `evaluate camera` reads them."""

from __future__ import annotations

import json
from pathlib import Path

import av
import cv2
import numpy as np
from support.camera_paths import focal_of, rotation
from support.clips import REPEATABLE
from support.truth_folder import HEIGHT, INTERCEPT, SLOPE, WIDTH, YFOV, camera, write_plate

from nlens_video.cameras.solved import CameraKey, SolvedCamera

PAN_SIZE, PAN_FOV_DEG, PAN_FRAMES = (960, 512), 50.0, 8


def write_still(folder: Path, *, seed: int = 0) -> Path:
    """A plate, its object and its camera."""
    write_plate(folder, seed=seed)
    params = {
        "resolution": [WIDTH, HEIGHT],
        "yfov_rad": YFOV,
        "view_matrix_gltf": np.linalg.inv(camera().world_from_camera).tolist(),
        "ground_plane_y_gltf": 0.0,
        "coc_at_infinity_px": -INTERCEPT,
        "focus_distance_m": -SLOPE / INTERCEPT,
    }
    (folder / "params.json").write_text(json.dumps(params))
    return folder


def write_pan(folder: Path) -> Path:
    """A clip of a ground by a camera that turns, and its path."""
    folder.mkdir(parents=True)
    width, height = PAN_SIZE
    rng = np.random.default_rng(4)
    texture = cv2.resize(
        rng.integers(40, 220, (128, 128, 3), np.uint8), (1536, 1536), interpolation=cv2.INTER_CUBIC
    )
    eye = np.array([0.0, 1.5, 0.0])
    focal = focal_of(PAN_FOV_DEG)
    lens = np.array([[focal, 0, -width / 2], [0, -focal, -height / 2], [0, 0, -1.0]])
    ground = np.array([[8 / 1536, 0, -4], [0, 0, 0], [0, -8 / 1536, -0.3]])
    frames = []
    with av.open(str(folder / "bg.mp4"), "w") as container:
        options = {"crf": "12", **REPEATABLE["libx264"]}
        stream = container.add_stream("libx264", rate=24, options=options)
        stream.width, stream.height, stream.pix_fmt = width, height, "yuv420p"
        for number in range(PAN_FRAMES):
            turn = rotation(np.radians(4 - number), np.radians(-24), 0.0)
            seen = lens @ turn.T @ (ground - np.outer(eye, (0.0, 0.0, 1.0)))
            picture = cv2.warpPerspective(
                texture, seen, PAN_SIZE, borderMode=cv2.BORDER_CONSTANT, borderValue=(190, 190, 190)
            )
            container.mux(stream.encode(av.VideoFrame.from_ndarray(picture, "rgb24")))
            matrix = np.eye(4)
            matrix[:3, :3], matrix[:3, 3] = turn.T, -turn.T @ eye
            frames.append({"frame": number, "view_matrix_gltf": matrix.tolist()})
        container.mux(stream.encode(None))
    params = {
        "resolution": [width, height], "hfov_deg": PAN_FOV_DEG, "fps": 24, "kind": "pan",
        "ground_points": [[x, 0, z] for x in (-0.5, 0.0, 0.5) for z in (-3.0, -2.5)],
        "frames": frames,
    }  # fmt: skip
    (folder / "params.json").write_text(json.dumps(params))
    return folder


def solved(
    pitch_deg: float, roll_deg: float, fov_deg: float, *, size: tuple[int, int] = (960, 512),
    height: float = 1.5, **values: object,
) -> SolvedCamera:  # fmt: skip
    """A still camera above the ground y = 0 that looks along -Z."""
    pose = np.eye(4)
    pose[:3, :3] = rotation(0.0, np.radians(pitch_deg), np.radians(roll_deg))
    pose[1, 3] = height
    key = CameraKey(
        index=0, pts_s=0.0, world_to_camera=np.linalg.inv(pose), fov_x_deg=fov_deg
    )  # fmt: skip
    return SolvedCamera(width=size[0], height=size[1], keys=(key,), **values)
