"""Codecs that ffmpeg can copy into a container are kept."""

import itertools

import pytest
from support.clips import copy
from support.programs import codecs, complaints, ffmpeg, made, streams

pytestmark = pytest.mark.needs_programs("ffmpeg", "ffprobe")
CONTAINERS = (
    "mp4", "mov", "mkv", "webm", "ts", "m2ts", "mxf", "avi", "mpg", "flv", "3gp", "nut", "ogv",
    "wmv", "gif",
)  # fmt: skip
VIDEO = {
    "h264": "libx264 -preset ultrafast -pix_fmt yuv420p",
    "hevc": "libx265 -preset ultrafast -x265-params log-level=none -pix_fmt yuv420p",
    "vp9": "libvpx-vp9 -deadline realtime -cpu-used 8 -pix_fmt yuv420p",
    "av1": "libaom-av1 -usage realtime -cpu-used 8 -pix_fmt yuv420p",
    "mpeg2video": "mpeg2video -pix_fmt yuv420p",
    "prores": "prores_ks -pix_fmt yuv422p10le",
    "dnxhd": "dnxhd -profile:v dnxhr_sq -pix_fmt yuv422p",
    "ffv1": "ffv1 -pix_fmt yuv420p",
}
AUDIO = {
    "aac": "aac", "ac3": "ac3", "opus": "libopus", "flac": "flac", "pcm_s16le": "pcm_s16le",
    "mp3": "libmp3lame",
}  # fmt: skip
REFUSED = {
    ("mov", "ffv1"), ("mkv", "dnxhd"), ("avi", "prores"), ("avi", "dnxhd"), ("nut", "prores"),
    ("nut", "dnxhd"),
}  # fmt: skip
"""PyAV asks FFmpeg's table of a container, which lacks these; the ffmpeg program does not ask."""


@pytest.fixture(scope="module")
def plates(tmp_path_factory):
    """A clip of each video codec, and one of each audio codec."""
    folder = tmp_path_factory.mktemp("plates")
    files = {}
    for name, words in VIDEO.items():
        ending = "mov" if name in ("prores", "dnxhd") else "mkv"
        files[name] = made(
            "-f", "lavfi", "-i", "testsrc2=s=352x288:r=25", "-frames:v", 3, "-c:v", *words.split(),
            folder / f"{name}.{ending}",
        )  # fmt: skip
    for name, encoder in AUDIO.items():
        files[name] = made(
            "-f", "lavfi", "-i", "sine=r=48000:d=0.3", "-ac", 2, "-c:a", encoder,
            folder / f"{name}.mka",
        )  # fmt: skip
    return files


def copied_by_ffmpeg(name, plates, container, folder):
    """Whether the ffmpeg program copies a codec into a container and finds it there again."""
    kind = "video" if name in VIDEO else "audio"
    beside = ("-i", plates["mpeg2video"], "-map", 1, "-map", 0)
    words = beside if container == "mxf" and kind == "audio" else ()
    out = folder / f"theirs_{name}.{container}"
    run = ffmpeg("-i", plates[name], *words, "-c", "copy", out)
    return run.returncode == 0 and codecs(out).get(kind) == name and not complaints(out)


def together(video, audio, plates):
    """A plate of a video codec and an audio codec, in Matroska or else in MOV."""
    folder = plates[video].parent
    done = [*folder.glob(f"{video}_{audio}.*")]
    if done:
        return done[0]
    for ending in ("mkv", "mov"):
        out = folder / f"{video}_{audio}.{ending}"
        words = ("-i", plates[video], "-i", plates[audio], "-map", 0, "-map", 1, "-c", "copy")
        if ffmpeg(*words, "-strict", "-2", out).returncode == 0:
            return out
        out.unlink(missing_ok=True)
    raise AssertionError(f"nothing holds {video} and {audio}")


@pytest.mark.parametrize("container", CONTAINERS)
def test_codec_of_the_plate_is_kept_where_the_container_supports_it(container, plates, tmp_path):
    theirs = {name: copied_by_ffmpeg(name, plates, container, tmp_path) for name in plates}
    for video, audio in itertools.product(VIDEO, AUDIO):
        plate = together(video, audio, plates)
        out = tmp_path / f"{video}_{audio}.{container}"
        notes = " ".join(copy(plate, out))
        found = codecs(out)
        if (container, audio) != ("wmv", "flac"):  # the ffmpeg program's own copy has these, too
            assert not complaints(out), (video, audio)
        for kind, name in (("video", video), ("audio", audio)):
            if theirs[name] and (container, name) not in REFUSED:
                assert found[kind] == name, (video, audio, notes)
            elif found.get(kind) != name:
                assert f"source's {name}" in notes or f"({kind}) " in notes, (video, audio, notes)
        assert len(found) == (1 if container == "gif" else 2), (video, audio, notes)


@pytest.mark.parametrize(
    ("plate", "container", "kept"),
    [
        ("h264", "ts", {"video": "h264", "audio": "aac"}),
        ("h264", "m2ts", {"video": "h264", "audio": "aac"}),
        ("h264", "mxf", {"video": "h264", "audio": "pcm_s24le"}),
        ("dnxhd", "mxf", {"video": "dnxhd", "audio": "pcm_s24le"}),
        ("h264", "mpg", {"video": "mpeg2video", "audio": "mp2"}),
    ],
)
def test_broadcast_containers_get_their_standard_codecs(plate, container, kept, plates, tmp_path):
    source = together(plate, "aac", plates)
    copy(source, tmp_path / f"out.{container}")
    assert codecs(tmp_path / f"out.{container}") == kept
    assert complaints(tmp_path / f"out.{container}") == ""


@pytest.mark.parametrize("container", ["mov", "mxf"])
@pytest.mark.parametrize(
    ("profile", "pixel_format"), [("dnxhr_hqx", "yuv422p10le"), ("dnxhr_444", "yuv444p10le")]
)
def test_deep_dnxhr_is_kept(container, profile, pixel_format, tmp_path):
    pictures = ("-f", "lavfi", "-i", "testsrc2=s=352x288:r=25", "-frames:v", 3)
    words = ("-c:v", "dnxhd", "-profile:v", profile, "-pix_fmt", pixel_format)
    plate = made(*pictures, *words, tmp_path / "in.mov")
    assert copy(plate, tmp_path / f"out.{container}") == ()
    found = streams(tmp_path / f"out.{container}")[0]
    assert (found["codec_name"], found["pix_fmt"]) == ("dnxhd", pixel_format)


@pytest.mark.parametrize("container", ["ts", "mkv", "mp4"])
def test_dts_audio_without_an_encoder_is_copied(container, plates, tmp_path):
    sound = ("-f", "lavfi", "-i", "sine=r=48000:d=0.5", "-ac", 2, "-c:a", "dca", "-strict", -2)
    plate = made("-i", plates["h264"], *sound, "-c:v", "copy", tmp_path / "in.mkv")
    assert not copy(plate, tmp_path / f"out.{container}")
    assert codecs(tmp_path / f"out.{container}") == {"video": "h264", "audio": "dts"}


@pytest.mark.parametrize(
    ("encoder", "pixel_format"),
    [
        ("libx264", "yuv420p"), ("libx264", "yuv420p10le"), ("libx264", "yuv444p10le"),
        ("libx265", "yuv422p12le"), ("ffv1", "yuv420p14le"), ("ffv1", "gray16le"),
        ("ffv1", "bgra"), ("prores_ks", "yuva444p10le"), ("ffv1", "gbrp10le"),
    ],
)  # fmt: skip
def test_matroska_is_found_to_hold_pictures_of_any_sample_depth(encoder, pixel_format):
    """x264 ends the whole process on samples beyond the depth."""
    from nlens_video.video.output.containers import holds_video

    assert holds_video("matroska", encoder, pixel_format)


def test_pairs_that_need_no_trial_pass_one(monkeypatch):
    from nlens_video.video.output import containers

    usual = containers._USUAL
    monkeypatch.setattr(containers, "_USUAL", frozenset())
    for container, encoder in sorted(usual):
        tried = (
            containers.holds_audio.__wrapped__(container, encoder)
            if encoder == "aac"
            else containers.holds_video.__wrapped__(container, encoder, "yuv420p")
        )
        assert tried, (container, encoder)
