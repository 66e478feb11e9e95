"""The recipes of docs/ffmpeg.md, with the real ffmpeg on both sides of the pipe."""

import re

import av
import numpy as np
import pytest
from support import shots
from support.folders import ROOT
from support.live_shot import FRAMES, pictures, shell, streams, succeeded
from support.programs import made

pytestmark = [pytest.mark.needs_gl, pytest.mark.needs_programs("ffmpeg", "ffprobe")]
PAGE = (ROOT / "docs" / "ffmpeg.md").read_text(encoding="utf-8")
LINES = dict(re.findall(r"^(ffmpeg .*? (\S+))$", PAGE, re.M))
BY_RESULT = {result: line for line, result in LINES.items()}
PQ = "setparams=range=tv:colorspace=bt2020nc:color_primaries=bt2020:color_trc=smpte2084"
KEYED = "format=yuva444p,geq=lum='lum(X,Y)':cb='cb(X,Y)':cr='cr(X,Y)':a='if(lt(X,160),0,255)'"


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """The files that the page speaks of."""
    folder = tmp_path_factory.mktemp("ffmpeg")
    plate = shots.write_video(folder / "in.mp4", frames=FRAMES)
    shots.cube_glb(folder / "anim.glb", end=(0.1, 0.0, -1.6))
    x265 = "-c:v libx265 -x265-params log-level=none".split()
    made("-i", plate, "-an", "-vf", f"{PQ},format=yuv420p10le", *x265, folder / "hdr.mkv")
    (folder / "words.srt").write_text("1\n00:00:00,000 --> 00:00:00,300\nsaid\n")
    (folder / "chapters.txt").write_text(
        ";FFMETADATA1\n[CHAPTER]\nTIMEBASE=1/1000\nSTART=0\nEND=200\ntitle=one\n"
    )
    maps = "-map 0:v -map 0:a -map 0:a -map 1:s -map_chapters 2 -c:v copy -c:a copy -c:s srt"
    made("-i", plate, "-i", folder / "words.srt", "-i", folder / "chapters.txt", *maps.split(),
         folder / "film.mkv")  # fmt: skip
    prores = "-c:v prores_ks -profile:v 4444 -pix_fmt yuva444p10le".split()
    made("-i", plate, "-an", "-vf", KEYED, *prores, folder / "key.mov")
    vp9 = "-c:v libvpx-vp9 -pix_fmt yuva420p -auto-alt-ref 0 -b:v 4M".split()
    made("-i", plate, "-an", "-vf", KEYED, *vp9, folder / "key.webm")
    return folder


@pytest.fixture
def run(folder):
    """Runs the line of the page that makes this file, and says what its streams are."""

    def made_by(result):
        succeeded(BY_RESULT[result], folder)
        return streams(folder / result)

    return made_by


def test_every_line_is_tried():
    assert set(BY_RESULT) == {
        "hdr-out.mkv", "film-out.mkv", "key-out.mov", "key-out.webm", "fast-out.mkv",
    }  # fmt: skip


def test_hdr_keeps_its_tags_and_its_bits(run, folder):
    (video,) = run("hdr-out.mkv")
    assert [video[name] for name in ("pix_fmt", "color_range", "color_space")] == [
        "yuv420p10le", "tv", "bt2020nc",
    ]  # fmt: skip
    assert (video["color_transfer"], video["color_primaries"]) == ("smpte2084", "bt2020")
    assert pictures(folder / "hdr-out.mkv") == ("hevc", FRAMES)


def test_hdr_tags_reach_the_compositor(folder):
    into = BY_RESULT["hdr-out.mkv"].split("|")[0]
    told = shell(f"{into} 2>/dev/null | nlens-video - anim.glb - --plan 1>&2", folder)
    said = told.stderr.decode()  # ffmpeg's pipe breaks, as nothing but the plan was asked for
    assert "matrix bt2020nc, transfer smpte2084, primaries bt2020, limited range" in said


def test_sound_subtitles_and_chapters_are_those_of_the_film(run, folder):
    found = run("film-out.mkv")
    kinds = [stream["codec_type"] for stream in found]
    assert kinds == ["video", "audio", "audio", "subtitle"]
    assert shots.audio_packets(folder / "film-out.mkv") == shots.audio_packets(folder / "film.mkv")
    with av.open(str(folder / "film-out.mkv")) as container:
        assert [chapter["metadata"]["title"] for chapter in container.chapters()] == ["one"]


@pytest.mark.parametrize("result", ["key-out.mov", "key-out.webm"])
def test_alpha_of_the_plate_stays_and_the_object_is_added(result, run, folder):
    run(result)
    before, after = (_rgba(folder / name) for name in (result.replace("-out", ""), result))
    assert len(after) == len(before) == FRAMES
    alpha, made_alpha = before[0][..., 3].astype(int), after[0][..., 3].astype(int)
    assert (alpha[:, 180:] > 250).all() and (alpha[:, :140] < 5).all()
    assert np.abs(made_alpha - alpha).mean() < 2
    changed = np.abs(after[0][..., :3].astype(int) - before[0][..., :3]).max(axis=2) > 40
    assert 0.005 < changed[:, 180:].mean() < 0.3


def _rgba(path):
    """Frames of a file with alpha, read by the ffmpeg program."""
    reader = ["-c:v", "libvpx-vp9"] if path.suffix == ".webm" else []
    raw = made(*reader, "-i", path, "-pix_fmt", "rgba", "-f", "rawvideo", path.with_suffix(".rgba"))
    return np.fromfile(raw, np.uint8).reshape(-1, shots.HEIGHT, shots.WIDTH, 4)


def test_hardware_decoder_is_used_where_there_is_one(run, folder):
    run("fast-out.mkv")
    assert pictures(folder / "fast-out.mkv") == ("h264", FRAMES)


BY_NAME = re.findall(r"`(-hwaccel|-c:v) (\w+)` ?\|", PAGE)
LACKING = (  # a card, or in this FFmpeg a decoder
    "No device available|Cannot load libnvcuvid|initializing an MFX|find a valid device|"
    "Unknown decoder"
)


def test_every_name_of_a_hardware_decoder_is_tried():
    assert len(BY_NAME) == PAGE.count("`-hwaccel ") - 1 + PAGE.count("`-c:v h264_")  # - 1: auto


@pytest.mark.parametrize(("option", "name"), BY_NAME)
def test_hardware_decoder_by_name_decodes_or_says_what_is_missing(option, name, folder):
    reader = BY_RESULT["fast-out.mkv"].split("|")[0].replace("-hwaccel auto", f"{option} {name}")
    run = "nlens-video - anim.glb named.mkv --preset realtime -y"
    told = shell(f'{reader} 2>reader.txt | {run}; echo "${{PIPESTATUS[1]}}"', folder)
    said = (folder / "reader.txt").read_text()
    if said:
        assert re.search(LACKING, said), said
        assert told.stdout.split()[-1] == b"3", told.stderr
    else:
        assert pictures(folder / "named.mkv") == ("h264", FRAMES)
