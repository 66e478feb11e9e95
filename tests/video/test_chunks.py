"""Chunks of a run, merged, are the run; what does not fit together is refused."""

import json
import re
import subprocess
import sys
from fractions import Fraction
from pathlib import Path

import av
import numpy as np
import pytest
from support import shots
from support.folders import ROOT

from nlens_video.cli.main import main
from nlens_video.core.errors import InputError, UsageError
from nlens_video.video.chunk_file import ChunkFile, ChunkWriter, carrier, fill
from nlens_video.video.chunk_queue import ChunkFeed, ChunkMark
from nlens_video.video.info import SourceFrame, SourceInfo
from nlens_video.video.pixels.picture import AvPicture
from nlens_video.video.pixels.pixel_formats import layout
from nlens_video.video.pixels.samples import frame_tags

FRAMES = 12


def varied(folder):
    """A plate that gets brighter, at uneven times, with sound; a cube that slides and turns up."""
    pts = [90 * (1000 + 40 * number + 7 * (number % 3)) for number in range(FRAMES)]
    writer = shots.write_video(folder / "steady.mp4", FRAMES, pts=pts, time_base=Fraction(1, 90000))
    brighter(writer, folder / "in.mp4")
    shots.cube_glb(folder / "anim.glb", start=(-0.3, 0.0, -1.6), end=(0.3, 0.0, -1.4), seconds=0.5)
    shots.fit_json(folder / "fit.json")
    return folder


def brighter(source, target):
    """A copy whose light grows by a quarter, sound and times kept."""
    with av.open(str(source)) as given, av.open(str(target), "w") as made:
        video, tones = given.streams.video[0], given.streams.audio[0]
        out = made.add_stream("libx264", 25, {"crf": "12", "preset": "ultrafast"})
        out.width, out.height, out.pix_fmt = video.width, video.height, "yuv420p"
        out.time_base = out.codec_context.time_base = video.time_base
        sound = made.add_stream_from_template(tones)
        made.metadata["title"] = "a title"
        number = 0
        for packet in given.demux(video, tones):
            if packet.stream is tones and packet.dts is not None:
                packet.stream = sound
                made.mux(packet)
                continue
            for frame in packet.decode() if packet.stream is video else ():
                array = frame.to_ndarray(format="rgb24").astype(np.float32)
                gained = np.uint8(np.clip(array * (1.0 + 0.25 * number / FRAMES), 0, 255))
                bright = av.VideoFrame.from_ndarray(gained, "rgb24").reformat(format="yuv420p")
                bright.pts, bright.time_base = frame.pts, frame.time_base
                made.mux(out.encode(bright))
                number += 1
        made.mux(out.encode())
    return target


@pytest.fixture(scope="module")
def shot(tmp_path_factory):
    return varied(tmp_path_factory.mktemp("shot"))


def arguments(folder, out, *more):
    return [
        str(folder / "in.mp4"), str(folder / "anim.glb"), str(out),
        "--fit", str(folder / "fit.json"), "--preset", "realtime", "-q", *more,
    ]  # fmt: skip


def chunked(folder, chunks, *ranges):
    for text in ranges:
        assert main(arguments(folder, chunks, "--as-chunk", "--range", text)) == 0


def merged(folder, out, chunks, *more):
    given = [str(path) for path in (chunks if isinstance(chunks, list) else [chunks])]
    return main(["merge", str(out), *given, "--from", str(folder / "in.mp4"), "-q", *more])


@pytest.fixture(scope="module")
def whole(shot):
    out = shot / "whole.mkv"
    assert main(arguments(shot, out, "--codec", "ffv1")) == 0
    return out


@pytest.fixture(scope="module")
def pieces(shot):
    chunked(shot, shot / "pieces", "0:5", "5:6", "6:")
    return sorted((shot / "pieces").glob("*.nut"))


@pytest.mark.slow
@pytest.mark.needs_gl
def test_merged_chunks_equal_the_single_run_bit_for_bit(shot, whole, pieces):
    out = shot / "merged.mkv"
    assert merged(shot, out, pieces[::-1], "--codec", "ffv1") == 0
    shots.assert_same_frames(whole, out)
    assert shots.audio_packets(out) == shots.audio_packets(whole) != []
    with av.open(str(out)) as container:
        assert container.metadata["title"] == "a title"
    plate = shots.read_planes(shot / "in.mp4")
    result = shots.read_planes(out)
    assert any((a != b).any() for a, b in zip(plate[11][1], result[11][1], strict=True))


@pytest.mark.needs_gl
def test_exposure_tracking_in_a_range_equals_that_of_the_whole_run(shot, whole):
    """Brighter light on the object, counted from the plate's first frame and not the range's."""
    part, plain = shot / "part.mkv", shot / "plain.mkv"
    assert main(arguments(shot, part, "--codec", "ffv1", "--range", "11:")) == 0
    for before, after in zip(
        shots.read_planes(whole)[11][1], shots.read_planes(part)[0][1], strict=True
    ):
        np.testing.assert_array_equal(before, after)
    unfollowed = ("--codec", "ffv1", "--effects", "defocus", "--range", "11:")
    assert main(arguments(shot, plain, *unfollowed)) == 0
    assert (shots.read_planes(plain)[0][1][0] != shots.read_planes(part)[0][1][0]).any()


@pytest.mark.slow
@pytest.mark.needs_gl
@pytest.mark.parametrize("sun", [True, False])
def test_every_effect_in_a_range_equals_that_of_the_whole_run(shot, tmp_path, sun):
    """With no sun the light is guessed from the plate's first frame."""
    for name in ("in.mp4", "fit.json"):
        (tmp_path / name).write_bytes((shot / name).read_bytes())
    slide = {"start": (-0.3, 0.0, -1.6), "end": (0.3, 0.0, -1.4), "seconds": 0.5}
    shots.cube_glb(tmp_path / "anim.glb", sun=sun, **slide)
    asked = ("--codec", "ffv1", "--preset", "standard", "--occlusion", "auto")
    asked += ("--reflect", "0.3") if sun else ()
    assert main(arguments(tmp_path, tmp_path / "all.mkv", *asked)) == 0
    assert main(arguments(tmp_path, tmp_path / "part.mkv", *asked, "--range", "10:12")) == 0
    both = zip(
        shots.read_planes(tmp_path / "all.mkv")[10:],
        shots.read_planes(tmp_path / "part.mkv"),
        strict=True,
    )
    for (_, planes), (_, also) in both:
        for plane, other in zip(planes, also, strict=True):
            np.testing.assert_array_equal(plane, other)


@pytest.mark.needs_gl
def test_existing_chunk_is_not_rendered_again(shot, pieces, capsys):
    before = pieces[0].stat()
    again = arguments(shot, shot / "pieces", "--as-chunk", "--range", "0:5", "--json")
    assert main(again) == 0
    assert json.loads(capsys.readouterr().out) == {"chunk": str(pieces[0]), "outcome": None}
    assert pieces[0].stat().st_mtime_ns == before.st_mtime_ns


@pytest.mark.needs_gl
def test_chunk_name_depends_on_content_and_not_on_paths(shot, pieces, tmp_path):
    for name in ("in.mp4", "anim.glb", "fit.json"):
        (tmp_path / name).write_bytes((shot / name).read_bytes())
    chunked(tmp_path, tmp_path / "chunks", "5:6")
    assert [path.name for path in (tmp_path / "chunks").glob("*.nut")] == [pieces[1].name]
    assert main(arguments(tmp_path, tmp_path / "chunks", "--as-chunk", "--range", "5:6",
                      "--ground-y", "0.01")) == 0  # fmt: skip
    assert len(list((tmp_path / "chunks").glob("*.nut"))) == 2


@pytest.mark.slow
@pytest.mark.needs_gl
def test_all_files_of_a_folder_of_chunks_can_be_named(shot, whole, pieces, tmp_path):
    """As a shell does for `merge OUT chunks/*`: what lies beside the chunks is left out."""
    everything = sorted((shot / "pieces").iterdir())
    assert len(everything) > len(pieces)
    assert merged(shot, tmp_path / "o.mkv", everything, "--codec", "ffv1") == 0
    shots.assert_same_frames(whole, tmp_path / "o.mkv")


@pytest.mark.needs_gl
def test_merge_of_no_chunk_is_refused(shot, tmp_path, capsys):
    (tmp_path / "fit.json").touch()
    assert merged(shot, tmp_path / "never.mkv", [tmp_path / "fit.json"]) == 2
    assert "is no chunk (*.nut)" in one_line(capsys)


@pytest.mark.needs_gl
@pytest.mark.parametrize(
    ("left_out", "says"),
    [
        (0, "frames 0 to 4 are missing"), (1, "frames 5 to 5 are missing"),
        (2, "frames 6 and on are missing"),
    ],
)  # fmt: skip
def test_merge_refuses_a_missing_chunk(shot, pieces, capsys, left_out, says):
    some = [path for at, path in enumerate(pieces) if at != left_out]
    assert merged(shot, shot / "never.mkv", some) == 2
    assert one_line(capsys).startswith(f"nlens-video: {says}")
    assert not (shot / "never.mkv").exists()


@pytest.mark.needs_gl
def test_merge_refuses_overlapping_mismatched_or_damaged_chunks(shot, pieces, tmp_path, capsys):
    out = shot / "never.mkv"
    chunked(shot, tmp_path / "more", "4:6")
    (more,) = (tmp_path / "more").glob("*.nut")
    assert merged(shot, out, [*pieces, more]) == 2
    assert "overlap: both hold frame 4" in one_line(capsys)
    assert main(arguments(shot, tmp_path / "other", "--as-chunk", "--range", "5:6",
                      "--effects", "defocus")) == 0  # fmt: skip
    (other,) = (tmp_path / "other").glob("*.nut")
    assert merged(shot, out, [pieces[0], other, pieces[2]]) == 2
    assert "different settings" in one_line(capsys)
    foreign = shots.write_video(tmp_path / "in.mp4", FRAMES)
    assert main(["merge", str(out), *map(str, pieces), "--from", str(foreign), "-q"]) == 2
    assert "from another plate" in one_line(capsys)
    assert merged(shot, out, [shot / "whole.mkv"]) == 3
    assert "is no chunk" in one_line(capsys)
    for name, hurt in (("cut", cut), ("altered", altered)):
        bad = tmp_path / f"{name}.nut"
        bad.write_bytes(hurt(pieces[0].read_bytes()))
        assert merged(shot, out, [bad, *pieces[1:]]) == 3, name
        assert "render" in one_line(capsys)
    assert not out.exists()


def cut(data):
    return data[: len(data) // 2]


def altered(data):
    middle = len(data) // 2
    return data[:middle] + bytes([data[middle] ^ 0xFF]) + data[middle + 1 :]


def one_line(capsys):
    said = capsys.readouterr().err
    assert said.count("\n") == 1 and said.startswith("nlens-video: "), said
    return said


@pytest.mark.needs_gl
def test_invalid_chunk_options_are_refused(shot, tmp_path, capsys):
    given = [str(shot / "in.mp4"), str(shot / "anim.glb"), str(tmp_path / "c"), "--as-chunk"]
    assert main(given) == 2
    assert "give --fit" in one_line(capsys)
    fit = ("--fit", str(shot / "fit.json"))
    assert main([*given, *fit, "--crf", "20"]) == 2
    assert "give the encoding to merge" in one_line(capsys)
    assert main(["-", *given[1:], *fit]) == 2
    assert "record the stream" in one_line(capsys)


@pytest.mark.slow
@pytest.mark.needs_gl
def test_documented_chunk_loop_equals_the_single_run(shot, tmp_path):
    page = (ROOT / "docs" / "farm.md").read_text()
    script = re.search(r"```bash\n(.*?)```", page, re.DOTALL)[1]
    script = script.replace("frames=1500", f"frames={FRAMES}").replace("length=250", "length=7")
    script = script.replace("out.mp4 chunks", "out.mkv chunks --codec ffv1")
    for name in ("in.mp4", "anim.glb"):
        (tmp_path / name).write_bytes((shot / name).read_bytes())
    head = f'set -e\nnlens-video() {{ {sys.executable} -m nlens_video "$@" -q; }}\n'
    subprocess.run(["bash", "-c", head + script], cwd=tmp_path, check=True)
    given = [str(tmp_path / name) for name in ("in.mp4", "anim.glb", "one.mkv")]
    assert main([*given, "--codec", "ffv1", "-q"]) == 0
    shots.assert_same_frames(tmp_path / "one.mkv", tmp_path / "out.mkv")


CARRIED = [name for name in sorted(av.video.format.names) if layout(name) is not None]
NOT_CARRIED = {
    "bgra64le", "gbrap32le", "gbrapf16le", "gbrapf32le", "gbrpf16le", "gbrpf32le", "gray32le",
    "grayf32le", "rgbaf32le", "rgbf32le", "ya16le", "yaf32le",
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("size", [(40, 24), (41, 25), (1, 1), (67, 129), (66, 130)])
@pytest.mark.parametrize("name", CARRIED)
def test_chunk_is_lossless_for_every_format_size_and_time(name, size, tmp_path):
    width, height = size
    if name in NOT_CARRIED:
        with pytest.raises(UsageError, match="no lossless chunks"):
            carrier(name, width, height)
        return
    rng = np.random.default_rng(3)
    base, start = Fraction(1, 90000), 10**10 + 1
    given = []
    for _ in range(3):
        frame = av.VideoFrame(width, height, name)
        for view in samples(frame):
            peak = 2 ** layout(name).bits
            view[...] = rng.integers(0, peak, view.shape).astype(view.dtype)
        given.append(frame)
    info = SourceInfo(
        name="plate", kind="video", width=width, height=height, time_base=base, codec="x",
        average_rate=Fraction(30000, 1001), frame_count=3, duration_s=None, pixel_format=name,
        tags=frame_tags(given[0]),
    )  # fmt: skip
    mark = ChunkMark(key="k", plate="p", first=7, end=10)
    with ChunkWriter(tmp_path, info, queue_of(mark)) as sink:
        for number, frame in enumerate(given):
            pts = start + 3003 * number + number % 2
            sink.write(
                SourceFrame(
                    index=7 + number,
                    pts=pts,
                    time_base=base,
                    time_s=0.0,
                    duration=3003,
                    picture=AvPicture(frame),
                )  # fmt: skip
            )
        sink.commit()
    chunk = ChunkFile(tmp_path / mark.file_name)
    assert chunk.mark == mark
    carried = list(chunk.frames())
    assert [frame.pts * frame.time_base for frame in carried] == [
        (start + 3003 * number + number % 2) * base for number in range(3)
    ]
    for frame, read in zip(given, carried, strict=True):
        empty = AvPicture(av.VideoFrame(width, height, name))
        fill(empty, read)
        for before, after in zip(components(frame), components(empty.frame), strict=True):
            np.testing.assert_array_equal(before, after)


def queue_of(mark):
    queue = ChunkFeed([mark])
    queue.next()
    return queue


def samples(frame):
    kind = layout(frame.format.name)
    for plane in frame.planes:
        rows = np.frombuffer(memoryview(plane), kind.dtype).reshape(plane.height, -1)
        yield rows[:, : plane.width * kind.channels]


def components(frame):
    """The samples that mean something: not the fourth byte of rgb0."""
    kind, rows = layout(frame.format.name), list(samples(frame))
    return [rows[plane][:, place :: kind.channels] for plane, place in kind.components]


@pytest.mark.parametrize(
    "base",
    [Fraction(1, 25), Fraction(1001, 30000), Fraction(1, 1000), Fraction(1, 12800), Fraction(2, 3)],
)
def test_long_chunk_is_read_exactly_to_its_end(tmp_path, base):
    picture = AvPicture(av.VideoFrame(64, 48, "gray"))
    info = SourceInfo(
        name="plate", kind="video", width=64, height=48, time_base=base, codec="x",
        average_rate=Fraction(25), frame_count=700, duration_s=None, pixel_format="gray",
        tags=picture.tags,
    )  # fmt: skip
    mark = ChunkMark(key="k", plate="p", first=0, end=None)
    with ChunkWriter(tmp_path, info, queue_of(mark)) as s:
        for at in range(700):
            s.write(
                SourceFrame(
                    index=at, pts=at, time_base=base, time_s=at / 25, duration=1, picture=picture
                )
            )
        s.commit()
    chunk = ChunkFile(tmp_path / mark.file_name)
    assert chunk.count == 700
    moments = [frame.pts * frame.time_base for frame in chunk.frames()]
    assert moments == [at * base for at in range(700)]


def test_unreadable_chunk_is_refused(tmp_path):
    (tmp_path / "a.nut").write_text("not a chunk")
    with pytest.raises(InputError, match="is no chunk"):
        ChunkFile(Path(tmp_path / "a.nut"))
