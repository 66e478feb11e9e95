"""A ground plane as the projection gives it."""

import numpy as np

from nlens_video.stages.p_projection import GroundProjection

HEIGHT, WIDTH = 128, 240


def of_map(disparity):
    """What a `GroundProjection` has of a plane, from its disparity at every pixel (H, W)."""
    return lambda columns, rows: disparity[np.ix_(rows, columns)]


def ground(footprint=(slice(70, 90), slice(90, 150)), near=1.0, far=0.0):
    """A plane whose disparity falls from the lower border to the horizon at row 20."""
    rows = (np.arange(HEIGHT) - 20) / (HEIGHT - 20)
    disparity = np.repeat((far + (near - far) * rows)[:, None], WIDTH, axis=1)
    mask = np.zeros((HEIGHT, WIDTH), bool)
    if footprint is not None:
        mask[footprint] = True
    return GroundProjection(mask=mask, disparity_of=of_map(disparity), ground_y=0.0)
