"""Protocols of the networks and renderers that stages call."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Protocol

from nlens_video.core.layers import (
    BehindLayer,
    BlurredLayer,
    Box,
    CocMap,
    DefocusedLayer,
    Float32,
    ObjectLayer,
)
from nlens_video.scene.camera import Camera
from nlens_video.scene.illumination import Illumination


class CocNetwork(Protocol):
    """A network that reads the blur off a picture."""

    @property
    def stride(self) -> int:
        """Height and width of its input must be multiples of this [px]."""
        ...

    def __call__(self, rgb: Float32) -> CocMap:
        """Estimate one picture.

        Args:
            rgb: display-coded sRGB in [0, 1] (H, W, 3), H and W multiples of `stride`.

        Returns:
            Maps (h, w) that cover the same picture, perhaps coarser; diameters in px of the input.
        """
        ...


class ReblurNetwork(Protocol):
    """Repairs the depth order inside the object, which the scatter ignores."""

    def __call__(self, defocused: DefocusedLayer, blurred: BlurredLayer) -> BlurredLayer:
        """Repair one frame.

        Args:
            defocused: the sharp object and its CoC.
            blurred: what the scatter made of it.

        Returns:
            The repaired layer on the box of `blurred`.
        """
        ...


class ViewRenderer(Protocol):
    """Renders the object from any pinhole camera."""

    def render(
        self,
        time_s: float,
        camera: Camera,
        margin: int = 0,
        *,
        nearest: bool = False,
        plate_light: Illumination | None = None,
    ) -> ObjectLayer | None:
        """Draw it once.

        Args:
            time_s: moment of the animation [s].
            camera: any pinhole camera; moved and with a shifted principal point it is a point of
                the lens' aperture.
            margin: how far beyond the frame the object is still drawn [px].
            nearest: whether depth may be that of a pixel's nearest sample, which is quicker.
            plate_light: lights the object where its file does not; None for a plausible light.

        Returns:
            The sharp layer; None where the object is out of view.
        """
        ...

    def render_views(
        self,
        time_s: float,
        cameras: Sequence[Camera],
        margin: int,
        use: Callable[[int, ObjectLayer | None], None],
        *,
        nearest: bool = False,
        plate_light: Illumination | None = None,
    ) -> None:
        """Draw it from several points, and wait until all are used.

        Args:
            time_s: moment of the animation [s].
            cameras: as for `render`.
            margin: likewise.
            use: gets each camera's number and layer; they are begun in order, but on several
                threads perhaps, and what it does to one must not wait for a later one.
            nearest: as for `render`.
            plate_light: likewise.
        """
        ...


class BehindRenderer(Protocol):
    """Renders surfaces that the object hides of itself (depth peeling)."""

    def render_behind(
        self, front: ObjectLayer, region: Box, disparity_step: float
    ) -> BehindLayer | None:
        """Draw it once.

        Args:
            front: a picture that the same renderer has drawn.
            region: where to look, a part of its box.
            disparity_step: how much less disparity than the nearest surface what it hides has
                at least, > 0 [1 / scene unit].

        Returns:
            The layer on the region; None where nothing is hidden.
        """
        ...
