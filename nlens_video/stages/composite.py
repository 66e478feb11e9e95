"""The last step: the blurred object over the plate, in the plate's own samples."""

from __future__ import annotations

from nlens_video.frames import BlurredLayer, Picture
from nlens_video.stages.occlusion import Foreground, lay


def composite(
    picture: Picture, blurred: BlurredLayer, foreground: Foreground | None = None
) -> Picture:
    """Lay the object over the plate in place, in scene-linear light; the picture itself comes back.

    Samples that the object does not reach keep their exact values.

    Args:
        picture: the plate; changed.
        blurred: the object as the lens sees it.
        foreground: what really stands before it.
    """
    if not blurred.box.empty:
        cover = None if foreground is None else foreground.before_object
        lay(picture, blurred.box, blurred.rgba, cover)
    return picture
