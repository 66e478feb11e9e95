"""Normals of surfaces by the depth of their pixels."""

import numpy as np

from nlens_video.effects.surfaces import normals
from nlens_video.scene.camera import Camera


def test_normals_of_a_sphere_by_its_disparity():
    view = Camera.centred(np.eye(4), 600.0, 160, 160, 1.0)
    x, y = np.meshgrid(np.arange(160) - 79.5, 79.5 - np.arange(160)) / np.float64(600.0)
    square = 64.0 - (x * x + y * y + 1.0) * 63.0  # of a sphere of radius 1, 8 away
    depth = (8.0 - np.sqrt(np.maximum(square, 0.0))) / (x * x + y * y + 1.0)
    disparity = np.where(square > 0.0, 1.0 / depth, 0.0)
    unit = np.stack([x * depth, y * depth, 8.0 - depth], axis=-1)
    found = normals(disparity.astype(np.float32), view)
    cosine = (found * unit).sum(axis=-1)
    assert cosine[(x * x + y * y < 0.5 / 64.0) & (square > 0.0)].min() > 0.99
    assert np.percentile(cosine[square > 0.0], 5) > 0.9
