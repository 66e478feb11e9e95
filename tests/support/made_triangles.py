"""Random triangles on a small screen, and the samples that show them."""

import numpy as np

from nlens_video.core.layers import Box
from nlens_video.render.software import raster, triangles
from nlens_video.scene.camera import Camera
from nlens_video.scene.screen_projection import pinhole_params

WIDTH, HEIGHT = 40, 24
NEAR = 0.5


def made_lens():
    camera = Camera(
        world_from_camera=np.eye(4), fx=30.0, fy=31.0, cx=20.0, cy=12.0, width=WIDTH, height=HEIGHT
    )
    return pinhole_params(camera, Box(0, 0, WIDTH, HEIGHT), NEAR)


def made_triangles(seed, count=60, depth=4.0):
    """Positions and faces, some of which reach through the near plane or out of the picture."""
    rng = np.random.default_rng(seed)
    positions = rng.normal(size=(count, 3)) * (2.0, 1.5, 2.0) - (0.0, 0.0, depth)
    faces = np.array([rng.permutation(count)[:3] for _ in range(count)])
    return positions.astype(np.float32), faces.astype(np.int32)


def set_up(module, seed):
    """A shape on the screen; what `set_up_triangles` makes of it."""
    positions, faces = made_triangles(seed)
    lens, points = made_lens(), np.empty((len(positions), 3))
    module.project(positions, lens, points)
    shape = (points, positions, faces, lens)
    spans, kept = np.zeros((len(faces), 2), np.int32), np.zeros(len(faces), np.int32)
    planes = np.zeros((len(faces), triangles.PLANES), np.float32)
    sides = np.arange(len(faces)).astype(np.uint8) % 4
    count = module.set_up_triangles(shape, sides, WIDTH, 4 * HEIGHT, spans, planes, kept)
    return shape, spans, planes, kept[:count]


def empty_samples():
    disparity = np.zeros((4 * HEIGHT, WIDTH + raster.PADDING), np.float32)
    return disparity, np.full(disparity.shape, raster.NOTHING, np.int32)


def shown(samples):
    return [one[:, :WIDTH].copy() for one in samples]
