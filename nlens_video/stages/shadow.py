"""The object's shadow on the ground plane, by differential rendering (Debevec 1998).

The plate is multiplied by the ratio of the light that its ground gets with the object to that
without it. Soft edges come from many points of each lamp, contact darkening from many directions of
the light from around, each a projection of the same triangles on the plane. The lens then blurs the
loss of light as it blurs the ground there: the paper leaves that open.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from nlens_video.frames import (
    BlurredLayer,
    Bool,
    Box,
    DefocusedLayer,
    Float32,
    Float64,
    ObjectLayer,
    Picture,
)  # fmt: skip
from nlens_video.lens import LensFit
from nlens_video.scene.camera import Camera
from nlens_video.scene.casters import Casters
from nlens_video.scene.illumination import Illumination
from nlens_video.scene.irradiance import from_around, from_lamp, reaches
from nlens_video.scene.solid import Solid
from nlens_video.stages.l_reblur import ReblurLayer, ScatterKernel
from nlens_video.stages.occlusion import Cover
from nlens_video.stages.shadow_cast import Stage

_RETURNED = 0.4  # of the light from around that a body hides, by its own bright surface
_MARGIN_LIMIT_PX = 256  # no kernel spreads farther
_BLACKEST = 0.999  # the most that is taken away: something always comes back from around


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Shadow:
    """The light that the object takes from the ground.

    Attributes:
        box: where the arrays lie in the frame; may reach beyond it.
        loss: share of the light that is gone (h, w, 3), 0 outside the shadow [1].
        coc_px: signed CoC diameter of the ground (h, w), 0 where the lens is not known [px].
    """

    box: Box
    loss: Float32
    coc_px: Float32


@dataclass(frozen=True, slots=True, kw_only=True)
class CastShadow:
    """Casts the shadow of triangles on the ground.

    Attributes:
        strength: 1 as the light has it, 0 none [1].
        lamp_points: points of each lamp that are followed.
        ambient_directions: directions of the light from around that are followed.
    """

    strength: float = 1.0
    lamp_points: int = 24
    ambient_directions: int = 64

    def __call__(
        self,
        casters: Casters,
        light: Illumination,
        camera: Camera,
        ground_y: float,
        fit: LensFit | None,
    ) -> Shadow | None:
        """Cast one moment's shadow.

        Args:
            casters: what throws it.
            light: what lights the ground.
            camera: that moment's camera.
            ground_y: height of the plane [scene unit].
            fit: the lens, None where it is not known.

        Returns:
            The loss around the shadow; None where it is out of view or there is none.
        """
        if camera.world_from_camera[1, 3] <= ground_y:
            return None
        margin = _margin(camera, ground_y, fit)
        stage = Stage(
            Solid.above(casters.vertices, casters.faces, ground_y),
            _cut(camera, _frame(camera).grown(margin)),
            ground_y,
            tuple(
                (Solid.above(veil.vertices, veil.faces, ground_y), veil.opacity)
                for veil in casters.veils
            ),
        )
        if stage.empty or self.strength <= 0.0:
            return None
        lamps = [lamp for lamp in light.lamps if reaches(lamp, ground_y)]
        hidden = [stage.hidden(lamp, self.lamp_points) for lamp in lamps]
        around = from_around(light, stage.base)
        if around.any():
            hidden.append((1.0 - _RETURNED) * stage.occlusion(self.ambient_directions))
        inner = _bounds(hidden, stage.camera.plane_disparity(ground_y) > 0.0)
        if inner.empty:
            return None
        box = Box(inner.x0 - margin, inner.y0 - margin, inner.x1 - margin, inner.y1 - margin)
        part = replace(stage, camera=_cut(camera, box))
        at = inner.slices_in(_frame(stage.camera))
        ground = part.ground
        lost, total = np.zeros(part.size), np.broadcast_to(around, part.size).copy()
        for lamp, share in zip(lamps, hidden, strict=False):
            given = from_lamp(lamp, ground)
            total += given
            lost += given * share[at][..., None]
        if around.any():
            lost += around * hidden[-1][at][..., None]
        gone = np.divide(lost, total, out=np.zeros(part.size), where=total > 0.0)
        disparity = part.camera.plane_disparity(ground_y).astype(np.float32)
        gone[disparity <= 0.0] = 0.0
        loss = np.minimum(gone * self.strength, _BLACKEST).astype(np.float32)
        coc = np.zeros_like(disparity) if fit is None else fit.coc_px(disparity)
        return Shadow(box=box, loss=loss, coc_px=coc)


def _behind(loss: Float32, plate: Float32, box: Box, cover: Cover) -> Float32:
    """Loss and its mean (h, w, 4) on a box, where only what lies behind the cover loses light."""
    common = box.intersection(cover.box)
    if common.empty:
        return loss
    light = np.zeros_like(plate)
    light[common.slices_in(box)] = cover.light[common.slices_in(cover.box)]
    share = np.ones_like(plate)
    np.divide(plate - light, plate, out=share, where=plate > 0.0)
    hidden = cover.coverage[common.slices_in(cover.box)] >= 1.0
    share[common.slices_in(box)][hidden] = 0.0
    behind = loss[..., :3] * np.clip(share, 0.0, 1.0)
    return np.concatenate([behind, behind.mean(axis=2, keepdims=True)], axis=2)


def _bounds(hidden: list[Float64], ground: Bool) -> Box:
    """The pixels of the ground (h, w) on which any map is not 0; empty if there are none."""
    seen = np.zeros_like(ground)
    for one in hidden:
        seen |= one > 0.0
    seen &= ground
    rows, columns = np.flatnonzero(seen.any(axis=1)), np.flatnonzero(seen.any(axis=0))
    if not rows.size:
        return Box(0, 0, 0, 0)
    return Box(int(columns[0]), int(rows[0]), int(columns[-1]) + 1, int(rows[-1]) + 1)


def _frame(camera: Camera) -> Box:
    """The whole frame."""
    return Box(0, 0, camera.width, camera.height)


def _cut(camera: Camera, box: Box) -> Camera:
    """The same view on a box of the frame, which may reach beyond it."""
    return replace(
        camera, cx=camera.cx - box.x0, cy=camera.cy - box.y0, width=box.width, height=box.height
    )


def _margin(camera: Camera, ground_y: float, fit: LensFit | None) -> int:
    """How far beyond the frame the ground blurs into it [px]."""
    if fit is None:
        return 0
    disparity = camera.plane_disparity(ground_y)
    coc = fit.coc_px(disparity[disparity > 0.0].astype(np.float32))
    return math.ceil(min(0.5 * float(np.abs(coc).max(initial=0.0)), _MARGIN_LIMIT_PX))


@dataclass(frozen=True, slots=True, kw_only=True)
class Darken:
    """Lays a shadow on the plate, blurred as the lens blurs the ground.

    Attributes:
        scatter: as of `ReblurLayer`.
        reach: as of `ReblurLayer`.
        pixel_aspect: width of a pixel by its height [1].
    """

    scatter: ScatterKernel
    reach: Callable[[Float32, Float32, float], int]
    pixel_aspect: float = 1.0

    def __call__(
        self, picture: Picture, shadow: Shadow, frame: Box, cover: Cover | None = None
    ) -> Picture:
        """Multiply the plate in place by what the shadow leaves; the picture itself comes back.

        Args:
            picture: the plate; changed where the blurred shadow reaches, and only there.
            shadow: the light that is gone.
            frame: the frame's own box.
            cover: what really stands before the ground.
        """
        return self.taken(picture, self.blurred(shadow, frame), cover)

    def taken(self, picture: Picture, blurred: BlurredLayer, cover: Cover | None) -> Picture:
        """Take a blurred shadow's light from the plate, in place; the picture itself comes back.

        Args:
            picture: the plate; changed where the shadow reaches, and only there.
            blurred: from `blurred`.
            cover: what really stands before the ground.
        """
        box, loss = blurred.box, blurred.rgba
        if not box.empty and loss.any():
            plate = picture.linear(box)
            if cover is not None:
                loss = _behind(loss, plate, box, cover)
            mean = loss[..., 3:]
            # Over has one alpha for all channels: what is coloured about the loss is added back.
            picture.over(box, np.concatenate([(mean - loss[..., :3]) * plate, mean], axis=2))
        return picture

    def blurred(self, shadow: Shadow, frame: Box) -> BlurredLayer:
        """Loss in each channel and its mean, as the lens shows them, on a box inside the frame."""
        mean = shadow.loss.mean(axis=2, keepdims=True)
        layer = ObjectLayer(
            box=shadow.box,
            rgba=np.concatenate([shadow.loss, mean], axis=2),
            depth=np.ones(mean.shape[:2], np.float32),
        )
        blur = ReblurLayer(scatter=self.scatter, reach=self.reach, pixel_aspect=self.pixel_aspect)
        return blur(DefocusedLayer(layer=layer, coc_px=shadow.coc_px), frame)
