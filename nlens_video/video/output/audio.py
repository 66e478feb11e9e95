"""Audio and text subtitles that the target container does not hold, encoded anew."""

from __future__ import annotations

import contextlib
from fractions import Fraction
from itertools import chain, product
from math import ceil

import av
import av.container
from av.audio.codeccontext import AudioCodecContext
from av.audio.fifo import AudioFifo
from av.audio.resampler import AudioResampler
from av.audio.stream import AudioStream
from av.stream import Stream
from av.subtitles.codeccontext import SubtitleCodecContext
from av.subtitles.stream import SubtitleStream

from nlens_video.video.info import Packet
from nlens_video.video.output.containers import MP4_FAMILY, holds_audio
from nlens_video.video.output.recent_codecs import is_recent

_PREFERRED = ("aac", "libopus")
_SURROUND = ("ac3",)  # preferred to MPEG layer 2, which has two channels
_LOSSLESS = ("flac", "alac", "wavpack", "tta", "mlp", "truehd")
_LOSSLESS_IN = ("mov", "mp4", "ipod", "matroska", "ogv", "ogg")
"""Containers in which players take ALAC or FLAC."""
_AAC_BIT_RATE = 80_000  # of a channel [bit/s]
_TOLERANCE_S = 0.02
"""Jitter of time stamps in milliseconds and encoder delays; lip sync errors show from 40 ms."""
_LONGEST_GAP_S = 3600
_USUAL_LAYOUTS = {1: "mono", 2: "stereo", 3: "2.1", 4: "quad", 5: "5.0", 6: "5.1", 8: "7.1"}
_SAME_COUNT = {4: "quad", 5: "5.0", 6: "5.1", 7: "6.1", 8: "7.1"}
"""Layouts that encoders take which refuse others of as many channels, such as 5.1(side)."""
_TEXT_CODECS = {"matroska": "subrip", "webm": "webvtt", **dict.fromkeys(MP4_FAMILY, "mov_text")}
"""Subtitle encoder by container."""


class AudioEncoder:
    """Transcoder of one audio stream.

    Samples are counted from the first time stamp on. Gaps in the source's times, those of damaged
    packets too, are filled with silence, and samples that overlap earlier ones are dropped, so
    that sound and pictures stay in sync.

    Args:
        container: the result.
        source: the stream.
        from_zero: whether it is to begin at 0, with silence or without what comes earlier.

    Attributes:
        codec: FFmpeg's name of the encoder.
        fewer: what is said where channels are mixed into fewer ones, else empty.
        exact: whether the samples stay as they are: PCM that becomes the same PCM.
        damaged: packets so far that could not be decoded [1].
        changed: what is said where channels or rate have changed so far, else empty.

    Raises:
        ValueError: there is no decoder for it, or no encoder that accepts its format.
    """

    def __init__(
        self, container: av.container.OutputContainer, source: Stream, *, from_zero: bool = False
    ) -> None:
        self.damaged, self.changed = 0, ""
        context = source.codec_context
        if not isinstance(context, AudioCodecContext):
            raise ValueError("nothing decodes it")
        self.codec, rate, layout = _chosen(container, context)
        had, has = context.layout.nb_channels, av.AudioLayout(layout).nb_channels
        self.fewer = f"{had} channels become {has}" if has < had else ""
        same = (self.codec, rate, has) == (context.codec.name, context.sample_rate, had)
        self.exact = same and self.codec.startswith("pcm_")
        added = container.add_stream(self.codec, rate)
        assert isinstance(added, AudioStream)
        self._stream = added
        self._stream.codec_context.layout = layout
        if self.codec == "aac":
            added.codec_context.bit_rate = _AAC_BIT_RATE * has
        if self.codec == "libopus" and has > 2:  # by default FFmpeg swaps those of 5.0 and 6.1
            added.codec_context.options = {"mapping_family": "1"}
        self._stream.metadata.update(source.metadata)
        self._stream.disposition = source.disposition
        formats = self._stream.codec_context.codec.audio_formats or (context.format,)
        self._stream.codec_context.format = formats[0]
        self._resampler = AudioResampler(formats[0].name, layout, rate)
        self._last: av.AudioFrame | None = None  # of the source
        self._rate = rate
        self._fifo = AudioFifo()
        self._start: int | None = 0 if from_zero else None
        self._counted = self._taken = 0
        self._decoder = context

    @property
    def end_s(self) -> Fraction:
        """Where the sound so far ends [s]."""
        return Fraction((self._start or 0) + self._counted, self._rate)

    def encode(self, packet: Packet) -> list[av.Packet[AudioStream]]:
        """Packets of the target's codec for one of the source's."""
        try:
            frames = self._decoder.decode(packet)
        except av.FFmpegError:
            self.damaged += 1
            return []
        packets: list[av.Packet[AudioStream]] = []
        for part in chain.from_iterable(map(self._resampled, frames)):
            packets += self._place(part)
        return packets + self._drain(last=False)

    def finish(self, until_s: Fraction) -> list[av.Packet[AudioStream]]:
        """The last packets, after silence where the sound ends before a time [s]."""
        packets: list[av.Packet[AudioStream]] = []
        for part in self._resampler.resample(None):
            packets += self._place(part)
        return packets + self.fill(until_s) + self._drain(last=True)

    def fill(self, until_s: Fraction) -> list[av.Packet[AudioStream]]:
        """Packets of silence where the sound so far ends before a time [s]."""
        return self._silence(ceil((until_s - self.end_s) * self._rate))

    def _resampled(self, frame: av.AudioFrame) -> list[av.AudioFrame]:
        """Samples in the target's format; a resampler takes those of one format only."""
        last, self._last, old = self._last, frame, self._resampler
        if last is None or (last.format.name, _heard(last)) == (frame.format.name, _heard(frame)):
            return old.resample(frame)
        if not self.changed and _heard(last) != _heard(frame):
            told = f"changes from {_heard(last)}, to {_heard(frame)}: all of it becomes"
            self.changed = f"{told} {self._stream.codec_context.layout.name}, {self._rate} Hz"
        self._resampler = AudioResampler(old.format, old.layout, old.rate)
        return old.resample(None) + self._resampler.resample(frame)

    def _place(self, part: av.AudioFrame) -> list[av.Packet[AudioStream]]:
        """Append samples at their time stamp, after silence or without what overlaps if needed."""
        pts: int | None = None
        if part.pts is not None and part.time_base is not None:
            pts = round(part.pts * part.time_base * self._rate)
        if self._start is None:
            self._start = pts or 0
        gap = 0 if pts is None else pts - self._start - self._counted
        tolerance = _TOLERANCE_S * self._rate if self._counted else 0
        if abs(gap) > _LONGEST_GAP_S * self._rate:
            gap = 0  # a damaged time stamp, not an hour of silence
        packets: list[av.Packet[AudioStream]] = []
        if gap > tolerance:
            packets = self._silence(gap)
        rest = _without(part, -gap) if -gap > tolerance else part
        if rest is not None:
            self._write(rest)
        return packets

    def _silence(self, samples: int) -> list[av.Packet[AudioStream]]:
        packets: list[av.Packet[AudioStream]] = []
        form, layout = self._stream.codec_context.format.name, self._stream.codec_context.layout
        while samples > 0:
            block = av.AudioFrame(form, layout.name, min(samples, self._rate))
            # PyAV counts one plane too many, which does not exist, where there are eight
            count = block.layout.nb_channels if block.format.is_planar else 1
            for plane in block.planes[:count]:
                plane.update(bytes(plane.buffer_size))
            samples -= block.samples
            self._write(block)
            packets += self._drain(last=False)
        return packets

    def _write(self, part: av.AudioFrame) -> None:
        part.sample_rate = self._rate
        part.time_base = Fraction(1, self._rate)
        part.pts = None  # the FIFO takes time stamps only where they agree with its own count
        self._counted += part.samples
        self._fifo.write(part)

    def _encoded(self, frame: av.AudioFrame) -> list[av.Packet[AudioStream]]:
        frame.pts = (self._start or 0) + self._taken
        self._taken += frame.samples
        return self._stream.encode(frame)

    def _drain(self, *, last: bool) -> list[av.Packet[AudioStream]]:
        packets: list[av.Packet[AudioStream]] = []
        size = self._stream.codec_context.frame_size or 1024
        while (frame := self._fifo.read(size)) is not None:
            packets += self._encoded(frame)
        if last:
            if (rest := self._fifo.read(0, partial=True)) is not None:
                packets += self._encoded(rest)
            packets += self._stream.encode(None)
        return packets


def _heard(frame: av.AudioFrame) -> str:
    """Layout and rate of a frame."""
    return f"{frame.layout.name}, {frame.sample_rate} Hz"


def _without(part: av.AudioFrame, samples: int) -> av.AudioFrame | None:
    """A frame without its first samples; None where these are all."""
    part.pts = None  # the FIFO takes time stamps only where they agree with its own count
    fifo = AudioFifo()
    fifo.write(part)
    fifo.read(samples, partial=True)
    return fifo.read()


def _chosen(
    container: av.container.OutputContainer, source: AudioCodecContext
) -> tuple[str, int, str]:
    """The first encoder, rate [Hz] and layout that work; ValueError without one."""
    name, default = container.format.name, container.default_audio_codec
    if default == "none":
        raise ValueError(f"{name} holds no sound")
    deep = source.format.bytes > 2
    pcm = ("pcm_s24le", "pcm_s16le") if deep else ("pcm_s16le",)
    surround = _SURROUND if source.layout.nb_channels > 2 else ()
    lossless = source.codec.name in _LOSSLESS and name in _LOSSLESS_IN
    kept: tuple[str, ...] = ("alac", "flac") if lossless else ()
    if source.codec.name.startswith("pcm_"):
        kept = (source.codec.name,)
    if source.codec.name in _LOSSLESS and name == "avi":
        kept = pcm
    rates: tuple[int, ...] = (source.sample_rate, 48000, 44100, 8000)
    if name in ("mxf", "dv"):
        rates = tuple(rate for rate in rates if rate == 48000)
    own = _layout(source)
    alike = (own, _SAME_COUNT.get(source.layout.nb_channels, own))
    # rather another codec than fewer channels
    for layouts in (alike, ("stereo", "mono")):
        for codec in (*kept, *_PREFERRED, *surround, *pcm, default):
            if not _is_encoder(codec) or is_recent(name, codec) or not holds_audio(name, codec):
                continue
            for layout, rate in product(layouts, rates):
                # tried first: a stream that was added cannot be removed
                with contextlib.suppress(ValueError):
                    _try(codec, rate, layout)
                    return codec, rate, layout
    raise ValueError(f"nothing here encodes {source.sample_rate} Hz for {name}")


def _is_encoder(name: str) -> bool:
    with contextlib.suppress(ValueError):
        return av.Codec(name, "w").type == "audio"
    return False


def _try(codec: str, rate: int, layout: str) -> None:
    """Open an encoder; ValueError where it refuses."""
    trial = av.CodecContext.create(codec, "w")
    assert isinstance(trial, AudioCodecContext)
    try:
        trial.sample_rate, trial.layout, trial.time_base = rate, layout, Fraction(1, max(1, rate))
        if trial.codec.audio_formats:
            trial.format = trial.codec.audio_formats[0]
        trial.open()
    except av.FFmpegError as error:
        raise ValueError(f"{codec} does not take {rate} Hz, {layout}") from error


def _layout(context: AudioCodecContext) -> str:
    """The source's layout, or the usual one of its number of channels."""
    count = context.layout.nb_channels
    unnamed = context.layout.name == f"{count} channels"
    return _USUAL_LAYOUTS.get(count, context.layout.name) if unnamed else context.layout.name


class SubtitleEncoder:
    """Transcoder of one stream of text subtitles.

    Attributes:
        codec: FFmpeg's name of the encoder.

    Raises:
        ValueError: they are pictures, or the container holds no text subtitles.
    """

    def __init__(self, container: av.container.OutputContainer, source: Stream) -> None:
        context, name = source.codec_context, container.format.name
        if not isinstance(context, SubtitleCodecContext) or not context.codec.text_sub:
            raise ValueError(f"{name} does not hold its codec")
        if name not in _TEXT_CODECS:
            raise ValueError(f"{name} holds no text")
        self.codec = _TEXT_CODECS[name]
        self._decoder = context
        context.open(strict=False)
        added = container.add_stream(self.codec)
        assert isinstance(added, SubtitleStream)
        self._stream = added
        self._stream.codec_context.subtitle_header = context.subtitle_header
        self._stream.time_base = source.time_base
        self._stream.metadata.update(source.metadata)
        self._stream.disposition = source.disposition

    def encode(self, packet: Packet) -> list[Packet]:
        """The text in a packet of the target's codec; none for an empty packet."""
        subtitle = self._decoder.decode2(packet) if packet.size else None
        if subtitle is None or not len(subtitle):
            return []
        encoded = self._stream.codec_context.encode_subtitle(subtitle)
        encoded.pts, encoded.dts, encoded.duration = packet.pts, packet.dts, packet.duration
        encoded.time_base, encoded.stream = packet.time_base, self._stream
        return [encoded]
