"""Search for the moving foreground, once for all runs that render parts of a shot."""

from __future__ import annotations

from pathlib import Path

from nlens_video.core.settings import Settings
from nlens_video.effects.planner import OCCLUSION, EffectRequest
from nlens_video.graph.base.objects_on_ground import load_scene, stage
from nlens_video.graph.builder import shadow_scene
from nlens_video.graph.foreground_file import write_foreground
from nlens_video.graph.moving_foreground import find_moving_foreground
from nlens_video.graph.pipeline_file import load_pipeline
from nlens_video.run.open_run import read_again, view_of
from nlens_video.run.plate_source import opened
from nlens_video.video.atomic_files import replacing


def foreground_pass(settings: Settings, path: Path) -> bool:
    """Find what moves in front of the object, and write it to a file.

    Args:
        settings: of the run; the whole shot is searched, whatever its range.
        path: the file, for `RealSettings.found`.

    Returns:
        Whether the search was made. It is not where a holdout is given, where the run simulates no
        occlusion, and where the plate is no video or sequence.

    Raises:
        NlensError: as `run.render`.
    """
    real = settings.scene.real
    if real.holdout is not None or real.occlusion == "none":
        return False
    if OCCLUSION not in EffectRequest.parse(settings.effects).possible:
        return False
    if OCCLUSION not in load_pipeline(settings.preset).effects:
        return False
    with opened(settings.source) as source:
        info = source.info
    again = read_again(settings.source, info)
    if again is None:
        return False
    objects = settings.scene
    staged = stage(objects, load_scene(objects), view_of(settings, info))
    light = shadow_scene(objects, staged.scene).light
    found, finding = find_moving_foreground(
        again, staged.scene, staged.view, staged.objects.ground_y, None, light
    )
    with replacing(path) as partial:
        write_foreground(partial, found, finding)
    return True
