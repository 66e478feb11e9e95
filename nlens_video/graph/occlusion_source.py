"""Where the occlusion of the object comes from: a file, what moves in the shot, or its blur."""

from __future__ import annotations

from collections.abc import Callable

from msgspec.structs import replace

from nlens_video.core.layers import CocMap, Picture
from nlens_video.core.settings import ObjectSettings
from nlens_video.effects.finding import Finding
from nlens_video.effects.foreground.survey import StaticCameraSurvey
from nlens_video.effects.occlusion_cues import OcclusionCue
from nlens_video.graph.base.context import CocEstimator, OcclusionSource, ReadAgain
from nlens_video.graph.base.objects_on_ground import is_placed
from nlens_video.graph.base.view import View
from nlens_video.graph.foreground_file import read_foreground
from nlens_video.graph.moving_foreground import find_moving_foreground
from nlens_video.scene.scene import Scene
from nlens_video.scene.scene_light import SceneLight
from nlens_video.video.info import SourceFrame

_UNITLESS = (
    "--holdout {}: the plate's scale is not known, so Z is taken in units of the object's file; "
    "for Z in metres give the camera in metres (nlens-video solve --marker SIDE, --person-height)"
)


def open_occlusion_source(
    objects: ObjectSettings, scene: Scene, view: View, estimate: CocEstimator,
    again: ReadAgain | None, seen: Callable[[], StaticCameraSurvey | None], light: SceneLight, *,
    asked_for: bool,
) -> tuple[OcclusionSource | None, Finding | None]:  # fmt: skip
    """The matte or depth file, what moves in the shot, or the plate's CoC.

    Args:
        objects: the object and the options on occlusion.
        scene: the object.
        view: how the plate's frames see it.
        estimate: F.
        again: reads the shot, None where it can be read only once or occlusion is not wanted.
        seen: waits for the shot as it was looked at before, see `find_moving_foreground`.
        light: what may tell a sun, see there.
        asked_for: whether the effect is requested by name: the plate's CoC is the last resort.

    Returns:
        The source, None where no option and nothing in the shot calls for one; and what was found.

    Raises:
        InputError: the holdout, or what was found before, cannot be read.
    """
    real = objects.real
    if real.holdout is not None:
        source = _open_holdout(real.holdout, objects, scene, view)
        return source, Finding(f"--holdout {source.description}", wanted=True)
    finding = Finding("--occlusion none") if real.occlusion == "none" else None
    if real.occlusion != "none" and again is not None:
        if real.found is not None:
            moving, finding = read_foreground(real.found)
        else:
            moving, finding = find_moving_foreground(
                again, scene, view, objects.ground_y, seen(), light
            )
        if moving is not None and finding.wanted:
            return OcclusionSource(
                "what moves before the shot's background",
                lambda frame, picture, plate_coc: moving.on_frame(frame.index),
            ), finding
    if real.occlusion != "auto" and not asked_for:
        return None, finding

    def coc_of_frame(
        frame: SourceFrame, picture: Picture, plate_coc: CocMap | None
    ) -> OcclusionCue:
        """CoC map of this frame alone, since the foreground may move."""
        if plate_coc is not None and plate_coc.frames == 1:
            return plate_coc
        return estimate(picture, ())

    source = OcclusionSource("F: CoC network on each frame, onnxruntime", coc_of_frame)
    reason = "--occlusion auto: where the plate's CoC is certainly of nearer things"
    return source, Finding(reason, wanted=True) if real.occlusion == "auto" else finding


def _open_holdout(spec: str, objects: ObjectSettings, scene: Scene, view: View) -> OcclusionSource:
    """The matte or depth of a file, by the plate's own frame numbers."""
    from nlens_video.video.input.holdout import ExrHoldout, open_holdout

    reader = open_holdout(spec, (view.width, view.height), view.unit_m or 1.0)
    source = OcclusionSource(
        reader.description,
        lambda frame, picture, plate_coc: reader.read(frame.number),
        reader.close,
        notes=reader.notes,
    )
    if not (isinstance(reader, ExrHoldout) and reader.holds_depth):
        return source
    depth = reader.depth
    unitless = view.unit_m is None and is_placed(objects, scene)
    told = (_UNITLESS.format(spec),) if unitless else ()
    return replace(source, depth=lambda frame: depth(frame.number), notes=lambda: told)
