"""GStreamer's element `nlens`: an object in the frames of a pipeline.

GStreamer's own loader of Python plug-ins imports it; `gstreamer_install` tells it where it lies.
"""

from __future__ import annotations

import inspect
import json
from fractions import Fraction
from typing import Any, ClassVar, TypeAlias

import gi
import numpy as np
from msgspec.structs import asdict

from nlens_video.adapters import contract
from nlens_video.compositor.compositor import Compositor
from nlens_video.core.errors import NlensError, UsageError
from nlens_video.core.layers import UInt8
from nlens_video.core.version import VERSION
from nlens_video.video.info import FrameTags

gi.require_version("Gst", "1.0")
gi.require_version("GstBase", "1.0")
gi.require_version("GstVideo", "1.0")
from gi.repository import GLib, GObject, Gst, GstBase, GstVideo  # noqa: E402  after the versions

GiObject: TypeAlias = Any
"""An object of GStreamer's: PyGObject makes their classes at run time, without types."""
FORMATS = {
    "I420": "yuv420p", "Y42B": "yuv422p", "Y444": "yuv444p", "NV12": "nv12", "NV21": "nv21",
    "NV16": "nv16", "NV24": "nv24", "YUY2": "yuyv422", "YVYU": "yvyu422", "UYVY": "uyvy422",
    "I420_10LE": "yuv420p10le", "I422_10LE": "yuv422p10le", "Y444_10LE": "yuv444p10le",
    "I420_12LE": "yuv420p12le", "I422_12LE": "yuv422p12le", "Y444_12LE": "yuv444p12le",
    "Y444_16LE": "yuv444p16le", "A420": "yuva420p", "GBR": "gbrp", "GBR_10LE": "gbrp10le",
    "GBR_12LE": "gbrp12le", "RGB": "rgb24", "BGR": "bgr24", "RGBA": "rgba", "BGRA": "bgra",
    "ARGB": "argb", "ABGR": "abgr", "RGBx": "rgb0", "BGRx": "bgr0", "xRGB": "0rgb", "xBGR": "0bgr",
    "GRAY8": "gray", "GRAY16_LE": "gray16le",
}  # fmt: skip
"""FFmpeg's names of GStreamer's formats; `videoconvert` makes one of them of others."""
_CAPS = Gst.Caps.from_string(
    f"video/x-raw, format=(string){{ {', '.join(FORMATS)} }}, width=(int)[1, max], "
    "height=(int)[1, max], framerate=(fraction)[0/1, max]"
)
_RANGES = {1: 2, 2: 1}
"""FFmpeg's numbers of GStreamer's `0_255` and `16_235`, whose names are none in Python."""
_MEGA = 1_000_000
_EXACT_S = 1e-6  # a time this near to that of a frame's number is taken for it: GStreamer rounds
_TOLD_EVERY = 30  # frames
_GREW = 1.25  # times that were told before are told again when they grew by so much
_NO_PROPERTIES = {"fps", "pixel_aspect", "optics", "glb"}
"""The stream tells the first two itself, other options give `optics` as text, `glb` is below."""


def _property(name: str, default: object) -> tuple[object, ...]:
    words = f"{name.replace('_', '-')} of nlens-video render"
    flags = GObject.ParamFlags.READWRITE
    if isinstance(default, bool):
        return (bool, name, words, default, flags)
    return (str, name, words, None if default is None else str(default), flags)


_OPTIONS = {
    name: parameter.default
    for name, parameter in inspect.signature(Compositor).parameters.items()
    if name not in _NO_PROPERTIES
}


class Nlens(GstBase.BaseTransform):  # type: ignore[misc]  # PyGObject has no types
    """The element; its properties are the options of a `Compositor`, as text."""

    __gtype_name__ = "Nlens"
    __gstmetadata__ = (
        "nlens-video",
        "Filter/Effect/Video",
        f"Puts an animated object into video as if the same lens had filmed it ({VERSION})",
        "nlens-video",
    )
    __gsttemplates__ = tuple(
        Gst.PadTemplate.new(name, direction, Gst.PadPresence.ALWAYS, _CAPS)
        for name, direction in (("src", Gst.PadDirection.SRC), ("sink", Gst.PadDirection.SINK))
    )
    __gproperties__: ClassVar[dict[str, tuple[object, ...]]] = {
        "glb": (str, "glb", "file of the animated object", None, GObject.ParamFlags.READWRITE),
        **{name.replace("_", "-"): _property(name, value) for name, value in _OPTIONS.items()},
    }

    def __init__(self) -> None:
        super().__init__()
        _keep_floating(self)
        self._given: dict[str, Any] = {}
        self._lens: Compositor | None = None
        self._video: GiObject = None
        self._form: tuple[int, int, Fraction, Fraction] | None = None
        self._rate = Fraction(0)
        self._changed = False
        self._count = 0
        self.frame_ms = 0.0  # that the last latency was told with
        self._fit: object = None
        self.set_in_place(True)
        self.set_qos_enabled(True)
        self.srcpad.set_query_function_full(_query, None)
        self.sinkpad.add_probe(Gst.PadProbeType.EVENT_DOWNSTREAM, _at_end)

    def do_get_property(self, prop: GiObject) -> object:
        """The value that was given, or the default."""
        return self._given.get(prop.name, prop.default_value)

    def do_set_property(self, prop: GiObject, value: object) -> None:
        """Takes effect at the next buffer, for which the element opens anew."""
        self._given[prop.name] = value
        self._changed = True

    def do_set_caps(self, incaps: GiObject, outcaps: GiObject) -> bool:
        """A stream begins, or goes on in another form: other pixels or another rate open anew."""
        self._video = video = GstVideo.VideoInfo.new_from_caps(incaps)
        rate, shape = Fraction(video.fps_n, video.fps_d or 1), Fraction(video.par_n, video.par_d)
        before, self._form = self._form, (video.width, video.height, shape, rate)
        if self._lens is not None and self._form == before:
            return True
        self._rate = rate
        self._close()
        if not rate:  # the first buffer tells how long a frame lasts
            return True
        try:
            self._lens = self._open(float(rate))
        except NlensError as error:
            self._fail(error)
            return False
        return True

    def _open(self, fps: float | None) -> Compositor:
        given = {name.replace("-", "_"): value for name, value in self._given.items()}
        glb = given.pop("glb", None)
        if not glb:
            raise UsageError("no object was named; give glb=anim.glb")
        self._changed = False
        return contract.open(glb, **({} if fps is None else {"fps": fps}), **given)

    def do_transform_ip(self, buffer: GiObject) -> GiObject:
        """Composite one buffer where it lies; PTS, duration and metadata stay."""
        if self._video is None:
            return Gst.FlowReturn.NOT_NEGOTIATED
        try:
            if self._changed:
                self._close()
            lens = self._lens = self._lens or self._open(float(self._rate) or _rate_of(buffer))
            with buffer.map(Gst.MapFlags.READ | Gst.MapFlags.WRITE) as mapped:
                contract.process(lens, self._frame(buffer, mapped.data))
        except NlensError as error:
            self._fail(error)
            return Gst.FlowReturn.ERROR
        except Exception as error:
            self._fail(NlensError(f"{type(error).__name__}: {error}"))
            raise
        self._count += 1
        self._tell()
        return Gst.FlowReturn.OK

    def _frame(self, buffer: GiObject, memory: memoryview) -> contract.Frame:
        video, layout = self._video, GstVideo.buffer_get_video_meta(buffer) or self._video
        samples = np.frombuffer(memory, np.uint8)
        time_s = self._time_s(buffer)
        number = self._count
        if self._rate and time_s is not None:
            number = round(time_s * self._rate)
            exact = float(number / self._rate)
            time_s = exact if abs(time_s - exact) < _EXACT_S else time_s
        return contract.Frame(
            pixel_format=FORMATS[video.finfo.name],
            width=video.width,
            height=video.height,
            planes=tuple(
                _rows(
                    samples, layout.offset[plane], layout.stride[plane], _plane_rows(video, plane)
                )
                for plane in range(video.finfo.n_planes)
            ),
            tags=_tags(video.colorimetry),
            time_s=time_s,
            number=number,
            centred_chroma=video.chroma_site == GstVideo.VideoChromaSite.NONE,
            pixel_aspect=video.par_n / video.par_d,
        )

    def _time_s(self, buffer: GiObject) -> float | None:
        """Time in the stream, which a seek changes and the animation follows [s]."""
        if buffer.pts == Gst.CLOCK_TIME_NONE:
            return None
        at = self.segment.to_stream_time(Gst.Format.TIME, buffer.pts)
        return None if at == Gst.CLOCK_TIME_NONE else at / Gst.SECOND

    def do_stop(self) -> bool:
        """The stream is over."""
        self._close()
        self._video, self._count = None, 0
        return True

    def _close(self) -> None:
        if self._lens is not None:
            contract.close(self._lens)
        self._lens = self._fit = None

    def _tell(self) -> None:
        """Messages on the bus: plan and fit when they are found, timings, a longer latency."""
        lens = self._lens
        if lens is None:
            return
        if self._fit is None and lens.fit is not None:
            self._fit = lens.fit
            self._post("nlens-plan", list(lens.plan))
            self._post("nlens-fit", asdict(lens.fit))
        if self._count % _TOLD_EVERY == 0:
            self.tell_timings()
            p95_ms = lens.timings.p95_ms
            if p95_ms > _GREW * self.frame_ms:
                self.frame_ms = p95_ms
                self.post_message(Gst.Message.new_latency(self))

    def tell_timings(self) -> None:
        """Post the statistics of the frames so far."""
        if self._lens is not None:
            self._post("nlens-timings", asdict(self._lens.timings))

    def _post(self, name: str, content: object) -> None:
        structure = Gst.Structure.new_empty(name)
        structure.set_value("json", json.dumps(content, default=str))
        self.post_message(Gst.Message.new_element(self, structure))

    def _fail(self, error: NlensError) -> None:
        kind = GLib.Error.new_literal(Gst.stream_error_quark(), str(error), Gst.StreamError.FAILED)
        self.post_message(Gst.Message.new_error(self, kind, f"exit code {error.exit_code}"))


def _rate_of(buffer: GiObject) -> float | None:
    """Frames per second by how long a buffer lasts, None where it does not tell [1/s]."""
    lasts = buffer.duration not in (0, Gst.CLOCK_TIME_NONE)
    return Gst.SECOND / buffer.duration if lasts else None


def _keep_floating(element: GiObject) -> None:
    """Leave the first reference to whom the element is made for, as GStreamer expects.

    PyGObject takes it for its own wrapper, and every `gst-launch-1.0` would begin with a complaint
    about "faulty bindings"; the wrapper gets another one.
    """
    if not element.is_floating():
        element._ref()
        element._force_floating()


def _query(pad: GiObject, element: GiObject, query: GiObject, *given: object) -> bool:
    """Latency is that of what lies before, and the time that a frame takes in the element."""
    if query.type != Gst.QueryType.LATENCY:
        return bool(pad.query_default(element, query))
    if not element.sinkpad.peer_query(query):
        return False
    live, least, most = query.parse_latency()
    own = round(element.frame_ms * _MEGA)
    query.set_latency(live, least + own, most if most == Gst.CLOCK_TIME_NONE else most + own)
    return True


def _at_end(pad: GiObject, info: GiObject, *given: object) -> GiObject:
    """Timings of the whole stream, ahead of its end."""
    if info.get_event().type == Gst.EventType.EOS:
        pad.get_parent().tell_timings()
    return Gst.PadProbeReturn.OK


def _rows(samples: UInt8, offset: int, stride: int, rows: int) -> UInt8:
    """A plane's rows (rows, bytes): with their padding, unless the memory ends before the last."""
    width = min(stride, len(samples) - offset - (rows - 1) * stride)
    return np.lib.stride_tricks.as_strided(samples[offset:], (rows, max(width, 0)), (stride, 1))


def _plane_rows(video: GiObject, plane: int) -> int:
    """Rows of a plane, which chroma may have fewer of."""
    form = video.finfo
    halvings: int = form.h_sub[form.plane.index(plane)]
    return -(-int(video.height) >> halvings)


def _tags(colour: GiObject) -> FrameTags:
    """Caps' colorimetry by the numbers of ITU-T H.273."""
    return FrameTags(
        colorspace=GstVideo.VideoColorMatrix.to_iso(colour.matrix),
        color_range=_RANGES.get(int(colour.range), 0),
        color_primaries=GstVideo.VideoColorPrimaries.to_iso(colour.primaries),
        color_trc=GstVideo.VideoTransferFunction.to_iso(colour.transfer),
    )


GObject.type_register(Nlens)
ELEMENT = ("nlens", Gst.Rank.NONE, Nlens)
