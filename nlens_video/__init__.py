"""Put a rendered, animated object into real footage as if the same lens had filmed it."""

from nlens_video.core.version import VERSION

TYPE_CHECKING = False  # as of `typing`, which takes ten milliseconds to load
if TYPE_CHECKING:
    from nlens_video.compositor.compositor import Compositor
    from nlens_video.compositor.frame_queue import FrameQueue
    from nlens_video.compositor.video_capture import VideoCapture
    from nlens_video.core.lens_fit import LensFit

__version__ = VERSION
__all__ = ["Compositor", "FrameQueue", "LensFit", "VideoCapture", "__version__"]


def __dir__() -> list[str]:
    """The public names, those included that are loaded when they are first asked for."""
    return sorted({*globals(), *__all__})


def __getattr__(name: str) -> object:
    """Load the compositor, and with it the heavy libraries, when it is first asked for."""
    if name == "Compositor":
        from nlens_video.compositor.compositor import Compositor

        return Compositor
    if name == "FrameQueue":
        from nlens_video.compositor.frame_queue import FrameQueue

        return FrameQueue
    if name == "VideoCapture":
        from nlens_video.compositor.video_capture import VideoCapture

        return VideoCapture
    if name == "LensFit":
        from nlens_video.core.lens_fit import LensFit

        return LensFit
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
