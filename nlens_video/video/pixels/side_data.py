"""FFmpeg's side data of frames, such as their display matrix and HDR metadata."""

from __future__ import annotations

from collections.abc import Mapping
from fractions import Fraction
from typing import cast

import av
import av.filter
from av.sidedata.sidedata import Type

_READ = (
    Type.DISPLAYMATRIX, Type.MASTERING_DISPLAY_METADATA, Type.CONTENT_LIGHT_LEVEL,
    Type.DYNAMIC_HDR_PLUS, Type.DYNAMIC_HDR_VIVID, Type.DOVI_METADATA, Type.DOVI_RPU_BUFFER,
)  # fmt: skip
_KINDS = 40
"""More than FFmpeg has kinds of side data (32 in version 8); it takes numbers of none."""


def side_data(frame: av.VideoFrame) -> Mapping[Type, bytes]:
    """The side data of a frame that is read here, as buffers.

    The others are deleted before PyAV looks at them: of kinds that it cannot name one hides all,
    and of kinds with a dictionary, as the profile of a PNG with its name, it frees that twice.
    """
    graph = av.filter.Graph()
    graph.threads = 1
    source = graph.add_buffer(
        width=frame.width, height=frame.height, format=frame.format,
        time_base=frame.time_base or Fraction(1, 1000),  # frames that no decoder has made have none
    )  # fmt: skip
    others = set(range(_KINDS)).difference(kind.value for kind in _READ)
    deleted = [graph.add("sidedata", f"mode=delete:type={kind}") for kind in sorted(others)]
    graph.link_nodes(source, *deleted, graph.add("buffersink")).configure()
    graph.push(frame)
    return cast("Mapping[Type, bytes]", cast("av.VideoFrame", graph.pull()).side_data)
