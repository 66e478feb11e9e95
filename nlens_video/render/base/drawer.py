"""Drawing back end of a renderer, and the error by which it reports its loss."""

from __future__ import annotations

from typing import Protocol

from nlens_video.core.layers import Float32
from nlens_video.render.base.box_renderer import ViewSetup
from nlens_video.render.base.peel_layer import BehindPicture, FrontSurfaces
from nlens_video.render.base.shader_inputs import Lighting
from nlens_video.scene.posed import PosedScene


class DrawerLostError(Exception):
    """The back end and its resources are lost; the current picture was not drawn.

    Attributes:
        again: whether a new back end of the same kind may succeed.
    """

    def __init__(self, reason: str, *, again: bool) -> None:
        super().__init__(reason)
        self.again = again


class Drawer(Protocol):
    """Draws one object, moment by moment."""

    def draw(
        self, posed: PosedScene, setup: ViewSetup, lighting: Lighting
    ) -> tuple[Float32, Float32]:
        """Premultiplied linear RGBA (h, w, 4) and depth (h, w), +inf where nothing is.

        Raises:
            NlensError: the object or the picture is too large to be drawn.
            DrawerLostError: the picture must be drawn by another back end.
        """
        ...

    def draw_behind(
        self, posed: PosedScene, setup: ViewSetup, lighting: Lighting, front: FrontSurfaces
    ) -> BehindPicture | None:
        """What lies behind a part of the picture that `draw` has drawn last; None for nothing.

        Raises:
            As `draw`.
        """
        ...

    def close(self) -> None:
        """Free its resources, if they still exist."""
        ...
