"""Casters, shadow maps of several lights, and points that look themselves up in them, at random."""

from __future__ import annotations

import numpy as np
from support.overhead import looking_down

from nlens_video.effects.shadow.casters import ClippedMesh, Occluder
from nlens_video.effects.shadow.coverage import PROJECTIONS
from nlens_video.effects.shadow.light_views import LightViews, SampledCasters
from nlens_video.effects.shadow.shadow_maps import ShadowMaps

BOUNDS = np.array([[-0.5, 0.0, -0.3], [0.5, 1.2, 0.3]])


def made_casters(rng, count=40):
    """Points in a box; only the box and the points of an occluder are looked at."""
    none = np.zeros((0, 3), np.int32)
    mesh = ClippedMesh(vertices=np.zeros((0, 3)), faces=none, edges=np.zeros((0, 4), np.int32))
    occluder = Occluder(looking_down(), mesh, (), 0.0, BOUNDS)
    points = rng.uniform(*BOUNDS, (count, 3)).astype(np.float32)
    return SampledCasters(occluder, points)


def made_views(rng, far, count=PROJECTIONS):
    toward = rng.normal(size=(count, 3)) * (1.0, 0.3, 1.0) + (0.0, 1.5, 0.0)
    lights = np.column_stack([3.0 * toward, np.full(count, 0.0 if far else 1.0)])
    return LightViews.of(lights, range(count), made_casters(rng), 0.03)


def made_maps(rng, far, transparent, count=PROJECTIONS):
    views = made_views(rng, far, count)
    columns, rows = views.sizes.max(axis=0)
    bits = rng.integers(0, 256, (rows, columns)).astype(np.uint8)
    taken = rng.random((count if transparent else 0, rows, columns)).astype(np.float32)
    return ShadowMaps(views, bits, taken)


def made_points(rng, count=700):
    return (rng.normal(size=(count, 3)) * 0.8).astype(np.float32)


def made_weights(rng, points, count=PROJECTIONS):
    normals = rng.normal(size=points.shape).astype(np.float32)
    return normals, rng.normal(size=(count, 3)).astype(np.float32)
