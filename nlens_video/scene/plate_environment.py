"""The light around the object, estimated from the plate: a map of radiance over the sphere.

What the plate shows is projected by the camera onto the sphere around the object: the ground where
rays from the object's middle meet it, all else as if far away. Beyond the frame it is mirrored and
spread, with falling certainty; there the rest is light of one level, which follows from the ground:
its radiance is known, and its reflectance is that of common grounds.
"""

from __future__ import annotations

import math

import cv2
import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from nlens_video.core.layers import Bool, Float32, Float64, clips_at
from nlens_video.scene.camera import Camera
from nlens_video.scene.illumination import LUMINANCE, Illumination, from_lamp
from nlens_video.scene.surround import sphere

COLUMNS = 128
"""Of the map, which has half as many rows: 2.8 degrees each."""
PLATE_COLUMNS = 160
"""Width to which a plate is reduced for it [px]."""
_WHITE = 1.25  # radiance of a white sheet that lies on the ground, in a plate of average level [1]
_MEAN = 0.22  # light of such a plate [1]
USUAL_LEVEL = math.pi * _WHITE
"""Of the light on the ground, in such a plate [1]."""
_EXPOSED = 1.0  # so far from it a plate may be by what it shows; beyond, its light differs [EV]
_FOLLOWED = 0.15  # of the difference in between, share that is the light's [1]
_BURNT, _BARELY = 0.0135, 0.01  # share of clipped pixels of average plates, and least one [1]
_BY_BURNT = 0.45  # of the logarithm of that share, part that is the light's [1]
_GAPS = 3  # between parts of one sky, as of leaves [px of the reduced plate]
_AROUND_PART = np.ones((5, 5), np.uint8)  # around a clipped part [px of the reduced plate]
_DARK = 0.1  # light around it, below which it is a lamp [1]
_MOST_BURNT = 1.5  # what it raises the level by at most [EV]
_DARKEST = 0.06  # reflectance below which grounds are not taken to be: they lie in less light [1]
_DIMMED = 0.25  # of the level, what so little light is at least [1]
_AROUND = 1.5  # light from around by that of the lamps, as is usual [1]
_USUAL = 0.3  # weight of that ratio, where the level of the plate tells one too [1]
_COMPLETE = 3  # distant lamps that light an object from all sides [1]
_MIRRORED = 0.3  # certainty of what is mirrored, where what is seen has 1
_SPREADS = (2.0, 5.0, 12.0, 30.0)  # of what is known over what is not, finest first [map pixels]
_CLIPPED = 0.98  # of the light at which the plate clips, from which a source may be brighter [1]
_BY_SOURCES = 0.15  # of all light on the ground, what clipped sources in view give [1]
_MOST_BOOST = 60.0  # how much brighter than it is told such a source is at most [1]
_LEAST = 0.15  # of the light from around, by that which the ground asks for [1]
_NEAR = 1.5  # ground that tells the level: so many object sizes around it [1]


class Seat(Struct, frozen=True, kw_only=True, eq=False):
    """Where the object stands.

    Attributes:
        middle: of the object, in the world (3,) [scene unit].
        radius: of a sphere around it [scene unit].
        ground_y: height of the ground [scene unit].
    """

    middle: Float64
    radius: float
    ground_y: float

    @classmethod
    def of(cls, bounds: Float32, ground_y: float) -> Seat:
        """The place of an object, from its least and greatest coordinates (2, 3) [scene unit]."""
        ends = bounds.astype(np.float64)
        radius = 0.5 * float(np.linalg.norm(ends[1] - ends[0]))
        return cls(middle=ends.mean(axis=0), radius=radius, ground_y=ground_y)

    @property
    def foot(self) -> Float64:
        """The point of the ground under its middle (3,) [scene unit]."""
        return np.asarray(self.middle * (1.0, 0.0, 1.0) + (0.0, self.ground_y, 0.0))


def plate_environment(
    plate: Float32, camera: Camera, seat: Seat, lamps: Illumination, peak: float = 1.0
) -> tuple[Float32, Float32]:
    """Radiance around the object, and what smooth surfaces mirror of it.

    They differ above the horizon beyond the frame: what a sun or lamps there give is spread over
    it, but a mirror shows sky and walls more as they are seen.

    Args:
        plate: scene-linear (h, w, 3), of any size.
        camera: of the frame.
        seat: where the object stands.
        lamps: the file's lights.
        peak: of the plate's codes.

    Returns:
        Two maps (COLUMNS / 2, COLUMNS, 3), as `reduce_environment` takes them.
    """
    plate = np.maximum(plate, 0.0)  # colours beyond the primaries of sRGB
    directions, solid = sphere(COLUMNS)
    light, seen = _projected(plate, camera, seat, directions)
    up = directions[..., 1]
    ground = _ground_radiance(plate, camera, seat)
    spread, certainty = _extended(light, seen, camera, directions)
    below = up < 0.0
    light = np.where((below & ~seen)[..., None], ground, light)
    wanted = _irradiance_of_ground(plate, level_of_ground(plate, camera, seat), lamps, seat.foot)
    most = _BY_SOURCES * float(wanted @ LUMINANCE)
    told = _unclipped(light, solid, most, clips_at(plate, peak))
    light = np.where(((~below) & seen)[..., None], told, light)
    open_ = (~below & ~seen)[..., None]
    share = np.where(open_, certainty[..., None], 1.0)
    known = np.where(open_, spread, light) * share
    cosine = (np.maximum(up, 0.0) * solid)[..., None]
    overcast = (1.0 + 2.0 * np.maximum(up, 0.0))[..., None] / 3.0  # the CIE's sky
    rest = (1.0 - share) * overcast * cosine
    level = (wanted - (known * cosine).sum((0, 1))) / max(float(rest.sum()), 1e-6)
    level = np.maximum(level, _LEAST * wanted / math.pi)
    radiance = np.asarray(known + (1.0 - share) * overcast * level, dtype=np.float32)
    if not (seen & ~below).any():
        return radiance, radiance
    between = np.sqrt(np.maximum(spread, 0.0) * radiance)  # neither tells how bright it is there
    beyond = spread + (1.0 - share) * (between - spread)
    return radiance, np.where(open_, beyond, light).astype(np.float32)


def _ground_radiance(plate: Float32, camera: Camera, seat: Seat) -> Float64:
    """Radiance (3,) of the ground around the object; of the whole plate where none is seen."""
    height, width = plate.shape[:2]
    points, before = _ground_points(camera, (height, width), seat)
    away = np.linalg.norm(points - seat.foot, axis=-1) / max(seat.radius, 1e-9)
    weight = before * np.exp(-0.5 * (away / _NEAR) ** 2)
    if float(weight.sum()) < 1e-3 * height * width:
        weight = before * 1.0 if before.any() else np.ones((height, width))
    return np.asarray(
        np.einsum("hw,hwc->c", weight, np.clip(plate, 0.0, 1.0).astype(np.float64)) / weight.sum()
    )


def _irradiance_of_ground(
    plate: Float32, level: float, lamps: Illumination, foot: Float64
) -> Float64:
    """Irradiance (3,) that the ground gets from around, beside the file's lights.

    With lamps of the file, what they leave of the level and a usual share of their light are
    averaged. There is one sun: a distant lamp beside the strongest stands for light from around,
    and is a part of it; with several more the file holds nearly all light.

    Args:
        plate: scene-linear (h, w, 3).
        level: luminous irradiance by all light [1].
        lamps: the file's lights.
        foot: the point of the ground (3,) [scene unit].
    """
    mean = _mean_light(plate)
    distant = [one for one in lamps.lamps if one.posed.light.kind == "directional"]
    suns = [float(from_lamp(one, foot) @ LUMINANCE) for one in distant]
    fill = sum(suns) - max(suns, default=0.0)
    given = float(lamps.on_plane(foot) @ LUMINANCE) - fill
    if given > 0.0:
        left = max(level - given, _LEAST * level)
        around = left ** (1.0 - _USUAL) * (_AROUND * given) ** _USUAL
        level = max(around - fill if len(suns) < _COMPLETE else 0.0, _LEAST * around)
    hue = np.sqrt(np.maximum(mean, 1e-4))
    return np.asarray(level * hue / (hue @ LUMINANCE))  # half the hue is taken for the surfaces'


def level_of_ground(plate: Float32, camera: Camera, seat: Seat) -> float:
    """Luminous irradiance of the ground by all light, as `plate_environment` takes it [1].

    A camera is set so that white is about as bright in most plates, whatever they show. The more
    of what lies below the horizon is burnt out, the brighter it is in this one.

    Args:
        plate: scene-linear (h, w, 3), of any size.
        camera: of the frame.
        seat: where the object stands.
    """
    mean = float(_mean_light(plate) @ LUMINANCE)
    near = max(float(_ground_radiance(plate, camera, seat) @ LUMINANCE), 1e-4)
    stops = math.log2(math.sqrt(max(mean, 1e-4) * near) / _MEAN)
    beyond = math.copysign(max(abs(stops) - _EXPOSED, 0.0), stops)
    burnt = math.log2((_burnt_out(plate, camera, seat) + _BARELY) / _BURNT)
    raised = min(_BY_BURNT * burnt, _MOST_BURNT)
    level = math.pi * _WHITE * 2.0 ** (_FOLLOWED * (stops - beyond) + beyond + raised)
    # against a bright sky, as at dusk, the ground tells more of the light than the whole plate
    return float(min(level, max(math.pi * near / _DARKEST, _DIMMED * level)))


def _mean_light(plate: Float32) -> Float64:
    """Mean light (3,) of a plate that ends at white, as most plates do.

    In one that does not, a sun in view would be most of the mean.
    """
    return np.asarray(np.clip(plate, 0.0, 1.0).mean((0, 1)).astype(np.float64))


def _burnt_out(plate: Float32, camera: Camera, seat: Seat) -> float:
    """Share of clipped pixels below the horizon, of all where none is below it [1].

    What reaches up to the frame's border is sky, wherever a camera that is guessed has its horizon,
    and what is dark all around is a lamp.
    """
    clipped = (plate.max(axis=2) >= _CLIPPED).astype(np.uint8)
    _, parts = cv2.connectedComponents(cv2.dilate(clipped, np.ones((_GAPS, _GAPS), np.uint8)))
    sky = np.isin(parts, parts[0][parts[0] > 0])
    grown = cv2.dilate(parts.astype(np.uint16), _AROUND_PART)
    rings = np.where(parts == 0, grown, 0).ravel()
    light = np.bincount(rings, plate.max(axis=2).ravel(), parts.max() + 1)
    lamps = light < _DARK * np.bincount(rings, minlength=parts.max() + 1)
    _, below = _ground_points(camera, (plate.shape[0], plate.shape[1]), seat)
    burnt = (clipped > 0) & ~sky & ~lamps[parts]
    return float((burnt[below] if below.any() else burnt).mean())


def _ground_points(camera: Camera, size: tuple[int, int], seat: Seat) -> tuple[Float64, Bool]:
    """Points of the ground (h, w, 3) at the pixels of a reduced frame, and where it is seen."""
    height, width = size
    across, down = width / camera.width, height / camera.height
    small = replace(
        camera, fx=camera.fx * across, fy=camera.fy * down, cx=camera.cx * across,
        cy=camera.cy * down, width=width, height=height,
    )  # fmt: skip
    return small.plane_points(seat.ground_y), small.plane_disparity(seat.ground_y) > 0.0


def _projected(
    plate: Float32, camera: Camera, seat: Seat, directions: Float64
) -> tuple[Float64, Bool]:
    """The plate's light in each direction (h, w, 3), and where it shows any (h, w)."""
    flat = directions.reshape(-1, 3)
    height = max(float(seat.middle[1]) - seat.ground_y, 1e-6 * seat.radius)
    steep = np.minimum(flat[:, 1], -1e-3)
    on_ground = camera.to_camera(seat.middle + flat * (height / -steep)[:, None])
    far = flat @ camera.world_from_camera[:3, :3]
    looked = np.where((flat[:, 1] < -1e-3)[:, None], on_ground, far)
    front = looked[:, 2] < -1e-9 * np.abs(looked).max(axis=1)
    looked[~front] = (0.0, 0.0, -1.0)
    places = camera.pixels(looked)
    inside = (places >= 0.0).all(axis=1) & (places < (camera.width, camera.height)).all(axis=1)
    seen = (front & inside).reshape(directions.shape[:2])
    ratio = np.array([plate.shape[1] / camera.width, plate.shape[0] / camera.height])
    x, y = (places * ratio - 0.5).T.astype(np.float32)
    shape = directions.shape[:2]
    sampled = cv2.remap(
        plate, x.reshape(shape), y.reshape(shape), cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    ).astype(np.float64)
    return sampled * seen[..., None], seen


def _extended(
    light: Float64, seen: Bool, camera: Camera, directions: Float64
) -> tuple[Float64, Float64]:
    """What is known of the upper half, mirrored and spread (h, w, 3), and its certainty (h, w)."""
    upper = seen & (directions[..., 1] >= 0.0)
    if not upper.any():
        upper = seen  # a camera that looks down: what it shows stands for the horizon too
    if not upper.any():
        return np.zeros_like(light), np.zeros(seen.shape)
    forward = -camera.world_from_camera[:3, 2]
    azimuth = math.atan2(forward[2], forward[0])
    rows, columns = seen.shape
    # mirrored in the plane across the view: what lies at `turn` is seen at 2 * side - turn
    side = azimuth + 0.5 * math.pi
    number = np.arange(columns)
    other = np.round((2.0 * side) / (2.0 * math.pi) * columns - 1 + columns - number).astype(int)
    mirrored, there = light[:, other % columns], upper[:, other % columns]
    weight = np.where(upper, 1.0, _MIRRORED * there)
    known = np.where(upper[..., None], light, mirrored) * weight[..., None]
    out, sure = np.zeros_like(light), np.zeros(seen.shape)
    for sigma in _SPREADS:
        own, color = _blurred(weight, sigma), _blurred(known, sigma)
        part = np.clip(own, 0.0, 1.0) * (1.0 - sure)
        out += part[..., None] * color / np.maximum(own, 1e-9)[..., None]
        sure += part
    return out / np.maximum(sure, 1e-9)[..., None], sure


def _blurred(values: Float64, sigma: float) -> Float64:
    """A map, blurred round about [map pixels]."""
    edge = values.shape[1] // 2
    wide = np.concatenate([values[:, -edge:], values, values[:, :edge]], axis=1)
    soft = cv2.GaussianBlur(wide, (0, 0), sigma, borderType=cv2.BORDER_REPLICATE)
    return np.asarray(soft[:, edge : edge + values.shape[1]])


def _unclipped(light: Float64, solid: Float64, irradiance: float, clip: float) -> Float64:
    """The light with sources that clip so bright that they give this across their direction.

    Args:
        light: in each direction (h, w, 3).
        solid: angle of each (h, w) [sr].
        irradiance: by all such sources.
        clip: light at which the plate clips; what is brighter than white below it is as told.
    """
    clipped = light.max(axis=2) >= _CLIPPED * clip
    if not clipped.any():
        return light
    told = clip * float(solid[clipped].sum())
    boost = float(np.clip(irradiance / max(told, 1e-9), 1.0, _MOST_BOOST))
    return light * np.where(clipped, boost, 1.0)[..., None]
