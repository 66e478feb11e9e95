"""Where the sun stands, by the shadows that the plate shows on its ground.

The plate is laid onto a map of the ground by azimuth and logarithm of distance. There, a shadow
runs everywhere at the same angle to the direction of view, whatever the camera's pitch and focal
length, and a thing of one shape has one size. A network (`models/sun`) reads the map. It answers
with a distribution over the sun's azimuth and elevation, with how likely a sun shines at all, and
with what its shadows leave of the light. A shadow is spread as that distribution is.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import cv2
import numpy as np
from msgspec import Struct
from msgspec.structs import replace

from nlens_video.core.layers import Bool, Float32, Float64, Picture
from nlens_video.core.settings import SunSettings
from nlens_video.scene.camera import Camera
from nlens_video.scene.plate_shadows import share_in_shadow

SunNetwork = Callable[[Float32], Float32]
"""Features (MAP_ROWS, MAP_COLUMNS, CHANNELS) to ANSWERS numbers."""
ROWS, COLUMNS = 112, 192
"""Size that a plate is reduced to."""
MAP_ROWS, MAP_COLUMNS = 96, 128
CHANNELS = 6
"""Code values, whether the plate shows the place, logarithm of its distance, and its azimuth."""
AZIMUTHS, ELEVATIONS = 36, 10
LOWEST_DEG, HIGHEST_DEG = 5.0, 85.0
ANSWERS = AZIMUTHS + ELEVATIONS + 2
"""Logarithms of the shares of azimuths, then of elevations; the logit of a sun; and what its
shadows leave of the light [EV]."""
BRIGHT_PERCENTILE, BRIGHT = 88.0, 0.6
"""Light of a reduced plate that is brought to a fixed level."""
_ACROSS = 2.5  # columns of the map by rows, for one and the same length on the ground
_FARTHEST = 28.0  # by the camera's height above the ground
_LEVEL = 1e-3  # slope of a ray that meets no ground
_NEAR_DEG = 25.0
_SURE, _SURE_ALONE = 0.6, 0.8  # with shadows on the ground that are as it casts them, without [1]
_MILDER = 0.85  # depth of shadows on rendered plates by what the network says [1]
_LAMPS = 0.5  # share of places without a sun that a lamp lights from one side, as in training [1]
_TURNS = 72  # that stand for the distribution of the azimuth


class PlateSun(Struct, frozen=True, eq=False):
    """What a plate tells of its sun, or of the lamp that lights it from one side.

    Attributes:
        azimuth: the likeliest, from the view to the right [rad].
        elevation: above the horizon [rad].
        turns: what to add to the azimuth, each as likely as the others (T,) [rad].
        left: share of the ground's light that its shadows leave (3,) [1].
        certainty: how likely it shines, and within 25 degrees of the azimuth [1].
        sure: whether that is enough to light the object by it.
    """

    azimuth: float
    elevation: float
    turns: Float64
    left: Float64
    certainty: float
    sure: bool = False

    @property
    def note(self) -> str:
        """It in one line, for the user."""
        where = self.settings
        told = (
            "shadows on the plate tell a sun:"
            if self.sure
            else "no sun is sure, and a shadow by it is broad; the likeliest is"
        )
        return (
            f"{told} --sun {round(where.azimuth_deg)},{round(where.elevation_deg)} "
            f"({100.0 * self.certainty:.0f} % sure); --sun none leaves it out"
        )

    @property
    def settings(self) -> SunSettings:
        """It, as an option would give it."""
        return SunSettings(
            azimuth_deg=math.degrees(self.azimuth), elevation_deg=math.degrees(self.elevation)
        )


class GroundMaps(Struct, frozen=True, eq=False):
    """Maps of the ground that frames see.

    Attributes:
        places: of the map's pixels in the frame, from its upper left, 0 to 1 where the frame shows
            them (N, MAP_ROWS, MAP_COLUMNS, 2).
        distance: logarithm, by the camera's height (N, MAP_ROWS, 1).
        azimuth: from the view to the right (N, 1, MAP_COLUMNS) [rad].
        seen: whether the frame sees any ground (N,).
    """

    places: Float32
    distance: Float32
    azimuth: Float32
    seen: Bool

    @classmethod
    def of(cls, turn: Float64, lens: Float64, window: Float64) -> GroundMaps:
        """Maps for cameras.

        Args:
            turn: rotations (N, 3, 3) of camera coordinates to right, up and back of the view.
            lens: focal length across and down, and principal point, by the frame's width and
                height (N, 4).
            window: left, top, right and bottom of the part of the frame that counts (N, 4).
        """
        corners = window[:, [[0, 1], [2, 1], [0, 3], [2, 3]]]
        middle = 0.5 * (corners[:, [0, 2]] + corners[:, [1, 3]])
        ends = np.concatenate([corners, middle], axis=1)
        rays = np.concatenate([
            (ends - lens[:, None, 2:]) / lens[:, None, :2] * (1.0, -1.0),
            np.full((*ends.shape[:2], 1), -1.0),
        ], axis=2)  # fmt: skip
        rays = np.einsum("nij,nkj->nki", turn, rays)
        level = np.hypot(rays[..., 0], rays[..., 2])
        down = -rays[..., 1]
        away = np.where(down > _LEVEL * level, level / np.maximum(down, 1e-9), np.inf)
        nearest = away.min(axis=1)
        seen = np.isfinite(nearest) & (nearest < _FARTHEST)
        nearest = np.where(seen, nearest, 1.0)
        farthest = np.clip(away.max(axis=1), 1.05 * nearest, _FARTHEST)
        around = np.arctan2(rays[..., 0], -rays[..., 2])
        left, right = around.min(axis=1), around.max(axis=1)
        step = np.maximum(
            np.log(farthest / nearest) / MAP_ROWS, _ACROSS * (right - left) / MAP_COLUMNS
        )
        rows, columns = MAP_ROWS - 0.5 - np.arange(MAP_ROWS), np.arange(MAP_COLUMNS) + 0.5
        distance = np.log(nearest)[:, None] + step[:, None] * rows
        azimuth = 0.5 * (left + right)[:, None]
        azimuth = azimuth + step[:, None] / _ACROSS * (columns - 0.5 * MAP_COLUMNS)
        places = _places(turn, lens, np.exp(distance), azimuth)
        return cls(
            places.astype(np.float32),
            distance[..., None].astype(np.float32),
            azimuth[:, None].astype(np.float32),
            seen,
        )

    @property
    def coordinates(self) -> Float32:
        """Distances and azimuths as features (N, MAP_ROWS, MAP_COLUMNS, 2)."""
        shape = self.places.shape[:3]
        return np.stack([
            np.broadcast_to(self.distance, shape), np.broadcast_to(self.azimuth, shape),
        ], axis=-1)  # fmt: skip


def _places(turn: Float64, lens: Float64, distance: Float64, azimuth: Float64) -> Float64:
    """Where frames show points of the ground, by distance (N, R) and azimuth (N, C)."""
    # columns of the turn's transpose: what right, up and back are to the camera
    right, up, back = (turn[:, k, None, None, :] for k in range(3))
    x = (distance[:, :, None] * np.sin(azimuth)[:, None])[..., None]
    z = (-distance[:, :, None] * np.cos(azimuth)[:, None])[..., None]
    seen = x * right - up + z * back
    ahead = -seen[..., 2]
    safe = np.where(ahead > 1e-6, ahead, 1.0)
    places = np.stack([
        lens[:, None, None, 2] + lens[:, None, None, 0] * seen[..., 0] / safe,
        lens[:, None, None, 3] - lens[:, None, None, 1] * seen[..., 1] / safe,
    ], axis=-1)  # fmt: skip
    return np.where((ahead > 1e-6)[..., None], places, -1.0)


def ground_map(camera: Camera) -> GroundMaps:
    """The map of the ground that a camera sees."""
    turn = np.stack(level_axes(camera)) * np.array([[1.0], [1.0], [-1.0]])
    lens = np.array([
        camera.fx / camera.width, camera.fy / camera.height, camera.cx / camera.width,
        camera.cy / camera.height,
    ])  # fmt: skip
    turn = turn @ camera.world_from_camera[:3, :3]
    return GroundMaps.of(turn[None], lens[None], np.array([[0.0, 0.0, 1.0, 1.0]]))


def sun_features(plate: Float32, ground: GroundMaps) -> Float32:
    """What the network sees (MAP_ROWS, MAP_COLUMNS, CHANNELS).

    Args:
        plate: scene-linear (H, W, 3).
        ground: the map of its camera.
    """
    small = cv2.resize(plate, (COLUMNS, ROWS), interpolation=cv2.INTER_AREA)
    bright = float(np.percentile(small.mean(axis=2), BRIGHT_PERCENTILE))
    code = np.clip(small * (BRIGHT / max(bright, 1e-6)), 0.0, 1.0) ** np.float32(1.0 / 2.2)
    places = ground.places[0]
    at = places * np.array([COLUMNS, ROWS], np.float32) - np.float32(0.5)
    laid = cv2.remap(
        code, at[..., 0], at[..., 1], cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
    )
    shown = ((places > 0.0) & (places < 1.0)).all(axis=-1, keepdims=True)
    return np.concatenate([laid * shown, shown, ground.coordinates[0]], axis=2, dtype=np.float32)


def level_axes(camera: Camera) -> tuple[Float64, Float64, Float64]:
    """Directions (3,) to the right of a camera's view, up, and where it looks, all level but up."""
    right = camera.world_from_camera[:3, 0] * (1.0, 0.0, 1.0)
    right = right / max(float(np.linalg.norm(right)), 1e-9)
    return right, np.array([0.0, 1.0, 0.0]), np.array([right[2], 0.0, -right[0]])


def toward_sun(given: SunSettings, camera: Camera) -> Float64:
    """Direction (3,) towards a sun whose azimuth counts from where the camera looks."""
    azimuth, elevation = math.radians(given.azimuth_deg), math.radians(given.elevation_deg)
    right, up, forward = level_axes(camera)
    flat = math.cos(azimuth) * forward + math.sin(azimuth) * right
    return np.asarray(math.cos(elevation) * flat + math.sin(elevation) * up)


def plate_sun(
    network: SunNetwork, picture: Picture, camera: Camera, ground_y: float
) -> PlateSun | None:
    """The sun that a plate tells, None where the camera sees no ground.

    It is sure sooner where patches of the ground are shadows as it casts them; these then tell
    what its shadows leave.

    Args:
        network: the sun network.
        picture: the plate.
        camera: of the frame that it shows.
        ground_y: height of the ground [scene unit].
    """
    found = read_sun(network, picture.downsample(COLUMNS, ROWS), camera)
    if found is None or found.certainty < _SURE:
        return found
    left = share_in_shadow(picture, camera, ground_y, toward_sun(found.settings, camera))
    if left is None:
        return replace(found, sure=found.certainty >= _SURE_ALONE)
    return replace(found, left=left, sure=True)


def read_sun(network: SunNetwork, plate: Float32, camera: Camera) -> PlateSun | None:
    """What the network says of a plate and its mirror image, None where there is no ground.

    Args:
        network: the sun network.
        plate: scene-linear (H, W, 3).
        camera: of the frame that it shows.
    """
    ground = ground_map(camera)
    if not ground.seen[0]:
        return None
    features = sun_features(plate, ground)
    turned = np.ascontiguousarray(features[:, ::-1])
    turned[..., -1] *= -1.0
    own, other = (network(one).astype(np.float64) for one in (features, turned))
    azimuths = 0.5 * (_shares(own[:AZIMUTHS]) + _shares(other[:AZIMUTHS])[_MIRRORED])
    rest = 0.5 * (own[AZIMUTHS:] + other[AZIMUTHS:])
    at = 2.0 * math.pi * np.arange(AZIMUTHS) / AZIMUTHS
    mode = float(at[int(_smooth(azimuths).argmax())])
    off = (at - mode + math.pi) % (2.0 * math.pi) - math.pi
    near = np.abs(off) <= math.radians(_NEAR_DEG) + 1e-9
    azimuth = mode + float((off * azimuths)[near].sum() / azimuths[near].sum())
    elevations = _shares(rest[:ELEVATIONS])
    middles = LOWEST_DEG + (np.arange(ELEVATIONS) + 0.5) * (HIGHEST_DEG - LOWEST_DEG) / ELEVATIONS
    shines = 1.0 / (1.0 + math.exp(-rest[ELEVATIONS]))
    taken = 1.0 - 2.0 ** min(_MILDER * rest[ELEVATIONS + 1], -0.1)
    return PlateSun(
        azimuth=(azimuth + math.pi) % (2.0 * math.pi) - math.pi,
        elevation=math.radians(float(middles @ elevations)),
        turns=_turns(azimuths, azimuth),
        left=np.full(3, 1.0 - taken * (shines + (1.0 - shines) * _LAMPS)),
        certainty=shines * float(azimuths[near].sum()),
    )


def _turns(shares: Float64, azimuth: float) -> Float64:
    """Quantiles (T,) of a distribution (AZIMUTHS,), by an azimuth, from its far side on."""
    step = 2.0 * math.pi / AZIMUTHS
    far = round(azimuth / step) + AZIMUTHS // 2
    below = np.append(0.0, np.cumsum(np.roll(shares, -far)))
    edges = (np.arange(AZIMUTHS + 1) - 0.5 + far) * step - azimuth - 2.0 * math.pi
    found = np.interp((np.arange(_TURNS) + 0.5) / _TURNS, below / below[-1], edges)
    return np.asarray(found, np.float64)


_MIRRORED = -np.arange(AZIMUTHS) % AZIMUTHS


def _shares(logarithms: Float64) -> Float64:
    shares = np.exp(logarithms - logarithms.max())
    return np.asarray(shares / shares.sum())


def _smooth(shares: Float64) -> Float64:
    return np.asarray(shares + 0.7 * (np.roll(shares, 1) + np.roll(shares, -1)))
