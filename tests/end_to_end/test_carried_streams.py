"""Other streams and their metadata, against ffmpeg's `-map 0 -c copy`."""

from pathlib import Path

import pytest
from support.clips import copy
from support.command import nlens
from support.programs import complaints, ffmpeg, made, streams
from support.shots import cube_glb, fit_json

pytestmark = pytest.mark.needs_programs("ffmpeg", "ffprobe")
PICTURES = ("-f", "lavfi", "-i", "testsrc2=s=64x48:r=25:d=1")
SOUND = ("-f", "lavfi", "-i", "sine=r=48000:d=1")
SUBTITLE = "1\n00:00:00,100 --> 00:00:00,400\nHello\n\n2\n00:00:00,500 --> 00:00:00,900\nthere\n"
TAGS = ";FFMETADATA1\ntitle=A title\n[CHAPTER]\nTIMEBASE=1/1000\nSTART=0\nEND=900\ntitle=One\n"
X265 = ("-c:v:0", "libx265", "-x265-params", "log-level=none", "-tag:v:0", "hvc1")


@pytest.fixture(scope="module")
def parts(tmp_path_factory):
    """Files that the sources are made of."""
    folder = tmp_path_factory.mktemp("parts")
    (folder / "s.srt").write_text(SUBTITLE)
    (folder / "tags.txt").write_text(TAGS)
    made("-f", "lavfi", "-i", "color=red:s=32x32", "-frames:v", 1, folder / "cover.jpg")
    (folder / "font.ttf").write_bytes(b"\0\1\0\0" + bytes(96))
    return folder


def film(parts, ending, *words):
    """Pictures, two tongues of sound, subtitles, a chapter and a cover, where they have room."""
    text = "mov_text" if ending in ("mp4", "mov") else "srt"
    cover = ("-i", parts / "cover.jpg", "-map", 5, "-disposition:v:1", "attached_pic")
    return made(
        *PICTURES, *SOUND, *SOUND, "-i", parts / "s.srt", "-i", parts / "tags.txt",
        *(cover[:2] if ending == "mp4" else ()), "-map", 0, "-map", 1, "-map", 2, "-map", 3,
        *(cover[2:] if ending == "mp4" else ()), "-map_metadata", 4, "-pix_fmt", "yuv420p",
        "-c:v:1", "copy", "-c:a:0", "aac", "-c:a:1", "ac3", "-c:s", text,
        "-metadata:s:a:0", "language=eng", "-metadata:s:a:1", "language=deu",
        "-metadata:s:s:0", "language=fra", "-disposition:v:0", "default",
        "-disposition:a:0", "default", "-disposition:a:1", "comment", *words,
        parts / f"film.{ending}",
    )  # fmt: skip


def described(path):
    """Type, codec, sample entry, language and dispositions of each stream, but for its order."""
    return sorted(
        (
            one["codec_type"], one.get("codec_name", ""), one.get("tags", {}).get("language", ""),
            tuple(sorted(name for name, on in one["disposition"].items() if on)),
        )
        for one in streams(path)
    )  # fmt: skip


@pytest.mark.parametrize("ending", ["mp4", "mov", "mkv", "ts", "nut"])
def test_all_streams_are_copied_as_by_ffmpeg(ending, parts, tmp_path):
    words = ("-c:v:0", "libx264") if ending == "nut" else X265
    plate = film(parts, {"ts": "mkv", "nut": "mkv"}.get(ending, ending), *words)
    # It cannot copy the track of QuickTime's chapters, and writes text that nothing reads again.
    less = ("-map", "-0:d?", *(("-map", "-0:s") if ending in ("ts", "nut") else ()))
    theirs = made("-i", plate, "-map", 0, *less, "-c", "copy", tmp_path / f"theirs.{ending}")
    ours = tmp_path / f"ours.{ending}"
    copy(plate, ours)
    assert described(ours) == described(theirs)
    assert complaints(ours) == ""


@pytest.mark.parametrize("ending", ["mp4", "mov", "m4v"])
def test_hevc_in_mp4_is_tagged_hvc1_for_apple_players(ending, parts, tmp_path):
    plate = film(parts, "mkv", *X265[:4])
    codec = {"codec": "libx265"} if ending != "m4v" else {}
    out = tmp_path / f"out.{ending}"
    copy(plate, out, **codec)
    entry = streams(out)[0]["codec_tag_string"]
    assert entry == ("avc1" if ending == "m4v" else "hvc1")  # .m4v holds no HEVC


@pytest.mark.parametrize(("source", "ending"), [("mov", "mp4"), ("mp4", "mov")])
def test_timecode_tracks_are_kept_and_advanced_for_a_range(source, ending, tmp_path):
    plate = made(
        *PICTURES, "-pix_fmt", "yuv420p", "-timecode", "01:02:03:04", tmp_path / f"in.{source}"
    )
    glb, fit = cube_glb(tmp_path / "a.glb"), fit_json(tmp_path / "fit.json", 64, 48)
    for words, timecode in (((), "01:02:03:04"), (("--range", "5:10"), "01:02:03:09")):
        out = tmp_path / f"out.{ending}"
        run = nlens(plate, glb, out, "--fit", fit, "--preset", "draft", "-y", *words)
        assert run.returncode == 0, run.stderr
        track = [one for one in streams(out) if one["codec_tag_string"] == "tmcd"]
        assert [one["tags"]["timecode"] for one in track] == [timecode]
        assert "the timecode is" not in run.stderr


@pytest.mark.parametrize(
    ("source", "ending", "codec"),
    [("mp4", "mkv", "subrip"), ("mkv", "mp4", "mov_text"), ("mkv", "webm", "webvtt")],
)
def test_text_subtitles_are_converted_to_the_containers_format(
    source, ending, codec, parts, tmp_path
):
    plate = film(parts, source, "-c:v:0", "libx264")
    out = tmp_path / f"out.{ending}"
    notes = copy(plate, out)
    assert any(f"(subtitle) becomes {codec}" in note for note in notes)
    found = next(one for one in streams(out) if one["codec_type"] == "subtitle")
    assert (found["codec_name"], found["tags"]["language"]) == (codec, "fra")
    text, same = (
        made("-i", one, "-copyts", "-map", "0:s", tmp_path / f"{number}.srt").read_text()
        for number, one in enumerate((plate, out))
    )
    assert text == same


def test_attachments_and_covers_of_matroska_are_copied_byte_for_byte(parts, tmp_path):
    plain = film(parts, "mkv", "-c:v:0", "libx264")
    plate = made(
        "-i", plain, "-map", 0, "-c", "copy", "-attach", parts / "font.ttf", "-attach",
        parts / "cover.jpg", "-metadata:s:t:0", "mimetype=font/ttf", "-metadata:s:t:1",
        "mimetype=image/jpeg", tmp_path / "in.mkv",
    )  # fmt: skip
    out = tmp_path / "out.mkv"
    assert not [note for note in copy(plate, out) if "left out" in note]
    kept = {one["tags"].get("filename"): one for one in streams(out) if "filename" in one["tags"]}
    assert set(kept) == {"font.ttf", "cover.jpg"}
    assert kept["cover.jpg"]["disposition"]["attached_pic"] == 1
    ffmpeg(f"-dump_attachment:{kept['font.ttf']['index']}", tmp_path / "font.ttf", "-i", out)
    assert (tmp_path / "font.ttf").read_bytes() == (parts / "font.ttf").read_bytes()


@pytest.mark.parametrize("ending", ["mp4", "mkv"])
def test_cover_of_an_mp4_is_copied_byte_for_byte(ending, parts, tmp_path):
    plate = film(parts, "mp4", "-c:v:0", "libx264")
    out = tmp_path / f"out.{ending}"
    copy(plate, out)
    cover = next(one for one in streams(out) if one["disposition"]["attached_pic"])
    made("-i", out, "-map", f"0:{cover['index']}", "-c", "copy", tmp_path / "cover.jpg")
    assert (tmp_path / "cover.jpg").read_bytes() == Path(parts / "cover.jpg").read_bytes()


def test_dropped_streams_are_reported(parts, tmp_path):
    plate = film(parts, "mp4", "-c:v:0", "libx264", "-timecode", "00:00:00:00")
    notes = " ".join(copy(plate, tmp_path / "out.avi"))
    assert "(subtitle) is left out: avi holds no text" in notes
    assert "(cover) is left out: avi has no place for it" in notes
    assert "the timecode is left out: avi has no place for it" in notes
