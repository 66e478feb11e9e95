"""FFmpeg's side data of frames, such as their display matrix and HDR metadata."""

from __future__ import annotations

from collections.abc import Mapping
from typing import cast

import av
import av.filter
from av.sidedata.sidedata import Type

_UNNAMED = (28, 29, 30, 31)
"""Kinds for which PyAV has no name: LCEVC, number of a view, reference displays, EXIF."""


def side_data(frame: av.VideoFrame) -> Mapping[Type, bytes]:
    """The side data of a frame, as buffers, but for kinds that PyAV cannot name."""
    try:
        return cast("Mapping[Type, bytes]", frame.side_data)
    except ValueError:  # one such kind hides all others
        return cast("Mapping[Type, bytes]", _named(frame).side_data)


def _named(frame: av.VideoFrame) -> av.VideoFrame:
    """The same samples without the side data that PyAV cannot name."""
    graph = av.filter.Graph()
    source = graph.add_buffer(
        width=frame.width, height=frame.height, format=frame.format, time_base=frame.time_base
    )
    deleted = [graph.add("sidedata", f"mode=delete:type={kind}") for kind in _UNNAMED]
    graph.link_nodes(source, *deleted, graph.add("buffersink")).configure()
    graph.push(frame)
    return cast("av.VideoFrame", graph.pull())
