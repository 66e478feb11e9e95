"""An RTSP server: a camera at /camera, and at /live what is recorded into a Matroska file.

Run by the Python that sees GStreamer's bindings: `gstreamer_rtsp.py RECORDING`; prints its port.
"""

from __future__ import annotations

import sys

import gi

gi.require_version("Gst", "1.0")
gi.require_version("GstRtspServer", "1.0")
from gi.repository import GLib, Gst, GstRtspServer  # noqa: E402  the versions are chosen first

CAMERA = (
    "( videotestsrc is-live=true pattern=ball ! video/x-raw,width=480,height=270,framerate=25/1 "
    "! x264enc tune=zerolatency speed-preset=ultrafast ! rtph264pay name=pay0 pt=96 )"
)
RECORD = (
    "( rtph264depay name=depay0 ! h264parse ! matroskamux streamable=true ! filesink location={} )"
)


def main() -> None:
    Gst.init(None)
    server = GstRtspServer.RTSPServer(service="0")
    camera, recorder = GstRtspServer.RTSPMediaFactory(), GstRtspServer.RTSPMediaFactory()
    camera.set_launch(CAMERA)
    recorder.set_launch(RECORD.format(sys.argv[1]))
    recorder.set_transport_mode(GstRtspServer.RTSPTransportMode.RECORD)
    points = server.get_mount_points()
    points.add_factory("/camera", camera)
    points.add_factory("/live", recorder)
    server.attach(None)
    print(server.get_bound_port(), flush=True)
    GLib.MainLoop().run()


if __name__ == "__main__":
    main()
