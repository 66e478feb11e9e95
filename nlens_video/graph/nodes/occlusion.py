"""The stages of the plate's own things, as a pipeline file names them: occlusion, reflection."""

from __future__ import annotations

import math
from functools import partial
from typing import TYPE_CHECKING

import numpy as np

from nlens_video.core.layers import (  # fmt: skip
    BlurredLayer,
    Box,
    CocMap,
    DefocusedLayer,
    DepthMap,
    Float32,
    Front,
    Matte,
    ObjectLayer,
    Picture,
)
from nlens_video.core.lens_fit import LensFit
from nlens_video.effects.motion_blur import Motion, averaged, sampled_count
from nlens_video.effects.occlusion import cover_of
from nlens_video.effects.occlusion_estimate import CoverByCoc, CoverByDepth, object_disparity
from nlens_video.effects.reflection import LayReflection, MirrorObject
from nlens_video.effects.shadow.apply import Shadow
from nlens_video.graph.nodes.context import Made, Tools, Unavailable
from nlens_video.graph.nodes.object_source import Placement
from nlens_video.graph.nodes.through_lens import through_lens
from nlens_video.stages.composite import Foreground
from nlens_video.stages.l_reblur import object_coc

if TYPE_CHECKING:
    from nlens_video.graph.nodes.stream_frame import StreamFrame

_SOFTENED_PX = 16  # what later stages may spread the object by [px]
_SPREAD_PX = 16  # beyond half a CoC: what discs on coarser pixels take more [px]


def make_matte(tools: Tools) -> Made:
    """What is known of things in front."""
    front = tools.front
    if front is None:
        raise Unavailable("nothing tells what stands in front")

    def run(
        frame: StreamFrame, picture: Picture, placement: Placement, plate_coc: CocMap | None
    ) -> Front:
        return front.read(frame.index, picture, plate_coc)

    return Made(run, front.description)


def make_hold_out(tools: Tools) -> Made:
    """What of them hides the object and what it does to the ground."""
    from nlens_video.kernels.scatter.scatter import scatter

    if tools.front is None:
        raise Unavailable("nothing tells what stands in front")
    by_depth = CoverByDepth(
        scatter=partial(scatter, aperture=tools.aperture), pixel_aspect=tools.pixel_aspect
    )
    by_coc = CoverByCoc()

    def covering(
        front: DepthMap | CocMap, disparity: Float32, region: Box, fit: LensFit | None,
        picture: Picture,
    ) -> Float32:  # fmt: skip
        if isinstance(front, DepthMap):
            return by_depth(front, disparity, region, fit)
        if fit is None:
            return np.zeros(disparity.shape, np.float32)
        return by_coc(front, disparity, region, fit, picture.srgb())

    def run(
        front: Front, picture: Picture, placement: Placement, frame_box: Box, fit: LensFit | None,
        layer: ObjectLayer | None, blurred: BlurredLayer | None, shadow: Shadow | None,
        reflection: DefocusedLayer | None,
    ) -> Foreground | None:  # fmt: skip
        object_region = Box(0, 0, 0, 0)
        if blurred is not None and not blurred.box.empty:
            object_region = blurred.box.grown(_SOFTENED_PX).intersection(frame_box)
        ground_region = _on_ground(shadow, reflection, frame_box)
        if isinstance(front, Matte):
            region = object_region.joined(ground_region)
            cover = cover_of(picture, region, front.coverage)
            return None if cover is None else Foreground(before_object=cover, before_ground=cover)
        over_object = over_ground = None
        if layer is not None and not object_region.empty:
            surface = object_disparity(layer, frame_box)
            share = covering(front, surface, object_region, fit, picture)
            over_object = cover_of(picture, object_region, share)
        if not ground_region.empty:
            surface = placement.camera.plane_disparity(tools.ground_height()).astype(np.float32)
            share = covering(front, surface, ground_region, fit, picture)
            over_ground = cover_of(picture, ground_region, share)
        return Foreground(before_object=over_object, before_ground=over_ground)

    return Made(run, "hidden behind it, its light told apart from the background's in soft edges")


def make_reflect(tools: Tools, *, most_moments: int = 9) -> Made:
    """The object's mirror image in the ground, blurred by its motion where that shows."""
    if tools.views is None:
        raise Unavailable("pre-rendered layers do not show the object from below")
    draw = MirrorObject(renderer=tools.views, reflectance=tools.reflectance)

    def run(
        placement: Placement, fit: LensFit | None, motion: Motion | None
    ) -> DefocusedLayer | None:
        # The virtual image lies farther off than the object: up to infinity, to be on the safe side
        ends = np.array([1.0 / placement.nearest, 0.0], np.float32)
        reach = 0.0 if fit is None else 0.5 * float(np.abs(fit.coc_px(ends)).max())
        reach *= max(1.0, tools.pixel_aspect)
        height = tools.ground_height()

        def drawn(time_s: float) -> ObjectLayer | None:
            own = time_s == placement.time_s
            camera = placement.camera if own else tools.objects.camera(time_s)
            return draw(time_s, camera, height, reach)

        count = 1 if motion is None else _mirrored_moments(tools, placement.time_s, fit)
        times = tools.shutter.middles(placement.time_s, min(count, most_moments))
        layer = averaged(drawn(time_s) for time_s in times)
        if layer is None:
            return None
        if fit is None:
            return DefocusedLayer(layer=layer, coc_px=np.zeros(layer.depth.shape, np.float32))
        return object_coc(layer, fit)

    return Made(
        run,
        f"the mirrored camera's picture, {tools.reflectance:g} from straight above, at several "
        "moments where it moves by a pixel while the shutter is open",
    )


def _mirrored_moments(tools: Tools, time_s: float, fit: LensFit | None) -> int:
    """How many moments the mirror image's motion takes."""
    if tools.ground is None:
        return 1
    height, places, depths = tools.ground_height(), [], []
    for moment in tools.shutter.edges(time_s):
        vertices = tools.ground.pose(moment).vertices().astype(np.float64)
        vertices[:, 1] = 2.0 * height - vertices[:, 1]
        camera = tools.objects.camera(moment)
        seen = camera.to_camera(vertices)
        if not (seen[:, 2] < 0.0).all():
            return 1
        places.append(camera.pixels(seen))
        depths.append(-seen[:, 2])
    coc = 0.0 if fit is None else np.abs(fit.coc_px((1.0 / depths[1]).astype(np.float32)))
    return sampled_count(places, np.asarray(coc, dtype=np.float64))


def make_lay_reflection(tools: Tools) -> Made:
    """The mirror image on the plate."""
    stage = LayReflection(through_lens(tools))

    def run(
        picture: Picture, reflection: DefocusedLayer, frame_box: Box, foreground: Foreground | None
    ) -> Picture:
        cover = None if foreground is None else foreground.before_ground
        return stage(picture, reflection, frame_box, cover)

    return Made(run, "over the ground and under the object, blurred by its own depth")


def _on_ground(shadow: Shadow | None, reflection: DefocusedLayer | None, frame: Box) -> Box:
    """The pixels of the frame that shadow and reflection reach."""
    found = Box(0, 0, 0, 0)
    for box, coc in (
        (shadow.box, shadow.coc_px) if shadow is not None else (found, None),
        (reflection.layer.box, reflection.coc_px) if reflection is not None else (found, None),
    ):
        if coc is not None:
            reach = math.ceil(0.5 * float(np.abs(coc).max(initial=0.0))) + _SPREAD_PX
            found = found.joined(box.grown(reach).intersection(frame))
    return found
