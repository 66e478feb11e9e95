"""What the stages ask of their tools; the backends fulfil it, tests do so in three lines."""

from __future__ import annotations

from typing import Protocol

from nlens_video.frames import BlurredLayer, CocMap, DefocusedLayer, Float32


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
    """A network that repairs what scatter cannot know: order inside the object."""

    def __call__(self, defocused: DefocusedLayer, blurred: BlurredLayer) -> BlurredLayer:
        """Repair one frame.

        Args:
            defocused: the sharp object and its CoC.
            blurred: what the scatter made of it.

        Returns:
            The repaired layer on the box of `blurred`.
        """
        ...
