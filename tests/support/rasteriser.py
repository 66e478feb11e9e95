"""The software rasteriser on triangles given as arrays, and what it is compared with."""

import numpy as np
from msgspec.structs import replace
from support import shading_block as at

from nlens_video.core.layers import Box
from nlens_video.render.base.light_depth import NO_MAPS
from nlens_video.render.software import raster, reference_kernels, triangles
from nlens_video.render.software.textures import Atlas
from nlens_video.scene import Camera, screen_projection
from nlens_video.scene.gltf.textures import Image, Picture

SIZE = (24, 32)
NOTHING_AROUND = np.zeros((0, 4), np.float32), np.zeros((0, 0, 0, 4), np.float32), NO_MAPS
"""Ambient light, what is mirrored and depth maps, of `deferred.Lights`."""


def atlas_of(pixels, *, mag_filter=9729, min_filter=9987, wrap=(10497, 10497)):
    """The atlas of one picture of colours; filters and wrapping as glTF numbers them."""
    image = Image(
        picture=Picture(lambda: pixels), srgb=True, mag_filter=mag_filter, min_filter=min_filter,
        wrap=wrap,
    )  # fmt: skip
    return Atlas.of([image])


def drawn(positions, faces, *, near=0.5, sides=1, rows=None):
    """Triangles and disparities of the samples, by `raster`, seen from the origin along -Z."""
    height, width = SIZE
    camera = Camera(
        world_from_camera=np.eye(4), fx=20.0, fy=20.0, cx=16.0, cy=12.0, width=width, height=height
    )
    lens = screen_projection.pinhole_params(camera, Box(0, 0, width, height), near)
    points = np.empty((len(positions), 3))
    screen_projection.project(positions, lens, points)
    shape = (points, positions, faces, lens)
    spans = np.empty((len(faces), 2), np.int32)
    planes = np.empty((len(faces), triangles.PLANES), np.float32)
    kept = np.empty(len(faces), np.int32)
    flags = np.full(len(faces), sides, np.uint8)
    count = triangles.set_up(shape, flags, width, 4 * height, spans, planes, kept)
    disparity = np.zeros((4 * height, width + raster.PADDING), np.float32)
    ids = np.full(disparity.shape, raster.NOTHING, np.int32)
    for first, last in rows or [(0, 4 * height - 1)]:
        raster.fill(kept[:count], first, last, shape, spans, width, disparity, ids)
    return ids[:, :width], disparity[:, :width], shape, kept[:count]


def truth(positions, faces, near=0.5):
    positions = positions.astype(float)  # in float32 a place may be snapped the other way
    depth = -positions[:, 2]
    x = 20.0 * positions[:, 0] + 16.0 * depth
    y = 12.0 * depth - 20.0 * positions[:, 1]
    corners = np.stack([x, y, depth], axis=1)[faces]
    before = (corners[..., 2] >= near).all(axis=1)  # those are snapped to 1/256 px
    own = corners[before]
    own[..., :2] = np.round(own[..., :2] / own[..., 2:] * 256) / 256 * own[..., 2:]
    corners[before] = own
    return reference_kernels.visible_triangles(corners, SIZE, near)


def random_block(rng):
    fields = rng.random((at.ROWS, at.WIDTH), dtype=np.float32)
    for first in (at.NORMAL_X, at.VIEW_X):
        vectors = rng.normal(size=(3, at.WIDTH))
        fields[first : first + 3] = vectors / np.linalg.norm(vectors, axis=0)
    fields[at.WIDENING] *= 0.18
    fields[at.WIDENING, ::2] = 0.0  # flat
    return fields


def surface(fields, i):
    rows = fields.astype(np.float64)
    three = [rows[first : first + 3, i] for first in
             (at.NORMAL_X, at.VIEW_X, at.BASE_R, at.F0_R)]  # fmt: skip
    one = [float(rows[field, i]) for field in (at.METALLIC, at.ROUGHNESS, at.SPECULAR, at.WIDENING)]
    return reference_kernels.SurfacePoint(
        normal=three[0], view=three[1], base=three[2], f0=three[3],
        metallic=one[0], roughness=one[1], specular=one[2], widening=one[3],
    )  # fmt: skip


def layered_block(rng):
    """A block of points whose materials have all layers; nothing glows or lets light through."""
    fields = random_block(rng)
    normals = fields[at.NORMAL_X : at.NORMAL_X + 3].T
    along = np.cross(normals, rng.normal(size=(at.WIDTH, 3)))
    coat = rng.normal(size=(at.WIDTH, 3))
    for first, vectors in (
        (at.ALONG, along), (at.BESIDE, np.cross(normals, along)), (at.COAT_NORMAL, coat),
        (at.GLOW, np.zeros((at.WIDTH, 3))), (at.THROUGH, np.zeros((at.WIDTH, 1))),
    ):  # fmt: skip
        fields[first : first + vectors.shape[1]] = vectors.T
    return fields


def layered_surface(fields, i):
    rows = fields.astype(np.float64)
    along, coat, sheen = (
        rows[first : first + 3, i] for first in (at.ALONG, at.COAT_NORMAL, at.SHEEN)
    )
    names = {
        "anisotropy": at.ANISOTROPY, "coat": at.COAT, "coat_roughness": at.COAT_ROUGHNESS,
        "sheen_roughness": at.SHEEN_ROUGHNESS,
    }  # fmt: skip
    return replace(
        surface(fields, i), along=along / np.linalg.norm(along), sheen=sheen,
        coat_normal=coat / np.linalg.norm(coat),
        **{name: float(rows[field, i]) for name, field in names.items()},
    )  # fmt: skip


def resolved(disparity, least):
    """`resolve_depth` by its words, pixel by pixel."""
    height, width = disparity.shape[0] // 4, disparity.shape[1]
    samples = disparity.reshape(height, 4, width).transpose(0, 2, 1)
    filled = np.maximum(samples, least)
    spread = np.pad(filled.max(-1) - filled.min(-1), 1, mode="edge")
    depth = np.full((height, width), np.inf, np.float32)
    for y in range(height):
        for x in range(width):
            own = samples[y, x]
            beside = min(spread[y + 1, x], spread[y + 1, x + 2])
            above = min(spread[y, x + 1], spread[y + 2, x + 1])
            steep = spread[y + 1, x + 1] < 1.5 * min(beside, above)
            if own.max() == 0.0:
                continue
            one = own.min() > 0.0 and (own.max() < 1.005 * own.min() or steep)
            depth[y, x] = 1.0 / own.mean() if one else 1.0 / own.max()
    return depth
