"""A call by WebRTC between two pipelines of one process; prints how many pictures arrived.

Run by the Python that sees GStreamer's bindings: `gstreamer_webrtc.py LINE`, whose last element is
`webrtcbin name=rtc`. The offer, the answer and the candidates, which a page and a server would
exchange, go from one to the other directly.
"""

from __future__ import annotations

import sys

import gi

gi.require_version("Gst", "1.0")
gi.require_version("GstWebRTC", "1.0")
gi.require_version("GstSdp", "1.0")
# After the versions, which PyGObject takes from the first import (E402). GstSdp is named nowhere
# below, but PyGObject cannot hand over a signal's offer unless it is loaded (F401).
from gi.repository import GLib, Gst, GstSdp, GstWebRTC  # noqa: E402, F401

ENOUGH, WAIT_S = 20, 60
RECEIVE = "rtpvp8depay ! vp8dec ! videoconvert ! appsink name=out emit-signals=true sync=false"


class Call:
    """The two ends."""

    def __init__(self, line: str) -> None:
        self.arrived, self.loop = 0, GLib.MainLoop()
        self.sender, self.receiver = Gst.parse_launch(line), Gst.Pipeline.new("receiver")
        self.near = self.sender.get_by_name("rtc")
        self.far = Gst.ElementFactory.make("webrtcbin", "far")
        self.receiver.add(self.far)
        for one, other in ((self.near, self.far), (self.far, self.near)):
            one.connect(
                "on-ice-candidate", lambda _, m, c, to=other: to.emit("add-ice-candidate", m, c)
            )
        self.near.connect("on-negotiation-needed", lambda _: self.ask(self.near, "offer"))
        self.far.connect("pad-added", self.show)

    def ask(self, end: Gst.Element, kind: str) -> None:
        """Let an end make an offer or an answer, and tell it to both."""

        def made(promise: Gst.Promise, *_: object) -> None:
            reply = promise.get_reply()
            said = reply.get_value(kind)
            other = self.far if end is self.near else self.near
            end.emit("set-local-description", said, None)
            then = None
            if kind == "offer":
                then = Gst.Promise.new_with_change_func(
                    lambda *_: self.ask(self.far, "answer"), None
                )
            other.emit("set-remote-description", said, then)

        end.emit(f"create-{kind}", None, Gst.Promise.new_with_change_func(made, None))

    def show(self, _: Gst.Element, pad: Gst.Pad) -> None:
        shown = Gst.parse_bin_from_description(RECEIVE, True)
        shown.get_by_name("out").connect("new-sample", self.count)
        self.receiver.add(shown)
        shown.sync_state_with_parent()
        pad.link(shown.get_static_pad("sink"))

    def count(self, out: Gst.Element) -> Gst.FlowReturn:
        out.emit("pull-sample")
        self.arrived += 1
        if self.arrived == ENOUGH:
            self.loop.quit()
        return Gst.FlowReturn.OK

    def run(self) -> int:
        for end in (self.receiver, self.sender):
            end.set_state(Gst.State.PLAYING)
        GLib.timeout_add_seconds(WAIT_S, self.loop.quit)
        self.loop.run()
        for end in (self.sender, self.receiver):
            end.set_state(Gst.State.NULL)
        return self.arrived


if __name__ == "__main__":
    Gst.init(None)
    print(Call(sys.argv[1]).run())
