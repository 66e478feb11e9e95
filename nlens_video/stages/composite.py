"""The last step: the blurred object over the plate, in the plate's own samples."""

from __future__ import annotations

from nlens_video.frames import BlurredLayer, Picture


def composite(picture: Picture, blurred: BlurredLayer) -> Picture:
    """Lay the object over the plate in place, in scene-linear light; the picture itself comes back.

    Samples that the object does not reach keep their exact values.

    Args:
        picture: the plate; changed.
        blurred: the object as the lens sees it.
    """
    if not blurred.box.empty:
        picture.over(blurred.box, blurred.rgba)
    return picture
