"""Text subtitles that the target container does not hold are encoded anew."""

from __future__ import annotations

import av
import av.container
from av.stream import Stream
from av.subtitles.codeccontext import SubtitleCodecContext
from av.subtitles.stream import SubtitleStream

from nlens_video.video.info import Packet
from nlens_video.video.output.muxers import MP4_FAMILY

_CODECS = {"matroska": "subrip", "webm": "webvtt", **dict.fromkeys(MP4_FAMILY, "mov_text")}


class SubtitleEncoder:
    """One stream of text subtitles, decoded and encoded into another codec.

    Attributes:
        codec: FFmpeg's name of the encoder.

    Raises:
        ValueError: they are pictures, or the container holds no text.
    """

    def __init__(self, container: av.container.OutputContainer, source: Stream) -> None:
        context, name = source.codec_context, container.format.name
        if not isinstance(context, SubtitleCodecContext) or not context.codec.text_sub:
            raise ValueError(f"{name} does not hold its codec")
        if name not in _CODECS:
            raise ValueError(f"{name} holds no text")
        self.codec = _CODECS[name]
        self._decoder = context
        context.open(strict=False)
        added = container.add_stream(self.codec)
        if not isinstance(added, SubtitleStream):
            raise ValueError(f"{self.codec} is no encoder of subtitles")
        self._stream = added
        self._stream.codec_context.subtitle_header = context.subtitle_header
        self._stream.time_base = source.time_base
        self._stream.metadata.update(source.metadata)
        self._stream.disposition = source.disposition

    def encode(self, packet: Packet) -> list[Packet]:
        """The same text in a packet of the target's codec; none where it holds no text."""
        subtitle = self._decoder.decode2(packet) if packet.size else None
        if subtitle is None or not len(subtitle):
            return []
        encoded = self._stream.codec_context.encode_subtitle(subtitle)
        encoded.pts, encoded.dts, encoded.duration = packet.pts, packet.dts, packet.duration
        encoded.time_base, encoded.stream = packet.time_base, self._stream
        return [encoded]
