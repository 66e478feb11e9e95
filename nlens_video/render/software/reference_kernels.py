"""Definitions of the rasteriser's kernels, one point or sample at a time in float64.

Shading after glTF 2.0, appendix B; visibility by barycentric weights; textures after OpenGL 4,
section 8.14, and anisotropic after McCormack et al., "Feline" (1999).
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt
from msgspec import Struct, field

from nlens_video.core.layers import Float64
from nlens_video.render.software.raster import NOTHING, SAMPLE_X, SAMPLE_Y
from nlens_video.render.software.textures import Atlas


class SurfacePoint(Struct, frozen=True, kw_only=True, eq=False):
    """A point of a surface: unit vectors (3,), linear colours (3,), factors in [0, 1].

    Attributes:
        along: tangent in which highlights are stretched by `anisotropy`.
        coat_normal: normal of the clear coat; that of the surface where it is None.
        widening: what the normal's variance within the pixel adds to the square of alpha.
    """

    normal: Float64
    view: Float64
    base: Float64
    metallic: float
    roughness: float
    f0: Float64
    specular: float
    along: Float64 | None = None
    anisotropy: float = 0.0
    coat: float = 0.0
    coat_roughness: float = 0.0
    coat_normal: Float64 | None = None
    sheen: Float64 = field(default_factory=lambda: np.zeros(3))
    sheen_roughness: float = 0.0
    widening: float = 0.0

    def alpha(self, roughness: float) -> float:
        """Of microfacets of a roughness, widened."""
        return math.sqrt(min(max(roughness**2, 0.002) ** 2 + self.widening, 1.0))


def layered(surface: SurfacePoint, toward: Float64) -> Float64:
    """`reflectance` with clear coat and sheen: KHR_materials_clearcoat and _sheen."""
    seen = abs(float(surface.normal @ surface.view))
    cosine = max(float(surface.normal @ toward), 0.0)
    half = (toward + surface.view) / np.linalg.norm(toward + surface.view)
    roughness = float(np.clip(surface.sheen_roughness, 0.07, 1.0))
    facets = max(float(surface.normal @ half), 0.0)
    lobe = fibres(facets, cosine, max(seen, 1e-4), roughness) if cosine > 0.0 else 0.0
    kept = 1.0 - float(surface.sheen.max()) * fibre_share(seen, roughness)
    under = kept * reflectance(surface, toward) + cosine * lobe * surface.sheen
    normal = surface.normal if surface.coat_normal is None else surface.coat_normal
    facing, seen = float(normal @ toward), abs(float(normal @ surface.view))
    share = surface.coat * (0.04 + 0.96 * (1.0 - seen) ** 5)
    alpha = surface.alpha(surface.coat_roughness)
    coat = 0.0
    if facing > 0.0:
        shine = _distribution(max(float(normal @ half), 0.0), alpha)
        coat = facing * shine * _visible(facing, max(seen, 1e-4), alpha)
    return np.asarray((1.0 - share) * under + share * coat)


def passed(surface: SurfacePoint, transmission: float, depth: Float64) -> Float64:
    """Share of light (3,) that goes straight through: KHR_materials_transmission and _volume.

    Args:
        surface: thin, without further layers.
        transmission: share of what enters that is not scattered back.
        depth: optical depth (3,) of the volume.
    """
    seen = abs(float(surface.normal @ surface.view))
    fresnel = surface.f0 + (surface.specular - surface.f0) * (1.0 - seen) ** 5
    kept = (1.0 - float(fresnel.max())) * transmission * (1.0 - surface.metallic)
    return np.asarray(kept * surface.base * np.exp(-depth))


def fibres(half: float, light: float, view: float, roughness: float) -> float:
    """Lobe of sheen from cosines of the normal to half vector, light and eye [1 / sr]."""
    alpha = roughness**2
    lobe = (2.0 + 1.0 / alpha) * max(1.0 - half**2, 0.0) ** (0.5 / alpha) / (2.0 * math.pi)
    hidden = 1.0 + _fibre_shadow(view, alpha) + _fibre_shadow(light, alpha)
    return float(lobe * min(1.0 / (hidden * 4.0 * view * light), 1.0))


def _fibre_shadow(cosine: float, alpha: float) -> float:
    """Lambda of Estevez and Kulla, "Production Friendly Microfacet Sheen BRDF" (2017)."""
    s = (1.0 - alpha) ** 2
    pairs = [(21.5473, 25.3245), (3.82987, 3.32435), (0.19823, 0.16801), (-1.97760, -1.27393)]
    a, b, c, d = (low + (high - low) * s for low, high in pairs)
    e = -4.32054 + (-4.85967 + 4.32054) * s

    def fit(x: float) -> float:
        return float(a / (1.0 + b * x**c) + d * x + e)

    return math.exp(fit(cosine) if cosine < 0.5 else 2.0 * fit(0.5) - fit(1.0 - cosine))


def fibre_share(view: float, roughness: float) -> float:
    """Share of even light that white fibres return, seen at a cosine: a fit to their integral."""
    r = max(roughness, 0.1)
    terms = np.array([1.0 / r, 1.0, r]) @ [
        [0.1022, -0.6898, -1.5261], [-0.6472, -1.8652, 4.2535], [0.3144, 1.1422, -2.9285]
    ]  # fmt: skip
    return min(math.exp(float(terms @ [1.0, view, view * view])), 1.0)


def reflectance(surface: SurfacePoint, toward: Float64) -> Float64:
    """BRDF times cosine (3,) for light from a unit direction `toward` (3,) [1 / sr]."""
    cosine = float(surface.normal @ toward)
    if cosine <= 0.0:
        return np.zeros(3)
    half = (toward + surface.view) / np.linalg.norm(toward + surface.view)
    seen = max(abs(float(surface.normal @ surface.view)), 1e-4)
    alpha = surface.alpha(surface.roughness)
    grazing = (1.0 - float(np.clip(surface.view @ half, 0.0, 1.0))) ** 5
    shine = _distribution(max(float(surface.normal @ half), 0.0), alpha) * _visible(
        cosine, seen, alpha
    )
    if surface.along is not None:
        shine = _stretched(surface, half, toward)
    fresnel = surface.f0 + (surface.specular - surface.f0) * grazing
    dielectric = (1.0 - fresnel.max()) * surface.base / math.pi + shine * fresnel
    metal = shine * (surface.base + (1.0 - surface.base) * grazing)
    mixed = (1.0 - surface.metallic) * dielectric + surface.metallic * metal
    return np.asarray(cosine * mixed)


def _stretched(surface: SurfacePoint, half: Float64, toward: Float64) -> float:
    """The lobe of KHR_materials_anisotropy."""
    along = np.zeros(3) if surface.along is None else surface.along
    frame = np.stack([along, np.cross(surface.normal, along), surface.normal])
    alpha = max(surface.roughness**2, 0.002)
    wide = alpha + (1.0 - alpha) * surface.anisotropy**2
    wide = math.sqrt(min(wide**2 + surface.widening, 1.0))
    narrow = surface.alpha(surface.roughness)
    h, light, view = frame @ half, frame @ toward, frame @ surface.view
    view[2] = max(abs(view[2]), 1e-4)
    density = 1.0 / (math.pi * wide * narrow * float(
        (h[0] / wide) ** 2 + (h[1] / narrow) ** 2 + max(h[2], 0.0) ** 2
    ) ** 2)  # fmt: skip
    scale = np.array([wide, narrow, 1.0])
    hidden = light[2] * np.linalg.norm(scale * view) + view[2] * np.linalg.norm(scale * light)
    return density * min(0.5 / float(hidden), 1.0)


def _distribution(cosine: float, alpha: float) -> float:
    """Of microfacets' normals (Trowbridge and Reitz)."""
    return alpha**2 / (math.pi * (cosine**2 * (alpha**2 - 1.0) + 1.0) ** 2)


def _visible(light: float, view: float, alpha: float) -> float:
    """Share of microfacets that light and eye both reach (Smith), over 4 times both cosines."""
    towards_eye = math.sqrt(view**2 * (1.0 - alpha**2) + alpha**2)
    towards_light = math.sqrt(light**2 * (1.0 - alpha**2) + alpha**2)
    return 0.5 / (light * towards_eye + view * towards_light)


def lit_by_directional(surface: SurfacePoint, suns: Sequence[tuple[Float64, Float64]]) -> Float64:
    """Radiance (3,) under lamps without a place: directions towards them, and irradiances (3,)."""
    parts = [reflectance(surface, toward) * strength for toward, strength in suns]
    return np.asarray(np.sum(parts, axis=0))


def visible_triangles(
    corners: Float64, size: tuple[int, int], near: float
) -> tuple[npt.NDArray[np.int32], Float64]:
    """Triangle and disparity of each sample (4 h, w); `NOTHING` and 0 where there is none.

    A point of the screen is covered where it is a sum of the corners with weights that are not
    negative; that sum's weights also give its disparity.

    Args:
        corners: homogeneous corners (T, 3, 3), (column * depth, row * depth, depth) [px].
        size: rows and columns of the picture [px].
        near: least depth that is drawn [scene unit].
    """
    height, width = size
    ids = np.full((4 * height, width), NOTHING, np.int32)
    best = np.zeros((4 * height, width))
    lines, columns = np.indices(ids.shape)
    x = columns + np.array(SAMPLE_X)[lines % 4]
    y = lines // 4 + np.array(SAMPLE_Y)[lines % 4]
    samples = np.stack([x, y, np.ones_like(x)], axis=-1).reshape(-1, 3)
    for number, triangle in enumerate(corners):
        if abs(np.linalg.det(triangle)) < 1e-12:
            continue
        weights = np.linalg.solve(triangle.T, samples.T).T.reshape(*ids.shape, 3)
        disparity = weights.sum(axis=-1)
        drawn = (weights >= 0.0).all(axis=-1) & (disparity <= 1.0 / near) & (disparity >= best)
        ids[drawn], best[drawn] = number, disparity[drawn]
    return ids, best


_CLAMP, _MIRROR = 33071, 33648
_LINEAR = 9729
_MOST_PROBES, _ROUND = 16, 1.5  # `_ROUND`: square of the ratio of axes that are taken for equal
# Shrinking: nearest of nearest level, linear of nearest, nearest of two levels, linear of two.
_FILTERS = {9728: (0, 0), 9729: (1, 0), 9984: (0, 1), 9985: (1, 1), 9986: (0, 2), 9987: (1, 2)}


def sample_texture(
    atlas: Atlas, texture: int, at: tuple[float, float], along: tuple[Float64, Float64]
) -> Float64:
    """Linear RGBA (4,) at coordinates that change by `along` (2,) a column and a row.

    Probes along the longer axis of the footprint read the level of the shorter axis. Their variance
    is the difference of the variances of two even rows as long as the axes.
    """
    size = atlas.levels[atlas.table[texture, 0], 1:].astype(np.float64)
    axes, lengths, _ = np.linalg.svd(np.stack(along, axis=1) * size[:, None])
    longer = float(lengths[0])  # [texel]
    shorter = max(float(lengths[1]), 1.0, longer / _MOST_PROBES)
    probes, spacing = 1, 0.0
    if longer**2 > _ROUND * shorter**2:
        probes = max(2, math.floor(longer / shorter + 0.5))
        spacing = math.sqrt((longer**2 - shorter**2) / (probes**2 - 1.0))
    step = axes[:, 0] * spacing / size
    total = np.zeros(4)
    for number in range(probes):
        u, v = at + (number - 0.5 * (probes - 1)) * step
        total += _probe(atlas, texture, (u, v), shorter)
    return total / probes


def _probe(atlas: Atlas, texture: int, at: tuple[float, float], width: float) -> Float64:
    """Linear RGBA (4,) within a round place of a width [texel]."""
    first, count, mag, least, *wrap = (int(v) for v in atlas.table[texture])
    linear, levels = _FILTERS[least]
    edge = 2.0 if mag == _LINEAR and least in (9984, 9986) else 1.0
    if width**2 <= edge:
        return _at(atlas, first, at, wrap, linear=mag == _LINEAR)
    if levels == 0:
        return _at(atlas, first, at, wrap, linear=linear == 1)
    lod = min(max(math.log2(width), 0.0), count - 1.0)
    if levels == 1:
        near = max(math.ceil(lod + 0.5) - 1, 0)
        return _at(atlas, first + near, at, wrap, linear=linear == 1)
    low = min(int(lod), count - 1)
    finer = _at(atlas, first + low, at, wrap, linear=linear == 1)
    coarser = _at(atlas, first + min(low + 1, count - 1), at, wrap, linear=linear == 1)
    return finer + (coarser - finer) * (lod - low)


def _at(
    atlas: Atlas, level: int, at: tuple[float, float], wrap: list[int], *, linear: bool
) -> Float64:
    start, width, height = (int(v) for v in atlas.levels[level])
    rows = start + np.arange(height)[:, None] * (width + 2)
    picture = atlas.texels.reshape(-1, 4)[rows + np.arange(width)] / 65535.0
    x, y = at[0] * width, at[1] * height
    if not linear:
        row, column = _index(math.floor(y), height, wrap[1]), _index(math.floor(x), width, wrap[0])
        return np.asarray(picture[row, column])
    x0, y0 = math.floor(x - 0.5), math.floor(y - 0.5)
    total = np.zeros(4)
    for dy in range(2):
        for dx in range(2):
            share = (1.0 - abs(x - 0.5 - x0 - dx)) * (1.0 - abs(y - 0.5 - y0 - dy))
            row, column = _index(y0 + dy, height, wrap[1]), _index(x0 + dx, width, wrap[0])
            total += share * picture[row, column]
    return total


def _index(texel: int, size: int, wrap: int) -> int:
    if wrap == _CLAMP:
        return min(max(texel, 0), size - 1)
    if wrap == _MIRROR:
        turn = texel % (2 * size)
        return min(turn, 2 * size - 1 - turn)
    return texel % size
