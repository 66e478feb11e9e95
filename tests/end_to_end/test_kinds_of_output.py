"""Output formats by the extension of OUT."""

import av
import pytest
from support.clips import copy, noise_frame, write_clip
from support.command import nlens, one_line
from support.shots import cube_glb, fit_json, write_video

from nlens_video.core.errors import OutputError, UsageError
from nlens_video.video.output.sink import check_output


@pytest.mark.parametrize("ending", ["mp3", "wav", "aac", "srt", "mka", "flac", "vtt"])
def test_audio_only_output_format_is_refused_in_one_line(tmp_path, ending):
    plate = write_video(tmp_path / "in.mp4", frames=2)
    glb, fit = cube_glb(tmp_path / "a.glb"), fit_json(tmp_path / "fit.json")
    run = nlens(plate, glb, tmp_path / f"out.{ending}", "--fit", fit, "--preset", "draft")
    assert f".{ending} files hold no video; try .mp4" in one_line(run, 6)


@pytest.mark.parametrize(
    ("name", "options", "error", "words"),
    [
        ("out.mp3", {}, OutputError, "hold no video"),
        ("out.xyz", {}, OutputError, "nothing writes this extension"),
        ("out.m3u8", {}, OutputError, r"hls writes several files; give - as OUT, then \| ffmpeg"),
        ("out.mpd", {}, OutputError, "dash writes several files"),
        ("out.chk", {}, OutputError, "webm_chunk writes several files"),
        ("no/out.mp4", {}, OutputError, "does not exist"),
        ("out.mp4", {"codec": "h265x"}, UsageError, "no such encoder"),
        ("out.mp4", {"codec": "aac"}, UsageError, "encodes audio"),
        ("out.mp4", {"codec": "prores"}, UsageError, "mp4 does not hold it"),
        ("out.mpg", {"codec": "h264"}, UsageError, "mpeg does not hold it"),
        ("out.mp4", {"codec": "h264", "crf": 999.0}, UsageError, "takes 0 .best. to 51"),
        ("out.mkv", {"codec": "ffv1", "crf": 3.0}, UsageError, "ffv1 has no crf"),
        ("out.mp4", {"pix_fmt": "yuv999p"}, UsageError, "no such pixel format"),
        ("out_%04d.png", {"crf": 3.0}, UsageError, "has no such choice"),
    ],
)
def test_unwritable_output_format_is_refused_before_any_file_is_opened(
    tmp_path, name, options, error, words
):
    with pytest.raises(error, match=words) as caught:
        check_output(str(tmp_path / name), **options)
    assert "\n" not in str(caught.value)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", ["out.mp4", "out.ts", "out.apng", "out.png", "o_%04d.exr", "-"])
def test_writable_output_formats_pass_the_early_check(tmp_path, name):
    check_output(name if name == "-" else str(tmp_path / name))


@pytest.mark.parametrize("ending", ["apng", "gif", "webp"])
def test_video_is_written_as_an_animated_picture(tmp_path, ending):
    clip = write_clip(tmp_path / "in.mkv", [noise_frame(64, 48, "yuv420p", s) for s in range(3)])
    copy(clip, tmp_path / f"out.{ending}")
    if ending == "webp":  # FFmpeg writes animations of this kind, but reads their first chunk only
        assert (tmp_path / "out.webp").read_bytes().count(b"ANMF") == 3
        return
    with av.open(str(tmp_path / f"out.{ending}")) as out:
        assert sum(1 for _ in out.decode(video=0)) == 3


@pytest.mark.parametrize("ending", ["yuv", "rgb"])
def test_raw_file_holds_raw_frames(tmp_path, ending):
    made = [noise_frame(64, 48, "yuv420p", seed) for seed in range(3)]
    clip = write_clip(tmp_path / "in.mkv", made, audio=True)
    notes = " ".join(copy(clip, tmp_path / f"out.{ending}"))
    assert (tmp_path / f"out.{ending}").stat().st_size == 3 * 64 * 48 * 3 // 2
    assert "stream 1 (audio) is left out" in notes


@pytest.mark.parametrize("ending", ["m3u8", "mpd"])
def test_result_of_several_files_is_refused_before_one_is_made(tmp_path, ending):
    clip = write_clip(tmp_path / "in.mkv", [noise_frame(64, 48, "yuv420p")])
    with pytest.raises(OutputError, match="writes several files"):
        copy(clip, tmp_path / f"out.{ending}")
    assert [one.name for one in tmp_path.iterdir()] == ["in.mkv"]
