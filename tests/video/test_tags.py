"""Tags of a result that readers find: title, chapters, and languages in their codes."""

import av
import pytest
from support.clips import copy
from support.programs import made, streams

from nlens_video.video.output.tags import held_language

SAID = "1\n00:00:00,000 --> 00:00:00,300\nHello\n"


def plate(folder, name, sound, text):
    """A plate whose sound and subtitles have languages."""
    (folder / "said.srt").write_text(SAID)
    return made(
        "-f", "lavfi", "-i", "testsrc2=s=64x48:r=25:d=0.4", "-f", "lavfi", "-i", "sine=d=0.4",
        "-i", folder / "said.srt", "-c:v", "ffv1", "-c:a", "aac", "-c:s", "srt",
        "-metadata:s:a", f"language={sound}", "-metadata:s:s", f"language={text}", folder / name,
    )  # fmt: skip


def languages(path):
    found = {str(one["codec_type"]): one.get("tags", {}).get("language") for one in streams(path)}
    return found["audio"], found.get("subtitle")


@pytest.mark.parametrize(
    ("sound", "text", "becomes"),
    [
        ("deu", "fre", ("ger", "fra")), ("nld", "cze", ("dut", "ces")),
        ("eng", "zho", ("eng", "chi")), ("swe", "hrv", ("sve", "hr ")),
    ],
)  # fmt: skip
def test_languages_get_the_codes_of_quicktime(tmp_path, sound, text, becomes):
    notes = copy(plate(tmp_path, "in.mkv", sound, text), tmp_path / "out.mov")
    assert languages(tmp_path / "out.mov") == becomes
    assert not [note for note in notes if "language" in note]


@pytest.mark.parametrize("ending", ["mp4", "mkv", "ts"])
def test_languages_keep_their_codes_where_a_container_takes_any(tmp_path, ending):
    notes = copy(plate(tmp_path, "in.mkv", "deu", "fre"), tmp_path / f"out.{ending}")
    assert languages(tmp_path / f"out.{ending}")[0] == "deu"
    assert not [note for note in notes if "language" in note]


def test_names_of_quicktime_become_codes_elsewhere(tmp_path):
    first = tmp_path / "first.mov"
    copy(plate(tmp_path, "in.mkv", "swe", "hrv"), first)
    copy(first, tmp_path / "out.mkv")
    assert languages(tmp_path / "out.mkv") == ("swe", "hrv")


@pytest.mark.parametrize(
    ("ending", "sound", "told"),
    [("mov", "hau", "mov has no code for hau"), ("avi", "deu", "avi has no code for deu")],
)
def test_language_that_a_container_has_no_code_for_is_told(tmp_path, ending, sound, told):
    out = tmp_path / f"out.{ending}"
    notes = copy(plate(tmp_path, "in.mkv", sound, "und"), out)
    assert f"languages of streams are left out: {told}" in notes
    assert languages(out)[0] in (None, "und")


@pytest.mark.parametrize("container", ["hls", "yuv4mpegpipe"])
def test_language_stays_where_nothing_tells_what_is_held(container):
    assert held_language(container, "deu") == "deu"


@pytest.mark.parametrize(
    ("name", "lost"),
    [
        ("out.mp4", []), ("out.mkv", []), ("out.nut", []),
        ("out.avi", ["chapters are left out: avi has no place for them"]),
        ("out.ts", [
            "the title is left out: mpegts has no place for it",
            "chapters are left out: mpegts has no place for them",
        ]),
    ],
)  # fmt: skip
def test_title_and_chapters_are_kept_or_said_to_be_left_out(tmp_path, name, lost):
    (tmp_path / "t.txt").write_text(
        ";FFMETADATA1\ntitle=T\n[CHAPTER]\nTIMEBASE=1/1000\nSTART=0\nEND=300\ntitle=One\n"
    )
    said = made(
        "-f", "lavfi", "-i", "testsrc2=s=64x48:r=25:d=0.4", "-i", tmp_path / "t.txt",
        "-map_metadata", "1", "-c:v", "libx264", tmp_path / "in.mkv",
    )  # fmt: skip
    notes = copy(said, tmp_path / name)
    assert [one for one in notes if "title" in one or "chapters" in one] == lost
    with av.open(str(tmp_path / name)) as found:
        assert (found.metadata.get("title") == "T") == ("title" not in "".join(lost))
        assert bool(found.chapters()) == ("chapters" not in "".join(lost))


def test_nothing_is_said_of_a_title_that_the_plate_does_not_have(tmp_path):
    said = made(
        "-f", "lavfi", "-i", "testsrc2=s=64x48:r=25:d=0.4", "-c:v", "mpeg2video",
        tmp_path / "in.mkv",
    )  # fmt: skip
    assert not [one for one in copy(said, tmp_path / "out.ts") if "left out" in one]
