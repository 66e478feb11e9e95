"""What tells where real things hide the object: mattes, depth, blur, or what moves."""

from __future__ import annotations

from collections.abc import Callable

from msgspec import Struct

from nlens_video.core.layers import Box, CocMap, DepthMap, Float32, Float64, Matte, Picture
from nlens_video.core.lens_fit import LensFit


class MovingMatte(Struct, frozen=True, kw_only=True, eq=False):
    """What moves on a region of a frame.

    Attributes:
        box: the region; inside the frame.
        coverage: share of each pixel (h, w) that it covers [1].
        before: share of that (h, w) that is nearer than the object [1].
        background: scene-linear light (h, w, 3) of what it hides.
    """

    box: Box
    coverage: Float32
    before: Float32
    background: Float32


class SeenBackground(Struct, frozen=True, kw_only=True, eq=False):
    """The background of a shot around its object, as a frame sees it.

    Attributes:
        box: the region; inside the frame.
        light: scene-linear light (h, w, 3) without what moves and its shadow, NaN where it is not
            known or hidden.
    """

    box: Box
    light: Float32


class MovingThings(Struct, frozen=True, eq=False):
    """What moves on a frame.

    Attributes:
        matte: of a region of the frame, through a lens; None where nothing moves there.
        feet: column and row of the frame where each thing stands (N, 2) [px].
        background: of a frame, where nothing but shadows moves.
    """

    matte: Callable[[Picture, Box, LensFit | None], MovingMatte | None]
    feet: Float64
    background: Callable[[Picture], SeenBackground]


OcclusionCue = Matte | DepthMap | CocMap | MovingThings
"""Source of foreground occlusion."""
