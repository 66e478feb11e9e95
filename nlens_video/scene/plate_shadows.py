"""How dark the plate's own shadows are, and of what colour, under a sun whose direction is known.

Ground of one material shows one colour where it is lit. Darker patches of it are shadows if they
lie as such a sun casts them: towards it stands the thing that casts them, away from it and on both
sides the ground is lit again. Dark tiles and stains have lit ground all around, dark things have
their own shadow behind them. What several such patches agree on is the share of the light that a
shadow leaves, in each channel: that of all light but the sun's.
"""

from __future__ import annotations

import cv2
import numpy as np
import numpy.typing as npt
from msgspec import Struct
from msgspec.structs import replace

from nlens_video.core.layers import Bool, Float32, Float64, Picture, clips_at
from nlens_video.scene.camera import Camera
from nlens_video.scene.illumination import LUMINANCE, Illumination, Lamp

_COLUMNS = 480  # width to which a plate is reduced for it [px]
_FARTHEST = 0.1  # ground that is looked at: disparity by that of the nearest in view [1]
_SOFT_PX = 2.0  # the ground's texture is averaged over such a Gaussian [px]
_DARKEST = 1e-3  # light below which pixels tell nothing [1]
_CLIPPED = 0.95  # of the light at which the plate clips, from which it does not tell more [1]
_BIN_EV = 0.1  # of histograms of how dark pixels are [EV]
_LIT_EV, _LIT_HUE_EV = 0.35, 0.3  # lit ground: so near to its usual light and hue [EV]
_UNIFORM = 0.3  # share of the ground that is such, at least [1]
_SHADED_EV = (-3.0, -0.4)  # of patches that may be shadows, by the lit ground [EV]
_TINTED_EV = 0.8  # red by green of such, either way [EV]
_BLUER_EV = (-0.05, 1.4)  # blue by red of such: the sky is bluer than its sun [EV]
_COOLER_EV = 0.15  # no channel of a patch is darker by more than its redder neighbour [EV]
_INNER_PX = 5  # what lies so near to a patch's edge is not counted in its depth: penumbra [px]
_FEWEST = 40  # pixels of a patch that are left then
_BEYOND_PX = 6.0  # so far beyond the edge is looked at what is there [px]
_TOWARD = 0.5  # cosine from which on an edge faces the sun or lies away from it [1]
_SIDE = 0.04  # of a patch's edge, the least that tells of a side of it [1]
_MATCH = 0.5  # of each side, the least that must be as a sun casts it [1]
_MOST_AREA = 1500.0  # a larger patch tells no more [px]
_AGREE_EV = 0.2  # standard deviation of what patches of one sun say [EV]
_SURE = 8.0  # evidence from which on it is used: a well cast patch has the root of its area [px]
_AGREED = 0.5  # share of the evidence that agrees, at least [1]
_LEFT = (0.02, 0.98)  # share that is left, whatever is measured [1]
_STRONGEST = 0.7  # of the light of distant lamps: with as much the shadow is that of one of them
_LEAST_STRONG = 0.6  # the same, below which they no longer tell how dark that one's shadow is

Indices = npt.NDArray[np.int64]
Mask = npt.NDArray[np.uint8]


class DarkPatches(Struct, frozen=True, kw_only=True, eq=False):
    """Darker patches of a ground of one material, and what lies around each.

    Attributes:
        area: of each without its edge (P,) [px].
        depth: how much darker most of it is than lit ground (P,), negative [EV].
        color: the same in each channel (P, 3) [EV].
        owner: patch of each pixel of the edges (E,).
        outward: unit vector on the ground, along X and Z, out of the patch there (E, 2).
        length: of the edge there, as it is seen (E,) [any unit].
        lit: whether lit ground lies beyond (E,).
        thing: whether neither lit ground nor a patch does (E,).
    """

    area: Float64
    depth: Float64
    color: Float64
    owner: Indices
    outward: Float64
    length: Float64
    lit: Bool
    thing: Bool

    def share_left(self, toward: Float64) -> Float64 | None:
        """Share of the ground's light (3,) that a sun's shadow leaves; None where it is not sure.

        Args:
            toward: direction to the sun (3,), whose shadows they may be.
        """
        flat = np.asarray(toward, np.float64)[[0, 2]]
        far = float(np.hypot(*flat))
        if not len(self.area) or far < 1e-6:
            return None
        facing = self.outward @ (flat / far)
        away, before = facing < -_TOWARD, facing > _TOWARD
        cast = np.minimum(self._share(away, self.lit), self._share(before, self.thing))
        cast = np.minimum(cast, self._share(~away & ~before, self.lit))
        weight = np.sqrt(np.minimum(self.area, _MOST_AREA))
        weight *= np.maximum(cast - _MATCH, 0.0) / (1.0 - _MATCH)
        near = np.exp(-0.5 * ((self.depth[:, None] - self.depth) / _AGREE_EV) ** 2)
        agreed = weight @ near
        best = int(agreed.argmax())
        if agreed[best] < max(_SURE, _AGREED * float(weight.sum())):
            return None
        weight *= near[best]
        return np.asarray(np.exp2(weight @ self.color / weight.sum()))

    def _share(self, side: Bool, as_cast: Bool) -> Float64:
        """Share of one side of each patch's edge (P,) beyond which it is so; 0 without a side."""
        count = len(self.area)
        whole, own, found = (
            np.bincount(self.owner, weights=self.length * part, minlength=count)
            for part in (np.ones(len(side)), side, side & as_cast)
        )
        return np.where(own > _SIDE * whole, found / np.maximum(own, 1e-12), 0.0)


def share_in_shadow(
    picture: Picture, camera: Camera, ground_y: float, toward: Float64
) -> Float64 | None:
    """Share of the ground's light (3,) that a sun's shadows leave; None where it is not sure.

    Args:
        picture: the plate.
        camera: of the frame.
        ground_y: height of the ground [scene unit].
        toward: direction to the sun (3,).
    """
    columns = min(_COLUMNS, picture.width)
    rows = max(1, round(columns * picture.height / picture.width))
    found = dark_patches(picture.downsample(columns, rows), camera, ground_y, picture.peak)
    left = None if found is None else found.share_left(toward)
    return None if left is None else np.clip(left, *_LEFT)


def dark_patches(
    plate: Float32, camera: Camera, ground_y: float, peak: float = 1.0
) -> DarkPatches | None:
    """The darker patches of the ground; None where the ground is not of one material.

    Args:
        plate: scene-linear (h, w, 3), of some hundred columns.
        camera: of the frame.
        ground_y: height of the ground [scene unit].
        peak: of the plate's codes.
    """
    height, width = plate.shape[:2]
    view = camera.resized(width, height)
    disparity = view.plane_disparity(ground_y)
    ground = disparity > max(_FARTHEST * float(disparity.max()), 0.0)
    if int(ground.sum()) < _FEWEST:
        return None
    soft = np.maximum(cv2.GaussianBlur(plate, (0, 0), _SOFT_PX), np.float32(_DARKEST))
    stops, light = np.log2(soft), np.log2(soft @ LUMINANCE.astype(np.float32))
    usual = _mode(light[ground])
    near = ground & (np.abs(light - usual) < 2.0 * _BIN_EV)
    clipped = _CLIPPED * clips_at(plate, peak)
    if not near.any() or float(np.exp2(np.median(stops[near], axis=0)).max()) > clipped:
        return None
    reference = np.median(stops[near], axis=0)
    depth, color = light - float(np.median(light[near])), stops - reference
    red, blue = color[..., 0] - color[..., 1], color[..., 2] - color[..., 1]
    hue = np.maximum(np.abs(red), np.abs(blue)) < _LIT_HUE_EV
    lit: Bool = np.asarray(ground & (np.abs(depth) < _LIT_EV) & hue)
    if lit.sum() < _UNIFORM * ground.sum():
        return None
    bluer = blue - red
    dark = ground & (depth > _SHADED_EV[0]) & (depth < _SHADED_EV[1])
    dark &= (np.abs(red) < _TINTED_EV) & (bluer > _BLUER_EV[0]) & (bluer < _BLUER_EV[1])
    kernel = np.ones((_INNER_PX, _INNER_PX), np.uint8)
    mask = np.asarray(cv2.morphologyEx(dark.astype(np.uint8), cv2.MORPH_OPEN, kernel), np.uint8)
    inner: Bool = np.asarray(cv2.erode(mask, kernel) > 0)
    labels = _kept(mask, inner)
    whole, tint = _depths(labels[inner], depth[inner], color[inner])
    area = np.bincount(labels[inner], minlength=len(whole))[1:].astype(np.float64)
    shadowy = np.all(tint[:, :2] <= tint[:, 1:] + _COOLER_EV, axis=1)
    at: Bool = (labels > 0) & (cv2.erode(mask, np.ones((3, 3), np.uint8)) == 0)
    outward, length, beyond = _edges(mask, at, view, ground_y)
    there = beyond >= 0
    where = np.divmod(beyond[there], width)
    return DarkPatches(
        area=area * shadowy[1:],
        depth=whole[1:],
        color=tint[1:],
        owner=labels[at][there].astype(np.int64) - 1,
        outward=outward[there],
        length=(length * disparity[at])[there],
        lit=lit[where],
        thing=~lit[where] & (mask[where] == 0),
    )


def _mode(values: Float32) -> float:
    """Where most of some values lie [EV]."""
    counts, edges = np.histogram(values, bins=np.arange(np.log2(_DARKEST), 1.0, _BIN_EV))
    smooth = np.convolve(counts, (0.25, 0.5, 0.5, 0.5, 0.25), "same")
    return float(edges[smooth.argmax()] + 0.5 * _BIN_EV)


def _kept(mask: Mask, inner: Bool) -> npt.NDArray[np.int32]:
    """Numbers of the patches that are large enough (h, w), from 1 on, and 0 elsewhere."""
    count, labels = cv2.connectedComponents(mask)
    large = np.bincount(labels[inner], minlength=count) >= _FEWEST
    large[0] = False
    number = np.where(large, np.cumsum(large), 0).astype(np.int32)
    return np.asarray(number[labels])


def _depths(
    owner: npt.NDArray[np.int32], depth: Float32, color: Float32
) -> tuple[Float64, Float64]:
    """How dark most of each patch is (P + 1,), and in each channel (P + 1, 3); row 0 is none's."""
    count = int(owner.max(initial=0)) + 1
    low, high = _SHADED_EV[0] - 2.0 * _BIN_EV, _SHADED_EV[1] + 2.0 * _BIN_EV
    bins = round((high - low) / _BIN_EV)
    place = np.clip((depth - low) / _BIN_EV, 0, bins - 1).astype(np.int64)
    counts = np.bincount(owner * bins + place, minlength=count * bins).reshape(count, bins)
    smooth = counts[:, 1:-1] + 0.5 * (counts[:, :-2] + counts[:, 2:])
    mode = low + (smooth.argmax(axis=1) + 1.5) * _BIN_EV
    near = np.abs(depth - mode[owner]) < 1.5 * _BIN_EV
    sums = np.maximum(np.bincount(owner[near], minlength=count), 1)
    channels = [np.bincount(owner[near], one[near], count) / sums for one in color.T]
    return mode, np.stack(channels, axis=1)


def _edges(mask: Mask, at: Bool, view: Camera, ground_y: float) -> tuple[Float64, Float64, Indices]:
    """Of pixels of the edges: the way out on the ground (E, 2), length, and the pixel beyond (E,).

    The pixel beyond is -1 where the frame ends before it.
    """
    height, width = mask.shape
    soft = cv2.GaussianBlur(mask.astype(np.float32), (0, 0), _SOFT_PX)
    across, down = -cv2.Sobel(soft, cv2.CV_32F, 1, 0)[at], -cv2.Sobel(soft, cv2.CV_32F, 0, 1)[at]
    size = np.maximum(np.hypot(across, down), 1e-9)
    normal = np.stack([across, down], axis=1).astype(np.float64) / size[:, None]
    rows, columns = np.nonzero(at)
    places = np.stack([columns, rows], axis=1) + 0.5
    right, lower = (
        _ground_at(view, places + step, ground_y) - _ground_at(view, places - step, ground_y)
        for step in 0.5 * np.eye(2)
    )
    out = right * normal[:, :1] + lower * normal[:, 1:]
    along = lower * normal[:, :1] - right * normal[:, 1:]  # the edge itself, on the ground
    length = np.hypot(*along.T)
    outward = np.stack([along[:, 1], -along[:, 0]], axis=1) / np.maximum(length, 1e-12)[:, None]
    outward *= np.sign((outward * out).sum(axis=1))[:, None]
    x = np.round(columns + _BEYOND_PX * normal[:, 0]).astype(np.int64)
    y = np.round(rows + _BEYOND_PX * normal[:, 1]).astype(np.int64)
    inside = (x >= 0) & (x < width) & (y >= 0) & (y < height)
    return outward, length, np.where(inside, y * width + x, -1)


def _ground_at(view: Camera, places: Float64, ground_y: float) -> Float64:
    """Points of the ground (E, 2), along X and Z, at places (E, 2) of the frame [scene unit]."""
    rays = np.column_stack([
        (places[:, 0] - view.cx) / view.fx, (view.cy - places[:, 1]) / view.fy,
        np.full(len(places), -1.0),
    ])  # fmt: skip
    rays = rays @ view.world_from_camera[:3, :3].T
    eye = view.world_from_camera[:3, 3]
    return np.asarray(eye[[0, 2]] + rays[:, [0, 2]] * ((ground_y - eye[1]) / rays[:, 1])[:, None])


def strongest_distant(
    lamps: tuple[Lamp, ...], least_share: float = _STRONGEST
) -> tuple[Lamp, Float64, Float64] | None:
    """The distant lamp that gives the ground nearly all of their light, its light, and all (3,).

    Args:
        lamps: all that shine.
        least_share: of the light of the distant ones that it must give [1].
    """
    above = Illumination(tuple(one for one in lamps if one.posed.light.kind == "directional"), None)
    given = [Illumination((one,), None).on_plane(np.zeros(3)) for one in above.lamps]
    whole = np.asarray(sum(given, np.zeros(3)))
    if float(whole @ LUMINANCE) <= 0.0:
        return None
    best = int(np.argmax([one @ LUMINANCE for one in given]))
    strong = float(given[best] @ LUMINANCE) >= least_share * float(whole @ LUMINANCE)
    return (above.lamps[best], given[best], whole) if strong else None


def as_shaded(light: Illumination, left: Float64) -> Illumination:
    """The light with so much around that the strongest lamp's shadow leaves a share of it.

    Where another lamp becomes as strong, the light around goes back to what it was without a jump.

    Args:
        light: lamps and the light around.
        left: share of the light in the strongest lamp's shadow (3,), below 1 [1].
    """
    found = strongest_distant(light.lamps, _LEAST_STRONG)
    around = light.irradiance_around(np.array([0.0, 1.0, 0.0]))
    if found is None or light.ambient is None or not (around > 0.0).all():
        return light
    _, strongest, whole = found
    wanted = np.maximum(left / (1.0 - left) * strongest - (whole - strongest), 0.0)
    share = float(strongest @ LUMINANCE) / float(whole @ LUMINANCE)
    told = min((share - _LEAST_STRONG) / (_STRONGEST - _LEAST_STRONG), 1.0)
    told *= told * (3.0 - 2.0 * told)
    return replace(light, ambient=light.ambient * (told * (wanted / around) + (1.0 - told)))
