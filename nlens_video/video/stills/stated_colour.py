"""The colour that the file of a picture states and that FFmpeg does not read."""

from __future__ import annotations

import av

from nlens_video.core.errors import Note, NoteKind
from nlens_video.video.info import Kind
from nlens_video.video.named_files import ImageSequence, local_path
from nlens_video.video.stills.embedded import embedded_profile
from nlens_video.video.stills.icc import profile_colour

_WITH_PROFILES = ("apng", "mjpeg", "png", "tiff", "webp")
_UNSAID = (0, 2)
_INVENTED = 4
"""Number of gamma 2.2, as which FFmpeg tags all grey TIFF."""


def take_stated_colour(
    spec: str, kind: Kind, codec: str, first: av.VideoFrame
) -> tuple[bytes, tuple[Note, ...]]:
    """Tag a frame with what the file of a picture states.

    Args:
        spec: name of the source.
        kind: of the source; of a sequence the first picture tells.
        codec: FFmpeg's name of it.
        first: the first frame; its primaries and transfer function are set where FFmpeg left them.

    Returns:
        The ICC profile, empty without one, and notes on what is not followed.
    """
    if codec == "tiff" and first.color_trc == _INVENTED:
        first.color_trc = 2
    if kind not in ("still", "sequence") and codec != "apng" or codec not in _WITH_PROFILES:
        return b"", ()
    numbered = ImageSequence(spec) if kind == "sequence" else None
    path = numbered.path(numbered.first()) if numbered else local_path(spec)
    profile = embedded_profile(path.read_bytes()) if path else None
    if profile is None or {first.color_primaries, first.color_trc}.difference(_UNSAID):
        return profile or b"", ()  # a PNG's own tags come before its profile
    colour = profile_colour(profile)
    if colour is not None:
        first.color_primaries, first.color_trc = colour
        return profile, ()
    line = (
        f"{path}: its ICC profile, of other than known primaries and transfer functions, is not "
        "followed: the picture is taken for sRGB; convert it to sRGB first where colours matter"
    )
    return profile, (Note(line, NoteKind.UNCERTAIN),)
