"""docs/carried.md: what travels from a plate into a result, container by container.

Every cell is tried: a plate with that one thing in it is made by the ffmpeg program, copied by it
(`-map 0 -c copy`), written by nlens-video, and both are looked at by ffprobe.
"""

from __future__ import annotations

import json
import subprocess
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from nlens_video.video.input.source import open_source
from nlens_video.video.output.sink import open_sink

PAGE = Path(__file__).with_name("carried.md")
CONTAINERS = ("mp4", "mov", "mkv", "webm", "ts", "mxf", "avi", "nut")
_PICTURES = "-f lavfi -i testsrc2=s=352x288:r=25:d=0.4"
_SOUND = f"{_PICTURES} -f lavfi -i sine=r=48000:d=0.4 -ac 2"
_TEXT = f"{_PICTURES} -i s.srt"
_VIDEO = "-c:v libx264 -preset ultrafast -pix_fmt yuv420p"
Probe = dict[str, list[dict[str, dict[str, str]]]]
Look = Callable[[Probe], str]


@dataclass(frozen=True, slots=True)
class Row:
    """One thing that a plate may hold.

    Attributes:
        name: how the page calls it.
        words: of the ffmpeg program, which make a plate with it.
        file: the plate.
        look: what is left of it, from what ffprobe says; empty: nothing.
    """

    name: str
    words: str
    file: str
    look: Look


def _codec(kind: str) -> Look:
    def look(found: Probe) -> str:
        names = [one.get("codec_name", "") for one in found["streams"] if one["codec_type"] == kind]
        return str(names[0]) if names and names[0] not in ("", "unknown", "bin_data") else ""

    return look


def _timecode(found: Probe) -> str:
    tags = [one.get("tags", {}) for one in (*found["streams"], found["format"])]
    return next((v for one in tags for k, v in one.items() if k.lower() == "timecode"), "")


def _cover(found: Probe) -> str:
    return "cover" if any(o["disposition"]["attached_pic"] for o in found["streams"]) else ""


def _attachment(found: Probe) -> str:
    return "file" if any(one["codec_type"] == "attachment" for one in found["streams"]) else ""


def _second_video(found: Probe) -> str:
    names = [o["codec_name"] for o in found["streams"] if o["codec_type"] == "video"]
    return str(names[1]) if len(names) > 1 else ""


def _language(found: Probe) -> str:
    tags = [o.get("tags", {}) for o in found["streams"] if o["codec_type"] == "audio"]
    return str(tags[0].get("language", "")) if tags else ""


def _rotation(found: Probe) -> str:
    data = [side for o in found["streams"] for side in o.get("side_data_list", [])]
    return next((str(abs(int(side["rotation"]))) for side in data if "rotation" in side), "")


def _sound(name: str, words: str, file: str = "p.mkv") -> Row:
    return Row(name, f"{_SOUND} {_VIDEO} -c:a {words}", file, _codec("audio"))


ROWS = (
    _sound("AAC", "aac"), _sound("AC-3", "ac3"), _sound("E-AC-3", "eac3"),
    _sound("DTS", "dca -strict -2"), _sound("MP3", "libmp3lame"), _sound("Opus", "libopus"),
    _sound("Vorbis", "libvorbis"), _sound("FLAC", "flac"), _sound("ALAC", "alac", "p.mov"),
    _sound("PCM, 16 bit", "pcm_s16le", "p.mov"), _sound("PCM, 24 bit", "pcm_s24le", "p.mov"),
    Row("SubRip text", f"{_TEXT} {_VIDEO} -c:s srt", "p.mkv", _codec("subtitle")),
    Row("ASS text", f"{_TEXT} {_VIDEO} -c:s ass", "p.mkv", _codec("subtitle")),
    Row("MP4 text (tx3g)", f"{_TEXT} {_VIDEO} -c:s mov_text", "p.mp4", _codec("subtitle")),
    Row("a second video", f"{_PICTURES} {_PICTURES} -map 0 -map 1 {_VIDEO}", "p.mp4",
        _second_video),
    Row("cover", f"{_PICTURES} -i c.jpg -map 0 -map 1 {_VIDEO} -c:v:1 copy "
        "-disposition:v:1 attached_pic", "p.mp4", _cover),
    Row("attached font", f"{_PICTURES} {_VIDEO} -attach f.ttf -metadata:s:t mimetype=font/ttf",
        "p.mkv", _attachment),
    Row("timecode", f"{_PICTURES} {_VIDEO} -timecode 01:02:03:04", "p.mov", _timecode),
    Row("chapters", f"{_PICTURES} -i t.txt -map_metadata 1 {_VIDEO}", "p.mp4",
        lambda found: str(len(found["chapters"]) or "")),
    Row("title", f"{_PICTURES} {_VIDEO} -metadata title=T", "p.mp4",
        lambda found: found["format"].get("tags", {}).get("title", "")),
    Row("language of sound", f"{_SOUND} {_VIDEO} -c:a mp2 -metadata:s:a language=deu", "p.mkv",
        _language),
    Row("rotation", "-i r.mp4 -c copy", "p.mp4", _rotation),
)  # fmt: skip


def _run(folder: Path, words: str) -> bool:
    command = ["ffmpeg", "-v", "error", "-nostdin", "-y", *words.split()]
    return subprocess.run(command, cwd=folder, capture_output=True, check=False).returncode == 0


def _probe(path: Path) -> Probe | None:
    show = ("-show_streams", "-show_format", "-show_chapters")
    command = ["ffprobe", "-v", "error", *show, "-of", "json", str(path)]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    return json.loads(done.stdout) if done.returncode == 0 else None


def _write(plate: Path, out: Path) -> tuple[str, ...]:
    """Copy a plate; what the summary says of it."""
    with open_source(str(plate)) as source, open_sink(str(out), source.info) as sink:
        source.packet_sink = sink.write_packet
        for frame in source:
            sink.write(frame)
        sink.commit()
        return tuple(sink.notes)


def _prepare(folder: Path) -> None:
    (folder / "s.srt").write_text("1\n00:00:00,000 --> 00:00:00,300\nHello\n")
    (folder / "t.txt").write_text(
        ";FFMETADATA1\n[CHAPTER]\nTIMEBASE=1/1000\nSTART=0\nEND=300\ntitle=One\n"
    )
    (folder / "f.ttf").write_bytes(b"\0\1\0\0" + bytes(96))
    _run(folder, "-f lavfi -i color=red:s=32x32 -frames:v 1 c.jpg")
    _run(folder, f"{_PICTURES} {_VIDEO} r0.mp4")
    _run(folder, "-i r0.mp4 -c copy -metadata:s:v rotate=90 r.mp4")


def cells(row: Row, containers: Sequence[str], folder: Path) -> list[str]:
    """What becomes of one thing in each container, beside the ffmpeg program's copy."""
    plate = folder / row.file
    made = _run(folder, f"{row.words} {row.file}")
    probe = _probe(plate) if made else None
    before = row.look(probe) if probe else ""
    if not before:
        raise RuntimeError(f"the ffmpeg program makes no plate with {row.name}")
    result = []
    for container in containers:
        ours, theirs = folder / f"ours.{container}", folder / f"theirs.{container}"
        notes = _write(plate, ours)
        kept = _left(row, ours)
        if not kept and not any("out" in note or "upright" in note for note in notes):
            raise RuntimeError(f"{ours.name} has lost {row.name}, and nothing says so")
        copied = _run(folder, f"-i {row.file} -map 0 -c copy {theirs.name}")
        same, theirs_same = kept == before, copied and _left(row, theirs) == before
        sign = {(True, False): " (+)", (False, True): " (−)"}.get((same, theirs_same), "")
        result.append(("kept" if same else kept or "–") + sign)
    return result


def _left(row: Row, path: Path) -> str:
    probe = _probe(path)
    return row.look(probe) if probe else ""


def lines(containers: Sequence[str] = CONTAINERS) -> list[str]:
    """The table's lines, in Markdown."""
    head = ["plate has", *(f"`.{one}`" for one in containers)]
    result = [" | ".join(head), " | ".join("---" for _ in head)]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        _prepare(folder)
        for row in ROWS:
            result.append(" | ".join([row.name, *cells(row, containers, folder)]))
    return [f"| {line} |" for line in result]


def main() -> None:
    """Write the table into the page, in place of the one that is there."""
    text = PAGE.read_text()
    start = text.index("| plate has")
    PAGE.write_text(text[:start] + "\n".join(lines()) + "\n")


if __name__ == "__main__":
    main()
