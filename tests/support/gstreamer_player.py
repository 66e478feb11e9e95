"""Plays pipelines with the element `nlens`, and prints what came out as JSON.

Run by the Python that sees GStreamer's bindings: `gstreamer_player.py WHAT PROPERTIES`. The plate
is a still test picture of 25 frames a second, or a file: `gstreamer_player.py file PROPERTIES CAPS
BYTES IN OUT`.
"""

from __future__ import annotations

import hashlib
import json
import sys
import time
from pathlib import Path

import gi

gi.require_version("Gst", "1.0")
gi.require_version("GstVideo", "1.0")
from gi.repository import Gst, GstVideo  # noqa: E402  the versions are chosen first

FORM = "video/x-raw,format=I420,width={},height={},framerate=25/1"
SIZES = ((480, 270), (320, 180))
WAIT = 20 * Gst.SECOND


class Player:
    """A pipeline whose frames are taken one by one."""

    def __init__(
        self, properties: str, source: str = "num-buffers=12", after: str = "", plate: str = ""
    ) -> None:
        Gst.init(None)
        plate = plate or (
            f"videotestsrc {source} pattern=ball motion=sweep ! "
            f"capsfilter name=form caps={FORM.format(*SIZES[0])}"
        )
        self.pipeline = Gst.parse_launch(
            f"{plate} ! nlens name=lens {properties} {after} ! appsink name=out sync=false"
        )
        self.out = self.pipeline.get_by_name("out")
        self.messages: list[tuple[str, object]] = []
        self.last = b""

    def start(self, state: Gst.State = Gst.State.PLAYING) -> None:
        self.pipeline.set_state(state)

    def frame(self) -> dict[str, object] | None:
        """The next frame; None at the end."""
        sample = self.out.emit("try-pull-sample", WAIT)
        self.listen()
        if sample is None:
            return None
        buffer, form = sample.get_buffer(), sample.get_caps().get_structure(0)
        with buffer.map(Gst.MapFlags.READ) as mapped:
            self.last = bytes(mapped.data)
        return {
            "pts": buffer.pts, "duration": buffer.duration,
            "samples": hashlib.sha256(self.last).hexdigest(), "format": form.get_value("format"),
            "width": form.get_value("width"), "colorimetry": form.get_value("colorimetry"),
        }  # fmt: skip

    def frames(self) -> list[dict[str, object]]:
        return list(iter(self.frame, None))

    def listen(self) -> None:
        bus = self.pipeline.get_bus()
        while (message := bus.pop()) is not None:
            if message.type == Gst.MessageType.ELEMENT:
                told = message.get_structure()
                self.messages.append((told.get_name(), json.loads(told.get_value("json"))))
            elif message.type == Gst.MessageType.ERROR:
                self.messages.append(("error", message.parse_error()[0].message))
            elif message.type in (Gst.MessageType.EOS, Gst.MessageType.LATENCY):
                self.messages.append((message.type.first_value_nick, None))
            elif message.type == Gst.MessageType.QOS:
                self.messages.append(("qos", message.src.get_name()))

    def seek(self, seconds: float) -> None:
        flags = Gst.SeekFlags.FLUSH | Gst.SeekFlags.ACCURATE
        assert self.pipeline.seek_simple(Gst.Format.TIME, flags, round(seconds * Gst.SECOND))

    def stop(self) -> list[tuple[str, object]]:
        self.listen()
        self.pipeline.set_state(Gst.State.NULL)
        return self.messages


def straight(properties: str) -> object:
    player = Player(properties)
    player.start()
    frames = player.frames()
    while ("eos", None) not in player.messages:  # it follows the last frame
        time.sleep(0.01)
        player.listen()
    return {"frames": frames, "messages": player.stop()}


def file(properties: str, caps: str, frame_bytes: str, path: str, out: str) -> object:
    """A file of raw frames; the samples that come out lie in another."""
    raw = f"filesrc location={path} blocksize={frame_bytes} ! {caps}"
    player = Player(properties, plate=f"{raw} ! queue ! rawvideoparse use-sink-caps=true")
    player.start()
    frames = []
    with Path(out).open("wb") as made:
        while (frame := player.frame()) is not None:
            frames.append(frame)
            made.write(player.last)
    return {"frames": frames, "messages": player.stop()}


def padded(properties: str, last: str) -> object:
    """A frame whose rows are padded, the very last one only if `last` is `whole`.

    It is told as all bytes but those of the last padding.
    """
    width, height = SIZES[0]
    strides = (512, 256, 256)
    offsets = (0, 512 * height, (512 + 128) * height)
    visible = (512 + 256) * height - 256 + width // 2
    codes = bytes(60 + at % 97 for at in range((512 + 256) * height))
    form = FORM.format(width, height)
    player = Player(properties, plate=f"appsrc name=in format=time caps={form}")
    buffer = Gst.Buffer.new_wrapped(codes if last == "whole" else codes[:visible])
    buffer.pts, buffer.duration = 0, Gst.SECOND // 25
    GstVideo.buffer_add_video_meta_full(
        buffer, GstVideo.VideoFrameFlags.NONE, GstVideo.VideoFormat.I420, width, height, 3,
        [*offsets, 0], [*strides, 0],
    )  # fmt: skip
    player.start()
    source = player.pipeline.get_by_name("in")
    source.emit("push-buffer", buffer)
    source.emit("end-of-stream")
    frame = player.frame()
    changed = player.last[:visible] != codes[:visible]
    samples = hashlib.sha256(player.last[:visible]).hexdigest()
    return {"came": frame is not None, "changed": changed, "samples": samples,
            "messages": player.stop()}  # fmt: skip


def seek(properties: str) -> object:
    """Three frames, then three from 0.32 s on, then from the start again."""
    player = Player(properties, "num-buffers=500")
    player.out.set_property("max-buffers", 1)
    player.start()
    first = [player.frame() for _ in range(3)]
    player.seek(0.32)
    later = [player.frame() for _ in range(3)]
    player.seek(0.0)
    again = [player.frame() for _ in range(3)]
    return {"first": first, "later": later, "again": again, "messages": player.stop()}


def renegotiation(properties: str) -> object:
    """Two frames of one size, then another size."""
    player = Player(properties, "num-buffers=40")
    player.out.set_property("max-buffers", 1)
    player.start()
    frames = [player.frame() for _ in range(2)]
    form = player.pipeline.get_by_name("form")
    form.set_property("caps", Gst.Caps.from_string(FORM.format(*SIZES[1])))
    frames += player.frames()
    return {"frames": frames, "messages": player.stop()}


def pushed(properties: str, *forms: str) -> object:
    """A frame of each form, 40 ms each; a form `NAME=TEXT` sets a property in its place."""
    width, height = SIZES[0]
    player = Player(properties, plate="appsrc name=in format=time")
    source, lens = (player.pipeline.get_by_name(name) for name in ("in", "lens"))
    player.start()
    frames = []
    for form in forms:
        if not form.startswith("video"):
            lens.set_property(*form.split("=", 1))
            continue
        size = f"format=I420,width={width},height={height},colorimetry=bt709"
        source.set_property("caps", Gst.Caps.from_string(f"{form},{size}"))
        codes = bytes(60 + at % 97 for at in range(width * height * 3 // 2))
        buffer = Gst.Buffer.new_wrapped(codes)
        buffer.pts, buffer.duration = len(frames) * Gst.SECOND // 25, Gst.SECOND // 25
        source.emit("push-buffer", buffer)
        frames.append(player.frame())
    source.emit("end-of-stream")
    return {"frames": frames, "messages": player.stop()}


def latency(properties: str) -> object:
    """What a live pipeline is told before and after forty frames [ms]."""
    player = Player(properties, "num-buffers=70 is-live=true")
    player.start()
    told = []
    for _ in range(2):
        for _ in range(32):
            player.frame()
        own, before = Gst.Query.new_latency(), Gst.Query.new_latency()
        lens = player.pipeline.get_by_name("lens")
        assert lens.get_static_pad("src").query(own)
        assert lens.get_static_pad("sink").peer_query(before)
        told.append([one.parse_latency()[1] / Gst.MSECOND for one in (own, before)])
    return {"told": told, "messages": player.stop()}


def late(properties: str) -> object:
    """A live stream before a sink that is slow: frames that come too late are left out."""
    player = Player(
        properties, "num-buffers=50 is-live=true", "! identity sleep-time=120000 ! queue"
    )
    player.out.set_property("sync", True)
    player.out.set_property("qos", True)
    player.start()
    return {"frames": player.frames(), "messages": player.stop()}


if __name__ == "__main__":
    print(json.dumps(globals()[sys.argv[1]](*sys.argv[2:])))
