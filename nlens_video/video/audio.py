"""Audio that the target container does not hold is encoded anew."""

from __future__ import annotations

import av
import av.container
from av.audio.codeccontext import AudioCodecContext
from av.audio.fifo import AudioFifo
from av.audio.resampler import AudioResampler
from av.audio.stream import AudioStream
from av.stream import Stream

from nlens_video.video.info import Packet

_PREFERRED = ("aac", "libopus", "pcm_s16le")


class AudioEncoder:
    """One audio stream, decoded and encoded into another codec.

    Attributes:
        codec: FFmpeg's name of the encoder.
    """

    def __init__(self, container: av.container.OutputContainer, source: Stream) -> None:
        context = source.codec_context
        if not isinstance(context, AudioCodecContext):
            raise ValueError(f"{source.type} is no audio")
        supported = container.supported_codecs
        named = [name for name in _PREFERRED if name in supported]
        self.codec = named[0] if named else container.default_audio_codec
        rate = 48000 if self.codec == "libopus" else context.sample_rate
        added = container.add_stream(self.codec, rate)
        if not isinstance(added, AudioStream):
            raise ValueError(f"{self.codec} is no audio encoder")
        self._stream = added
        self._stream.codec_context.layout = context.layout
        formats = self._stream.codec_context.codec.audio_formats or (context.format,)
        self._stream.codec_context.format = formats[0]
        self._resampler = AudioResampler(formats[0].name, context.layout, rate)
        self._fifo = AudioFifo()
        self._decoder = context

    def encode(self, packet: Packet | None) -> list[av.Packet[AudioStream]]:
        """What comes out for one packet in; None flushes."""
        frames = []
        if packet is not None:
            try:
                frames = self._decoder.decode(packet)
            except av.InvalidDataError:
                return []
        for frame in (*frames, *((None,) if packet is None else ())):
            for part in self._resampler.resample(frame):
                self._fifo.write(part)
        return self._drain(last=packet is None)

    def _drain(self, *, last: bool) -> list[av.Packet[AudioStream]]:
        packets: list[av.Packet[AudioStream]] = []
        size = self._stream.codec_context.frame_size or 1024
        while (frame := self._fifo.read(size)) is not None:
            packets += self._stream.encode(frame)
        if last:
            if (rest := self._fifo.read(0, partial=True)) is not None:
                packets += self._stream.encode(rest)
            packets += self._stream.encode(None)
        return packets
