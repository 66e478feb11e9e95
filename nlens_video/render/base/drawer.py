"""What draws the pictures for a renderer, and how it says that it cannot go on."""

from __future__ import annotations

from typing import Protocol

from nlens_video.core.layers import Float32
from nlens_video.render.base.box_renderer import ViewSetup
from nlens_video.render.base.peel_layer import BehindPicture, FrontSurfaces
from nlens_video.render.base.shader_inputs import Lighting
from nlens_video.scene.posed import PosedScene


class DrawerLostError(Exception):
    """What drew is gone with all that it held; the picture at hand was not drawn.

    Attributes:
        again: whether another of its kind may do better.
    """

    def __init__(self, reason: str, *, again: bool) -> None:
        super().__init__(reason)
        self.again = again


class Drawer(Protocol):
    """Draws one object, moment by moment."""

    def draw(
        self, posed: PosedScene, sight: ViewSetup, lighting: Lighting
    ) -> tuple[Float32, Float32]:
        """Premultiplied linear RGBA (h, w, 4) and depth (h, w), +inf where nothing is.

        Raises:
            NlensError: the object or the picture is too large to be drawn.
            DrawerLostError: the picture must be drawn by another.
        """
        ...

    def draw_behind(
        self, posed: PosedScene, sight: ViewSetup, lighting: Lighting, front: FrontSurfaces
    ) -> BehindPicture | None:
        """What lies behind a part of the picture that `draw` has drawn last; None for nothing.

        Raises:
            As `draw`.
        """
        ...

    def close(self) -> None:
        """Free what it holds, if it is still there."""
        ...
