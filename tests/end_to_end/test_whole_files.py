"""Truncated files are reported, and complete ones never are."""

import pytest
from support.programs import made

from nlens_video.video.input.source import open_source

pytestmark = pytest.mark.needs_programs("ffmpeg")
PICTURES = ("-f", "lavfi", "-i", "testsrc2=s=64x48:r=25:d=2")
SOUND = ("-f", "lavfi", "-i", "sine=r=48000:d=2")
H264 = ("-c:v", "libx264", "-pix_fmt", "yuv420p", "-g", 10)
SUBTITLE = "1\n00:00:00,000 --> 00:00:01,000\nHello\n\n2\n00:00:55,000 --> 00:01:00,000\nBye\n"


def told(path):
    """What is said of a file once it was read to its end, and how many frames it gave."""
    with open_source(str(path)) as source:
        count = sum(1 for _ in source)
        return count, " ".join(source.warnings())


def later(folder, ending):
    return made(*PICTURES, *SOUND, *H264, "-output_ts_offset", 20, folder / f"in.{ending}")


def with_edit_list(folder, ending):
    whole = made(*PICTURES, *SOUND, *H264, folder / f"whole.{ending}")
    return made("-ss", "0.7", "-i", whole, "-c", "copy", folder / f"in.{ending}")


def with_long_subtitles(folder, ending):
    (folder / "s.srt").write_text(SUBTITLE)
    codec = "mov_text" if ending in ("mp4", "mov") else "srt"
    words = ("-i", folder / "s.srt", "-c:s", codec)
    return made(*PICTURES, *words, *H264, "-map", 0, "-map", 1, folder / f"in.{ending}")


def with_a_longer_second_video(folder, ending):
    longer = ("-f", "lavfi", "-i", "testsrc=s=32x32:r=5:d=9")
    return made(*PICTURES, *longer, "-map", 0, "-map", 1, *H264, folder / f"in.{ending}")


def at_a_variable_rate(folder, ending):
    words = ("-vf", "setpts='if(lt(N,40),N,40+(N-40)*50)'", "-fps_mode", "vfr")
    return made(*PICTURES, *words, *H264, folder / f"in.{ending}")


def with_sound_that_lasts(folder, ending):
    sound = ("-f", "lavfi", "-i", "sine=r=48000:d=12")
    return made(*PICTURES, *sound, *H264, folder / f"in.{ending}")


def with_chapters_that_last(folder, ending):
    (folder / "m.txt").write_text(
        ";FFMETADATA1\n[CHAPTER]\nTIMEBASE=1/1\nSTART=0\nEND=30\ntitle=One\n"
    )
    words = ("-i", folder / "m.txt", "-map_metadata", 1)
    return made(*PICTURES, *words, *H264, folder / f"in.{ending}")


MAKERS = (
    later, with_edit_list, with_a_longer_second_video, at_a_variable_rate, with_sound_that_lasts,
    with_chapters_that_last,
)  # fmt: skip
WHOLE = [
    *((make, ending) for make in MAKERS for ending in ("mkv", "mp4", "mov", "ts", "avi", "nut")),
    *((with_long_subtitles, ending) for ending in ("mkv", "mp4", "mov")),
]


@pytest.mark.parametrize(("make", "ending"), WHOLE)
def test_complete_file_is_not_reported_as_truncated(make, ending, tmp_path):
    _, words = told(make(tmp_path, ending))
    assert "cut short" not in words


@pytest.mark.parametrize("ending", ["mkv", "mp4", "mov"])
@pytest.mark.parametrize("share", [0.4, 0.7])
def test_truncated_file_is_reported(ending, share, tmp_path):
    whole = made(*PICTURES, *SOUND, *H264, "-movflags", "+faststart", tmp_path / f"whole.{ending}")
    data = whole.read_bytes()
    cut = tmp_path / f"cut.{ending}"
    cut.write_bytes(data[: int(len(data) * share)])
    count, words = told(cut)
    assert count < 48
    assert "says that it lasts" in words, count
