"""Through real codecs and containers: times to the tick, other streams to the byte, errors."""

import subprocess
import sys
from fractions import Fraction

import av
import numpy as np
import pytest
from support.clips import (
    VFR,
    copy,
    noise_frame,
    planes,
    read_packets,
    read_times,
    write_clip,
    write_plates,
)
from support.folders import TESTS

from nlens_video.core.errors import InputError, OutputError, UsageError
from nlens_video.core.layers import Box
from nlens_video.video.atomic_files import partial_name
from nlens_video.video.exr import write_layers
from nlens_video.video.input.source import open_source
from nlens_video.video.output.sink import open_sink
from nlens_video.video.times.encoder_clocks import EncoderClock


def frames(path):
    with av.open(str(path)) as source:
        return [planes(frame) for frame in source.decode(video=0)]


@pytest.fixture
def noise():
    return [noise_frame(64, 48, "yuv420p", seed) for seed in range(len(VFR))]


@pytest.mark.parametrize("start", [0, 8003])
@pytest.mark.parametrize("extension", ["mp4", "mov", "mkv"])
def test_times_of_a_variable_rate_clip_are_kept_exactly(tmp_path, noise, extension, start):
    base = Fraction(1, 1000 if extension == "mkv" else 16000)
    pts = [start + moment for moment in VFR]
    clip = write_clip(
        tmp_path / f"in.{extension}", noise, codec="libx264", pts=pts, time_base=base
    )  # fmt: skip
    times = read_times(clip)
    assert [time - times[0] for time in times] == [moment * base for moment in VFR]
    copy(clip, tmp_path / f"out.{extension}")
    assert read_times(tmp_path / f"out.{extension}") == times


def test_last_frame_keeps_its_duration_in_mp4(tmp_path, noise):
    clip = write_clip(tmp_path / "in.mp4", noise, codec="libx264")
    copy(clip, tmp_path / "out.mp4")
    with av.open(str(clip)) as first, av.open(str(tmp_path / "out.mp4")) as second:
        lengths = [one.streams.video[0].duration * one.streams.video[0].time_base
                   for one in (first, second)]  # fmt: skip
    assert lengths[0] == lengths[1]


@pytest.mark.parametrize("extension", ["mp4", "mkv"])
def test_audio_packets_are_copied_byte_for_byte(tmp_path, noise, extension):
    clip = write_clip(tmp_path / "in.mp4", noise, codec="libx264", audio=True)
    assert len(read_packets(clip)) > 15
    copy(clip, tmp_path / f"out.{extension}")
    assert read_packets(tmp_path / f"out.{extension}") == read_packets(clip)


def test_unsupported_audio_is_reencoded_with_a_note(tmp_path, noise):
    clip = write_clip(tmp_path / "in.mp4", noise, codec="libx264", audio=True)
    notes = copy(clip, tmp_path / "out.webm")
    assert any("audio" in note and "libopus" in note for note in notes)
    with av.open(str(tmp_path / "out.webm")) as out:
        assert sum(frame.samples for frame in out.decode(audio=0)) > 19000


@pytest.mark.parametrize("pixel_format", ["yuv420p", "yuv422p10le", "yuv444p", "gray", "gbrp12le"])
@pytest.mark.parametrize("size", [(64, 48), (37, 27)])
def test_pixels_beside_the_object_keep_their_bits_through_ffv1(tmp_path, pixel_format, size):
    made = [noise_frame(*size, pixel_format, seed) for seed in range(4)]
    clip = write_clip(tmp_path / "in.mkv", made)
    copy(clip, tmp_path / "out.mkv", box=Box(8, 8, 20, 20))
    wide = 2 if pixel_format.endswith("le") else 1
    for before, after in zip(frames(clip), frames(tmp_path / "out.mkv"), strict=True):
        for old, new in zip(before, after, strict=True):
            x, y = old.shape[1] / size[0], old.shape[0] / size[1]
            beside = np.ones(old.shape, bool)
            scale = 1 if x / wide > 0.9 else 2
            rows = 1 if y > 0.9 else 2
            beside[8 // rows : 20 // rows, 8 // scale * wide : 20 // scale * wide] = False
            np.testing.assert_array_equal(old[beside], new[beside])
            assert (old != new).any()


def test_compositing_does_not_modify_the_decoders_reference_frames(tmp_path):
    still = noise_frame(64, 48, "yuv420p")
    made = [still.reformat(format="yuv444p").reformat(format="yuv420p") for _ in range(12)]
    clip = write_clip(tmp_path / "in.mp4", made, codec="libx264", options={"qp": "0"})
    copy(clip, tmp_path / "out.mkv", box=Box(0, 0, 16, 16), codec="ffv1")
    for before, after in zip(frames(clip), frames(tmp_path / "out.mkv"), strict=True):
        np.testing.assert_array_equal(before[0][:, 16:], after[0][:, 16:])


@pytest.mark.parametrize("rotation", [90, 180, -90])
def test_rotated_clip_is_read_upright_and_written_rotated(tmp_path, rotation):
    made = [noise_frame(64, 48, "yuv420p")]
    clip = write_clip(tmp_path / "in.mp4", made, codec="libx264", rotation=rotation)
    with open_source(str(clip)) as source:
        turned = abs(rotation) == 90
        assert (source.info.width, source.info.height) == ((48, 64) if turned else (64, 48))
        assert source.info.orientation.rotation % 360 == rotation % 360
    copy(clip, tmp_path / "out.mp4", box=Box(0, 0, 8, 8))
    with open_source(str(tmp_path / "out.mp4")) as out:
        assert out.info.orientation.rotation % 360 == rotation % 360
        assert out.info.stored_size == (64, 48)
    copy(clip, tmp_path / "out_%04d.png")
    with open_source(str(clip)) as one, open_source(str(tmp_path / "out_%04d.png")) as other:
        assert (other.info.width, other.info.height) == (one.info.width, one.info.height)


def test_colour_tags_and_aspect_ratio_are_kept(tmp_path):
    frame = noise_frame(64, 48, "yuv420p10le")
    frame.colorspace, frame.color_range = 9, 1
    frame.color_primaries, frame.color_trc = 9, 16
    clip = write_clip(tmp_path / "in.mkv", [frame])
    copy(clip, tmp_path / "out.mp4", codec="libx265")
    with open_source(str(tmp_path / "out.mp4")) as out:
        tags = out.info.frame_tags
        assert (tags.colorspace, tags.color_range, tags.color_primaries, tags.color_trc) == (
            9, 1, 9, 16,
        )  # fmt: skip
        assert out.info.tags.assumed == ()
        assert out.info.pixel_format == "yuv420p10le"


def test_packet_with_an_undefined_dts_gets_its_pts(tmp_path):
    clip = write_clip(tmp_path / "in.mkv", [noise_frame(64, 48, "yuv420p")])
    packet = av.Packet(8)
    packet.pts, packet.dts, packet.time_base = 40, -(2**62), Fraction(1, 1000)
    delayed = av.Packet(8)
    delayed.pts, delayed.dts, delayed.time_base = 200, 120, Fraction(1, 1000)
    with open_source(str(clip)) as source:
        first, second = EncoderClock(source.info).retimed([packet, delayed])
    assert (first.pts, first.dts) == (40, 40)
    assert (second.pts, second.dts) == (200, 120)


@pytest.mark.parametrize("codec", ["libx264", "libx265"])
@pytest.mark.parametrize("extension", ["mp4", "mkv"])
def test_gap_of_more_than_a_minute_between_frames_is_kept(tmp_path, extension, codec):
    pts = [40 * number + (70000 if number > 6 else 0) for number in range(14)]
    clip = write_clip(
        tmp_path / "in.mkv", [noise_frame(64, 48, "yuv420p", seed) for seed in range(14)],
        codec=codec, pts=pts, time_base=Fraction(1, 1000), options={"bf": "3"},
    )  # fmt: skip
    out = tmp_path / f"out.{extension}"
    copy(clip, out)
    assert read_times(out) == read_times(clip) == [Fraction(moment, 1000) for moment in pts]
    with av.open(str(out)) as result:
        assert any(one.pts != one.dts for one in result.demux(video=0) if one.dts is not None)


@pytest.mark.parametrize("deep", [False, True])
def test_png_still_is_kept_bit_for_bit_in_its_bit_depth(tmp_path, deep):
    rng = np.random.default_rng(0)
    pixels = rng.integers(0, 65536 if deep else 256, (27, 37, 3))
    frame = av.VideoFrame.from_ndarray(
        pixels.astype(np.uint16 if deep else np.uint8), "rgb48le" if deep else "rgb24"
    )
    path = tmp_path / "in.png"
    context = av.CodecContext.create("png", "w")
    context.width, context.height, context.pix_fmt = 37, 27, "rgb48be" if deep else "rgb24"
    context.time_base = Fraction(1, 25)
    frame = frame.reformat(format=context.pix_fmt)
    path.write_bytes(b"".join(bytes(p) for p in [*context.encode(frame), *context.encode(None)]))
    copy(path, tmp_path / "out.png")
    first, second = frames(path), frames(tmp_path / "out.png")
    np.testing.assert_array_equal(first[0][0], second[0][0])
    with open_source(str(tmp_path / "out.png")) as out:
        assert (out.info.kind, out.info.frame_count) == ("still", 1)


def test_image_sequence_keeps_its_first_number(tmp_path):
    clip = write_clip(tmp_path / "in.mkv", [noise_frame(32, 24, "gbrp10le", s) for s in range(3)])
    copy(clip, tmp_path / "a_%04d.png")
    for index in (2, 1, 0):
        (tmp_path / f"a_{index:04d}.png").rename(tmp_path / f"a_{index + 7:04d}.png")
    copy(tmp_path / "a_%04d.png", tmp_path / "b_%03d.png")
    assert sorted(path.name for path in tmp_path.glob("b_*")) == [
        "b_007.png", "b_008.png", "b_009.png",
    ]  # fmt: skip
    with open_source(str(tmp_path / "a_%04d.png"), input_rate="12") as source:
        assert [frame.time_s for frame in source] == pytest.approx([0, 1 / 12, 2 / 12])


def run_piped(arguments, data):
    code = (
        "import sys; from nlens_video.video.input.source import open_source\n"
        f"with open_source('-', **{arguments!r}) as s:\n"
        "    print(s.info.width, s.info.height, [round(f.time_s, 3) for f in s])"
    )
    return subprocess.run(
        [sys.executable, "-c", code], input=data, capture_output=True, check=False
    )


@pytest.mark.parametrize(
    ("container", "codec"),
    [("nut", "rawvideo"), ("yuv4mpegpipe", "rawvideo"), ("matroska", "ffv1")],
)
def test_stream_is_read_from_a_pipe(tmp_path, container, codec):
    made = [noise_frame(64, 48, "yuv420p", seed) for seed in range(3)]
    base = Fraction(1, 25)
    clip = write_clip(
        tmp_path / "clip", made, codec=codec, pts=range(3), time_base=base, format_=container
    )  # fmt: skip
    done = run_piped({}, clip.read_bytes())
    assert done.stdout.decode().strip() == "64 48 [0.0, 0.04, 0.08]", done.stderr.decode()


def test_raw_video_is_read_from_a_pipe_with_pixel_format_and_size():
    hints = {"input_format": "bgr24", "input_size": "16x12", "input_rate": "10"}
    done = run_piped(hints, bytes(16 * 12 * 3 * 2))
    assert done.stdout.decode().strip() == "16 12 [0.0, 0.1]", done.stderr.decode()


def test_piped_mp4_with_its_index_at_the_end_is_refused_with_advice(tmp_path):
    made = [noise_frame(512, 512, "yuv420p", seed) for seed in range(4)]
    clip = write_clip(tmp_path / "in.mp4", made, codec="libx264", options={"qp": "0"})
    done = run_piped({}, clip.read_bytes())
    assert b"-movflags +faststart" in done.stderr.splitlines()[-1]


def test_result_on_standard_output_is_nut(tmp_path, noise):
    clip = write_clip(tmp_path / "in.mkv", noise)
    code = (
        "import sys; sys.path.insert(0, sys.argv[1])\n"
        "from support.clips import copy; copy(sys.argv[2], '-')"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, str(TESTS), str(clip)],
        capture_output=True, check=True,
    )  # fmt: skip
    (tmp_path / "out.nut").write_bytes(done.stdout)
    for old, new in zip(frames(clip), frames(tmp_path / "out.nut"), strict=True):
        np.testing.assert_array_equal(old[0], new[0])


def test_truncated_clip_gives_its_intact_frames(tmp_path, noise):
    clip = write_clip(tmp_path / "in.mkv", noise)
    data = clip.read_bytes()
    (tmp_path / "cut.mkv").write_bytes(data[: len(data) * 2 // 3])
    with open_source(str(tmp_path / "cut.mkv")) as source:
        count = sum(1 for _ in source)
    assert 3 <= count < len(VFR)


def test_damaged_packets_are_counted_and_skipped(tmp_path):
    made = [noise_frame(64, 48, "rgb24", seed) for seed in range(6)]
    clip = write_clip(tmp_path / "in.mov", made, codec="png")
    data = bytearray(clip.read_bytes())
    starts = [i for i in range(len(data)) if data[i : i + 4] == b"\x89PNG"]
    data[starts[3] : starts[3] + 40] = bytes(40)
    (tmp_path / "bad.mov").write_bytes(data)
    with open_source(str(tmp_path / "bad.mov")) as source:
        count = sum(1 for _ in source)
    assert (count, source.damaged) == (5, 1)


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("missing.mp4", None, "no such file"),
        ("empty.mp4", b"", "is empty"),
        ("text.mp4", b"this is no video" * 99, "cannot be opened"),
        ("none_%04d.png", None, "no such files"),
        ("bad.exr", b"not an exr", "cannot be read as OpenEXR"),
    ],
)
def test_invalid_plate_is_refused_in_one_line(tmp_path, name, content, words):
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(InputError, match=words) as caught:
        open_source(str(tmp_path / name))
    assert "\n" not in str(caught.value)


def test_file_with_audio_only_is_refused(tmp_path):
    with av.open(str(tmp_path / "in.wav"), "w") as out:
        stream = out.add_stream("pcm_s16le", 8000, layout="mono")
        block = av.AudioFrame.from_ndarray(np.zeros((1, 800), np.int16), "s16", "mono")
        block.sample_rate, block.pts = 8000, 0
        out.mux(stream.encode(block))
        out.mux(stream.encode(None))
    with pytest.raises(InputError, match="no video stream"):
        open_source(str(tmp_path / "in.wav"))


def test_raw_video_without_a_size_is_refused():
    with pytest.raises(UsageError, match="--input-size"):
        open_source("x", input_format="yuv420p")


@pytest.fixture
def pictures(tmp_path):
    """A folder with PNG plates and an OpenEXR one."""
    write_plates(tmp_path, 1, 2)
    write_layers(tmp_path / "p_0001.exr", dict.fromkeys("RGB", np.zeros((4, 4), np.float32)))
    return tmp_path


@pytest.mark.parametrize("name", ["p_%04d.png", "p_0001.png", "p_0001.exr"])
def test_input_rate_applies_to_stills_and_input_size_does_not(pictures, name):
    with open_source(str(pictures / name), input_rate="12") as source:
        assert source.info.average_rate == 12
    with pytest.raises(UsageError, match="--input-size 64x48: .* says that itself"):
        open_source(str(pictures / name), input_size="64x48")


@pytest.mark.parametrize("hint", [{"input_rate": "12"}, {"input_size": "64x48"}])
@pytest.mark.parametrize("format_", [None, "matroska"])
def test_input_rate_or_size_for_a_video_that_states_them_is_refused(tmp_path, noise, format_, hint):
    clip = write_clip(tmp_path / "in.mkv", noise)
    with pytest.raises(UsageError, match="says that itself; leave it out"):
        open_source(str(clip), input_format=format_, **hint)


def test_raw_h264_stream_uses_the_given_input_rate(tmp_path, noise):
    clip = write_clip(tmp_path / "in.h264", noise, codec="libx264")
    with open_source(str(clip), input_rate="12") as source:
        assert source.info.average_rate == 12


@pytest.mark.parametrize("option", [{"codec": "libx264"}, {"crf": 12.0}])
@pytest.mark.parametrize("name", ["out_%04d.png", "out_%04d.exr", "out_%04d.jpg"])
def test_codec_or_quality_options_for_still_output_are_refused(tmp_path, noise, name, option):
    clip = write_clip(tmp_path / "in.mkv", noise)
    with open_source(str(clip)) as source, pytest.raises(UsageError, match="has no such choice"):
        open_sink(str(tmp_path / name), source.info, **option)
    assert [path.name for path in tmp_path.iterdir()] == ["in.mkv"]


def test_pixel_format_for_openexr_output_is_refused(tmp_path, noise):
    clip = write_clip(tmp_path / "in.mkv", noise)
    with open_source(str(clip)) as source, pytest.raises(UsageError, match="--pix-fmt rgb24"):
        open_sink(str(tmp_path / "out_%04d.exr"), source.info, pix_fmt="rgb24")


@pytest.mark.parametrize("keep", [False, True])
@pytest.mark.parametrize("name", ["out.mp4", "out_%04d.png"])
def test_aborted_result_leaves_nothing_unless_keep_partial_is_set(tmp_path, noise, name, keep):
    clip = write_clip(tmp_path / "in.mkv", noise)
    with (
        pytest.raises(RuntimeError, match="stop"),
        open_source(str(clip)) as source,
        open_sink(str(tmp_path / name), source.info, keep_partial=keep) as sink,
    ):
        for frame in source:
            sink.write(frame)
            assert not list(tmp_path.glob("out*"))
            if frame.index == 2:
                raise RuntimeError("stop")
    left = sorted(path for path in tmp_path.iterdir() if path != clip)
    assert left == ([sink.kept] if keep else [])
    if keep and sink.kept.is_file():
        assert len(read_times(sink.kept)) == 3


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("no/such/out.mp4", "does not exist"),
        ("out.xyz", "nothing writes this extension"),
        ("in.mkv", "is the input as well"),
        ("out.png", "is one picture"),
        (".", "is a folder"),
    ],
)
def test_unwritable_output_is_refused_in_one_line(tmp_path, noise, name, words):
    clip = write_clip(tmp_path / "in.mkv", noise)
    with open_source(str(clip)) as source, pytest.raises(OutputError, match=words) as caught:
        open_sink(str(tmp_path / name), source.info)
    assert "\n" not in str(caught.value)
    assert [path.name for path in tmp_path.iterdir()] == ["in.mkv"]


def test_full_disk_is_a_one_line_error(tmp_path, noise):
    clip = write_clip(tmp_path / "in.mkv", noise)
    partial_name(tmp_path / "out.mkv").symlink_to("/dev/full")
    with pytest.raises(OutputError, match="No space left"):
        copy(clip, tmp_path / "out.mkv")
    assert [path.name for path in tmp_path.iterdir()] == ["in.mkv"]
