"""The colour that the file of a picture states and that FFmpeg does not read."""

from __future__ import annotations

import av

from nlens_video.core.errors import InputError, Note, NoteKind
from nlens_video.video.info import Kind
from nlens_video.video.named_files import ImageSequence, local_path
from nlens_video.video.stills.embedded import embedded_profile, png_chunks
from nlens_video.video.stills.icc import profile_colour

_READ = ("apng", "dpx", "mjpeg", "png", "tiff", "webp")
_DPX_TRANSFER = 801
"""Where DPX says the transfer function [byte]."""
_LOGARITHMIC = {1: "printing density", 3: "logarithmic"}
_UNSAID = (0, 2)
_INVENTED = 4
"""Number of gamma 2.2, as which FFmpeg tags all grey TIFF."""


def take_stated_colour(
    spec: str, kind: Kind, codec: str, first: av.VideoFrame, transfer: str | None
) -> tuple[bytes, tuple[Note, ...]]:
    """Tag a frame with what the file of a picture states.

    Args:
        spec: name of the source.
        kind: of the source; of a sequence the first picture tells.
        codec: FFmpeg's name of it.
        first: the first frame; its primaries and transfer function are set where FFmpeg left them.
        transfer: the user's transfer function, which overrides that of DPX.

    Returns:
        The ICC profile, empty without one, and notes on what is not followed.

    Raises:
        InputError: DPX says that it is logarithmic.
    """
    if codec == "tiff" and first.color_trc == _INVENTED:
        first.color_trc = 2
    if kind not in ("still", "sequence") and codec != "apng" or codec not in _READ:
        return b"", ()
    numbered = ImageSequence(spec) if kind == "sequence" else None
    path = numbered.path(numbered.first()) if numbered else local_path(spec)
    data = path.read_bytes() if path else b""
    if codec == "dpx":
        mark = _LOGARITHMIC.get(data[_DPX_TRANSFER]) if len(data) > _DPX_TRANSFER else None
        if mark and transfer is None:
            raise InputError(
                f"{path}: the DPX has transfer {mark}, which is not supported; convert it first, "
                "or give --input-transfer if the mark is wrong"
            )
        return b"", ()
    profile = embedded_profile(data)
    if {first.color_primaries, first.color_trc}.difference(_UNSAID):
        return profile or b"", ()  # a PNG's own tags come before its profile
    if profile is None:
        return b"", _odd_gamma(str(path), data)
    colour = profile_colour(profile)
    if colour is not None:
        first.color_primaries, first.color_trc = colour
        return profile, ()
    line = (
        f"{path}: its ICC profile, of other than known primaries and transfer functions, is not "
        "followed: the picture is taken for sRGB; convert it to sRGB first where colours matter"
    )
    return profile, (Note(line, NoteKind.UNCERTAIN),)


def _odd_gamma(path: str, data: bytes) -> tuple[Note, ...]:
    """A note on a PNG's gamma, which FFmpeg does not know."""
    gamma = int.from_bytes(dict(png_chunks(data)).get(b"gAMA", b""), "big")
    if not gamma:
        return ()
    line = (
        f"{path}: its gamma of {100000 / gamma:.3g} (gAMA) is not followed, nor kept: the picture "
        "is taken for sRGB"
    )
    return (Note(line, NoteKind.UNCERTAIN),)
