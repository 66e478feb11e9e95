"""Environment maps as image-based light: directional lights and spherical harmonics."""

from __future__ import annotations

import math
import re
from pathlib import Path

import cv2
import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from nlens_video.core.errors import InputError
from nlens_video.core.layers import MOST_PIXELS, Float32, Float64, too_large
from nlens_video.kernels.thread_pool import picture_bands
from nlens_video.scene.illumination import LUMINANCE, Illumination, Lamp, polynomial, sun
from nlens_video.scene.surround import Surround, reduced, sphere

_HEADER = 4096  # bytes of a .hdr file in which its size stands
_SIZE = re.compile(rb"\n[-+]Y +(\d+) +[-+]X +(\d+)\n")
_WIDTH = 512  # columns that the reduction looks at: 0.7 degrees
_PEAK = 4.0  # times the mean radiance: what is brighter belongs to a light
_FAINT = 0.02  # share of all light below which the peaks are no lights
_SMALL = math.radians(4.0)  # a part this wide is one light
_SEEN = math.radians(12.0)  # a source this wide is seen in mirrors; the maps of these are coarse
_MAX_LIGHTS = 6
# Weights of the terms of `polynomial`: a cosine's convolution, 1, 2/3 and 1/4 (Ramamoorthi and
# Hanrahan 2001), times the squared factor of each real spherical harmonic.
_WEIGHTS = np.array([1.0, 2.0, 2.0, 2.0, 3.75, 3.75, 0.3125, 3.75, 0.9375]) / (4.0 * math.pi)


def load_environment(path: Path, rotation_deg: float, exposure_ev: float) -> Illumination:
    """Read and reduce an equirectangular map.

    Args:
        path: `.hdr` or `.exr`, twice as wide as high, scene-linear.
        rotation_deg: turn about the up axis, counter-clockwise seen from above [deg].
        exposure_ev: brightness in stops, 0 as the file has it [EV].

    Raises:
        InputError: the file cannot be read, is no equirectangular map, or is not finite.
    """
    image = _read(path)
    height, width = image.shape[:2]
    if width != 2 * height or height < 2:
        raise InputError(
            f"{path}: {width}x{height} pixels; an equirectangular map is twice as wide as high"
        )
    for top, end in picture_bands(height, width):  # in place: a map of 8K takes 400 MB
        rows = image[top:end]
        if not np.isfinite(rows).all():
            raise InputError(f"{path}: holds values that are not finite; write it anew")
        np.maximum(rows, 0.0, out=rows)
    return reduce_environment(image, rotation_deg, exposure_ev)


def reduce_environment(
    radiance: Float32,
    rotation_deg: float = 0.0,
    exposure_ev: float = 0.0,
    *,
    mirrored: Float32 | None = None,
) -> Illumination:
    """Split a map into lights and ambient light; together they are all of it.

    The middle column looks along +X, row 0 straight up. What exceeds a multiple of the mean goes to
    lights by a median cut (Debevec 2005), the rest to spherical harmonics of order 2. Smooth
    surfaces mirror the rest and the wide lights, as softboxes and windows are; of the sun, they
    show the light's own highlight.

    Args:
        radiance: scene-linear (h, w, 3), w = 2 h.
        rotation_deg: as of `load_environment` [deg].
        exposure_ev: as of `load_environment` [EV].
        mirrored: what smooth surfaces mirror beside the lights, where that differs; of the same
            shape.
    """
    small = reduced(radiance, _WIDTH)
    light = small.astype(np.float64) * 2.0**exposure_ev
    grid = _Grid(*sphere(small.shape[1], math.radians(rotation_deg)))
    bright = light @ LUMINANCE
    mean = float((bright * grid.solid_angle).sum()) / (4.0 * math.pi)
    limit = _PEAK * mean
    above = bright > max(limit, 0.0)
    kept = np.divide(limit, bright, out=np.ones_like(bright), where=above)[..., None]
    peaks = light * (1.0 - kept) * grid.solid_angle[..., None]
    parts = []
    if float((peaks @ LUMINANCE).sum()) > _FAINT * 4.0 * math.pi * mean:
        parts = _median_cut(peaks, grid)
    else:
        kept = np.ones_like(kept)
    rest = light * kept
    shown = rest.copy() if mirrored is None else mirrored * kept * 2.0**exposure_ev
    lamps = []
    for source in _sources(parts):
        wide = mirrored is None and _diameter(source) >= _SEEN
        for part in source:
            if wide:
                shown[part.pixels] = light[part.pixels]
            lamps.append(part.lamp(peaks, in_surround=wide))
    surround = Surround(shown.astype(np.float32), math.radians(rotation_deg))
    return Illumination(tuple(lamps), grid.harmonics(rest), surround=surround)


class _Grid(Struct, frozen=True, eq=False):
    """Direction (h, w, 3) and solid angle (h, w) [sr] of each pixel."""

    directions: Float64
    solid_angle: Float64

    def harmonics(self, light: Float64) -> Float64:
        """Irradiance / pi (9, 3) of radiance (h, w, 3), as `Illumination.ambient` holds it."""
        energy = (light * self.solid_angle[..., None]).reshape(-1, 3)
        return np.asarray(
            _WEIGHTS[:, None] * (polynomial(self.directions.reshape(-1, 3)).T @ energy)
        )


def _median_cut(peaks: Float64, grid: _Grid) -> list[_Part]:
    """Parts of the energy (h, w, 3) of the peaks; the widest part is halved first."""
    bright = peaks @ LUMINANCE
    parts = [_Part.of(bright, grid, (0, 0, *bright.shape))]
    while len(parts) < _MAX_LIGHTS:
        widest = max(parts, key=lambda part: part.diameter * part.energy)
        halves = [] if widest.diameter < _SMALL else widest.halved(bright, grid)
        if len(halves) < 2:
            break
        parts.remove(widest)
        parts += halves
    return parts


def _sources(parts: list[_Part]) -> list[list[_Part]]:
    """The parts by the sources that they belong to: those of one source touch each other."""
    sources: list[list[_Part]] = []
    for part in parts:
        touched = [source for source in sources if any(map(part.touches, source))]
        sources = [source for source in sources if source not in touched]
        sources.append([part, *(one for source in touched for one in source)])
    return sources


def _diameter(source: list[_Part]) -> float:
    """Apparent size of the parts together [rad]."""
    middle = sum((part.energy * part.resultant for part in source), np.zeros(3))
    length = float(np.linalg.norm(middle)) / sum(part.energy for part in source)
    return _spread(length)


def _spread(length: float) -> float:
    """Apparent size of light whose mean direction has that length [rad].

    The mean of unit vectors is shorter the wider they spread: by a^2 / 4 for a disc of angular
    radius a.
    """
    return 4.0 * math.sqrt(max(0.0, 1.0 - length))


class _Part(Struct, frozen=True, eq=False):
    """A rectangle of the map (y0, x0, y1, x1): its energy, and the mean direction of that (3,)."""

    area: tuple[int, int, int, int]
    energy: float
    resultant: Float64

    @classmethod
    def of(cls, bright: Float64, grid: _Grid, area: tuple[int, int, int, int]) -> _Part:
        y0, x0, y1, x1 = area
        weight = bright[y0:y1, x0:x1]
        energy = float(weight.sum())
        middle = np.einsum("hw,hwc->c", weight, grid.directions[y0:y1, x0:x1])
        if energy <= 0.0 or not middle.any():
            return cls(area, energy, np.array([0.0, 1.0, 0.0]))
        return cls(area, energy, middle / energy)

    @property
    def direction(self) -> Float64:
        """Unit vector (3,) to its middle."""
        return np.asarray(self.resultant / np.linalg.norm(self.resultant))

    @property
    def diameter(self) -> float:
        """Its apparent size [rad]."""
        return _spread(float(np.linalg.norm(self.resultant)))

    def touches(self, other: _Part) -> bool:
        """Whether there is no gap between two, as far as their sizes tell."""
        between = math.acos(min(max(float(self.direction @ other.direction), -1.0), 1.0))
        return between <= self.diameter + other.diameter

    @property
    def pixels(self) -> tuple[slice, slice]:
        """Its rows and columns."""
        y0, x0, y1, x1 = self.area
        return slice(y0, y1), slice(x0, x1)

    def lamp(self, peaks: Float64, *, in_surround: bool) -> Lamp:
        """The light of that energy (h, w, 3)."""
        color = peaks[self.pixels].sum((0, 1))
        posed = replace(sun(color, -self.direction), in_surround=in_surround)
        return Lamp(posed, self.diameter)

    def halved(self, bright: Float64, grid: _Grid) -> list[_Part]:
        """Two parts of nearly equal energy, cut across the longer side; fewer if there is none."""
        y0, x0, y1, x1 = self.area
        weight = bright[y0:y1, x0:x1]
        shrink = float(grid.solid_angle[y0:y1].mean() / grid.solid_angle.max())
        across = (x1 - x0) * shrink > (y1 - y0)
        sums = np.cumsum(weight.sum(axis=0 if across else 1))
        if len(sums) < 2:
            return []
        cut = int(np.clip(np.searchsorted(sums, 0.5 * sums[-1]) + 1, 1, len(sums) - 1))
        if across:
            areas = [(y0, x0, y1, x0 + cut), (y0, x0 + cut, y1, x1)]
        else:
            areas = [(y0, x0, y0 + cut, x1), (y0 + cut, x0, y1, x1)]
        parts = [_Part.of(bright, grid, area) for area in areas]
        return [part for part in parts if part.energy > 0.0]


def _read(path: Path) -> Float32:
    if not path.is_file():
        raise InputError(f"{path}: no such file; expected an environment map, .hdr or .exr")
    if path.suffix.lower() == ".exr":
        from nlens_video.video.exr import read_exr

        image = read_exr(path)
        names = "YYY" if set(image.channels) <= {"Y", "A"} else "RGB"
        if not set(names) <= set(image.channels):
            found = ", ".join(sorted(image.channels))
            raise InputError(f"{path}: has no channels R, G, B (has {found})")
        light = np.stack([image.channels[name] for name in names], axis=-1)
        return image.on_display_window(image.in_bt709(light))
    return _read_hdr(path)


def _read_hdr(path: Path) -> Float32:
    before = cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)  # it prints lines
    try:
        data = np.fromfile(path, np.uint8)
        size = _SIZE.search(data[:_HEADER].tobytes())
        if size is not None and int(size[1]) * int(size[2]) > MOST_PIXELS:
            raise InputError(too_large(str(path), int(size[2]), int(size[1])))
        image = cv2.imdecode(data, cv2.IMREAD_UNCHANGED)
    except (cv2.error, OSError):
        image = None
    finally:
        cv2.utils.logging.setLogLevel(before)
    if image is None or image.dtype != np.float32 or image.shape[2:] != (3,):
        raise InputError(
            f"{path}: cannot be read as an environment map; "
            "expected .exr, or .hdr with RGBE pixels and rows from the top (-Y +X)"
        )
    for top, end in picture_bands(*image.shape[:2]):
        image[top:end] = image[top:end, :, ::-1]  # from BGR
    return np.asarray(image, np.float32)
