"""Cameras, and files of them as other programs write them."""

import math
from fractions import Fraction

import numpy as np
from scipy.spatial.transform import Rotation

from nlens_video.cameras.solved import CameraKey, SolvedCamera

SIZE, RATE = (960, 512), Fraction(24)


def pose_of(pitch=-15.0, yaw=10.0, roll=1.0, eye=(0.2, 1.6, 0.5)):
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_euler("YXZ", [yaw, pitch, roll], degrees=True).as_matrix()
    pose[:3, 3] = eye
    return pose


def path_of(count=3, **angles):
    keys = tuple(
        CameraKey(
            index=n, pts_s=n / 24, fov_x_deg=50.0,
            world_to_camera=np.linalg.inv(pose_of(eye=(0.2 + 0.1 * n, 1.6, 0.5), **angles)),
        )
        for n in range(count)
    )  # fmt: skip
    return SolvedCamera(width=SIZE[0], height=SIZE[1], keys=keys, path="moving")


def fspy(pose):
    """fSpy's export of a camera; its world has Z up."""
    z_up = np.array([[1, 0, 0, 0], [0, 0, -1, 0], [0, 1, 0, 0], [0, 0, 0, 1.0]])
    camera = z_up @ pose
    return {
        "principalPoint": {"x": 0.01, "y": -0.02},
        "viewTransform": {"rows": np.linalg.inv(camera).tolist()},
        "cameraTransform": {"rows": camera.tolist()},
        "horizontalFieldOfView": math.radians(50.0),
        "verticalFieldOfView": 0.5,
        "imageWidth": SIZE[0],
        "imageHeight": SIZE[1],
    }


def write_colmap(folder, poses, points, focal=1029.0):
    """A text model of COLMAP, whose cameras look along +Z with Y down."""
    folder.mkdir()
    (folder / "cameras.txt").write_text(f"# cameras\n1 SIMPLE_PINHOLE 960 512 {focal} 480 256\n")
    lines = []
    for n, pose in enumerate(poses):
        matrix = np.diag([1.0, -1.0, -1.0, 1.0]) @ np.linalg.inv(pose)
        x, y, z, w = Rotation.from_matrix(matrix[:3, :3]).as_quat()
        shift = " ".join(f"{value:.12g}" for value in matrix[:3, 3])
        lines += [f"{n + 1} {w} {x} {y} {z} {shift} 1 shot/frame_{n + 7:04d}.png", "1 2 -1"]
    (folder / "images.txt").write_text("\n".join(lines) + "\n")
    (folder / "points3D.txt").write_text(
        "".join(
            f"{n} {x:.9g} {y:.9g} {z:.9g} 9 9 9 0.1 1 1\n" for n, (x, y, z) in enumerate(points)
        )
    )
    return folder
