"""Sources of foreground occlusion: a matte or depth file, or the plate's CoC."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING

from nlens_video.core.layers import CocMap, OcclusionCue, Picture
from nlens_video.core.settings import RealSettings
from nlens_video.graph.base.context import OcclusionSource

if TYPE_CHECKING:
    from nlens_video.video.input.holdout import HoldoutReader

Estimator = Callable[[Picture, Sequence[Picture]], CocMap]


@dataclass(frozen=True, slots=True)
class OcclusionFile:
    """A matte or a depth map, read from files."""

    reader: HoldoutReader

    @property
    def description(self) -> str:
        """The source in one phrase."""
        return self.reader.description

    def read(self, index: int, picture: Picture, plate_coc: CocMap | None) -> OcclusionCue:
        """The matte or the depth of a frame."""
        return self.reader.read(index)


@dataclass(frozen=True, slots=True)
class OcclusionFromCoc:
    """The plate's CoC, estimated on every frame, since the foreground may move."""

    load: Callable[[], Estimator]

    @property
    def description(self) -> str:
        """The source in one phrase."""
        return "F: CoC network on each frame, onnxruntime on the CPU"

    def read(self, index: int, picture: Picture, plate_coc: CocMap | None) -> OcclusionCue:
        """CoC map of this frame alone; that of the lens fit may be of a mean of several."""
        if plate_coc is not None and plate_coc.frames == 1:
            return plate_coc
        return self.load()(picture, ())


def open_occlusion_source(
    real: RealSettings, size: tuple[int, int], load: Callable[[], Estimator], *, asked_for: bool
) -> OcclusionSource | None:
    """Open the source that the options call for.

    Args:
        real: the options on occlusion.
        size: width and height of the plate [px].
        load: loads F.
        asked_for: whether the effect is requested by name: the plate's CoC is the last resort.

    Raises:
        InputError: the holdout cannot be read.
    """
    if real.holdout is not None:
        from nlens_video.video.input.holdout import open_holdout

        return OcclusionFile(open_holdout(real.holdout, size))
    return OcclusionFromCoc(load) if real.occlusion == "auto" or asked_for else None


@contextmanager
def closing_source(front: OcclusionSource | None) -> Iterator[None]:
    """Close a front's file in the end."""
    try:
        yield
    finally:
        if isinstance(front, OcclusionFile):
            front.reader.close()
