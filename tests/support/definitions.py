"""Definitions of the kernels, pixel by pixel: slow and plain."""

import math

import numpy as np

from nlens_video.effects.shadow.coverage import edges_of, mark_covered
from nlens_video.kernels.aperture_covariance import free_table


def bilinear(values, x, y):
    """The slow, obvious way."""
    height, width = values.shape[:2]
    x, y = np.clip(x, 0, width - 1), np.clip(y, 0, height - 1)
    i, j = int(x), int(y)
    i1, j1 = min(i + 1, width - 1), min(j + 1, height - 1)
    above = (1 - (x - i)) * values[j, i] + (x - i) * values[j, i1]
    below = (1 - (x - i)) * values[j1, i] + (x - i) * values[j1, i1]
    return (1 - (y - j)) * above + (y - j) * below


def covariance_by_points(near, back, points, aspect=1.0):
    """`np.cov` of what each point of the aperture sees; CoCs are constant."""
    out = np.zeros((*near[0].shape, 4))
    for y, x in np.ndindex(near[0].shape):
        seen = []
        for u, v in points:
            r_near, r_back = 0.5 * near[1][y, x], 0.5 * back[1][y, x]
            a = bilinear(near[0], x - r_near * u, y - r_near * v * aspect)
            b = bilinear(back[0], x - r_back * u, y - r_back * v * aspect)
            seen.append([a, *b])
        out[y, x] = np.cov(np.array(seen).T, bias=True)[0, 1:]
    return out


def paper_scatter_by_pixels(light, radius):
    """The formula, pixel by pixel."""
    height, width = radius.shape
    y, x = np.mgrid[:height, :width]
    sums, dilated = np.zeros((height, width, 4)), np.zeros((height, width))
    for j, i in np.ndindex(height, width):
        r = float(radius[j, i])
        distance = np.hypot(y - j, x - i)
        window = np.maximum(abs(y - j), abs(x - i)) <= int(r) + 1
        weight = window * (0.5 + 0.5 * np.tanh(4 * (r - distance))) / (r * r + 0.2)
        sums += weight[..., None] * np.append(light[j, i], 1.0)
        dilated = np.maximum(dilated, np.where(window & (distance <= r), r, 0.0))
    return sums[..., :3] / sums[..., 3:], dilated


def edge_parallax_by_pixels(rgba, plate, cocs, trust, margin, aspect):
    """The slow, obvious way."""
    out = rgba.astype(np.float64)
    alpha = np.pad(rgba[..., 3].astype(np.float64), 1, mode="edge")
    table = free_table()
    for y, x in np.ndindex(rgba.shape[:2]):
        cover = float(rgba[y, x, 3])
        if not 1.0 / 255.0 <= cover <= 1.0 - 1.0 / 255.0 or trust[y, x] == 0.0:
            continue
        near = alpha[y : y + 3, x : x + 3]
        weights = np.array([0.125, 0.25, 0.125])
        slope = weights @ (near[:, 2] - near[:, 0]), weights @ (near[2] - near[0])
        scale = np.interp(cover * (len(table) - 2), np.arange(len(table)), table)
        free = np.array([slope[0], slope[1] * aspect]) * scale * 0.5 * cocs[0][y, x] / (1 - cover)
        free /= max(1.0, math.hypot(*free))
        px = np.clip(x + margin - 0.5 * cocs[1][y, x] * free[0], 0, plate.shape[1] - 1)
        py = np.clip(y + margin - 0.5 * cocs[1][y, x] * free[1] * aspect, 0, plate.shape[0] - 1)
        i, j = int(px), int(py)
        i1, j1 = min(i + 1, plate.shape[1] - 1), min(j + 1, plate.shape[0] - 1)
        above = plate[j, i] + (px - i) * (plate[j, i1] - plate[j, i])
        below = plate[j1, i] + (px - i) * (plate[j1, i1] - plate[j1, i])
        there = above + (py - j) * (below - above)
        out[y, x, :3] += (1 - cover) * trust[y, x] * (there - plate[y + margin, x + margin])
    return out


def pull_push(values, weight, corner):
    """`inpaint`: unknown pixels from the means of 2 x 2 pixels, those from theirs, and so on."""
    if max(weight.shape) <= 2 or weight.all():
        return values
    places = [(np.arange(n) + at % 2) / 2 for n, at in zip(weight.shape, corner, strict=True)]
    cells = tuple(np.meshgrid(*(at.astype(int) for at in places), indexing="ij"))
    sums = np.zeros((*(int(at[-1]) + 1 for at in places), values.shape[2] + 1))
    parts = np.concatenate([values, np.ones((*weight.shape, 1))], axis=2) * weight[..., None]
    np.add.at(sums, cells, parts)
    total = sums[..., -1]
    means = sums[..., :-1] / np.where(total > 0.0, total, 1.0)[..., None]
    coarse = pull_push(means, np.minimum(total, 1.0), [at // 2 for at in corner])
    between = [[bilinear(coarse, x - 0.25, y - 0.25) for x in places[1]] for y in places[0]]
    return weight[..., None] * values + (1.0 - weight[..., None]) * np.array(between)


def marked(size, points, faces, at):
    bits = np.zeros(size, np.uint8)
    mark_covered(bits, (points, faces, edges_of(faces)), [(5, np.eye(3, 4), at)])
    assert not (bits & ~np.uint8(1 << 5)).any()
    return bits > 0
