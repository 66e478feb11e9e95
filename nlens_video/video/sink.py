"""Where results go: `open_sink` for anything that FFmpeg writes, stills, sequences and OpenEXR."""

from __future__ import annotations

from pathlib import Path
from types import TracebackType
from typing import Protocol, Self

from nlens_video.errors import OutputError, UsageError
from nlens_video.video.atomic import check_folder
from nlens_video.video.info import Packet, SourceFrame, SourceInfo
from nlens_video.video.named_files import NamedFiles, local_path
from nlens_video.video.numbered import Numbered
from nlens_video.video.still_sink import EXTENSIONS, StillSink
from nlens_video.video.video_sink import VideoSink


class Sink(Protocol):
    """Takes frames in order. A context manager: left without `commit`, it leaves nothing behind.

    Attributes:
        kept: the partial file that an aborted run has left, where that was asked for.
    """

    kept: Path | None

    @property
    def notes(self) -> tuple[str, ...]:
        """What differs from the source so far, and why; for the plan and the log."""
        ...

    def write(self, frame: SourceFrame) -> None:
        """Encode one frame."""
        ...

    def write_packet(self, packet: Packet) -> None:
        """Carry over a packet of one of the source's other streams."""
        ...

    def commit(self) -> None:
        """Finish the result and give it its name."""
        ...

    def __enter__(self) -> Self: ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None,
        trace: TracebackType | None,
    ) -> None: ...  # fmt: skip


def open_sink(
    spec: str, info: SourceInfo, *, codec: str | None = None, crf: float | None = None,
    pix_fmt: str | None = None, keep_partial: bool = False,
) -> Sink:  # fmt: skip
    """Open a result; nothing of that name exists before `commit`.

    Args:
        spec: video file by its extension, picture, `%04d` sequence, or `-` for standard output.
        info: the source whose timing, tags and other streams are carried over.
        codec: encoder or codec family; default: the source's family.
        crf: quality; default: visually lossless.
        pix_fmt: pixel format; default: the source's.
        keep_partial: whether an aborted run leaves a playable file.

    Raises:
        OutputError: it cannot be written there, or nothing writes that extension.
        UsageError: codec, quality or pixel format do not exist, do not go together, or are given
            for pictures.
    """
    if spec != "-" and "://" not in spec:
        path = Path(spec)
        check_folder(path)
        plate = local_path(info.name)
        if plate is not None and NamedFiles(path).meets(NamedFiles(plate)):
            raise OutputError(f"{spec}: is the input as well; give the result another name")
        if path.suffix.lower() in EXTENSIONS:
            if info.kind not in ("still",) and not Numbered.matches(spec):
                raise OutputError(
                    f"{spec}: is one picture, the plate is a {info.kind}; "
                    "give a video or a sequence such as out_%04d.png"
                )
            _check_pictures(spec, codec, crf, pix_fmt)
            return StillSink(spec, info, pix_fmt=pix_fmt, keep_partial=keep_partial)
    return VideoSink(
        spec, info, codec=codec, crf=crf, pix_fmt=pix_fmt, keep_partial=keep_partial
    )  # fmt: skip


def _check_pictures(spec: str, codec: str | None, crf: float | None, pix_fmt: str | None) -> None:
    """See that nothing is asked for that pictures do not have."""
    suffix = Path(spec).suffix.lower()
    given = {"--codec": codec, "--crf": crf, "--pix-fmt": pix_fmt if suffix == ".exr" else None}
    for option, value in given.items():
        if value is not None:
            raise UsageError(
                f"{option} {value}: {spec} is written as {suffix[1:]}, which has no such choice; "
                f"leave {option} out or give a video"
            )
